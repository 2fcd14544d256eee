//! Environment maps from files of other programs.

use crate::{SceneError, environment::radiance};
use glam::Vec3;
use serde::Deserialize;
use specula_core::scene::Environment;
use specula_io::{
    Input, budget,
    latlong::{self, LatLong, MapOrientation, UpAxis},
    picture,
};
use std::path::Path;

/// Width and height of a preview, in pixels.
const PREVIEW_SIZE: [usize; 2] = [512, 256];

/// Direction of a scene at the upper edge of a lat-long map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub enum MapUp {
    /// Up direction of the scene.
    #[default]
    Scene,
    /// +y of the scene's world, as in GaussianShader and nvdiffrec.
    Y,
    /// +z of the scene's world, as in Blender.
    Z,
}

impl TryFrom<String> for MapUp {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, &'static str> {
        match text.as_str() {
            "scene" => Ok(Self::Scene),
            "y" => Ok(Self::Y),
            "z" => Ok(Self::Z),
            _ => Err("use scene, y or z"),
        }
    }
}

impl MapUp {
    /// Lower-case name, of options and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Y => "y",
            Self::Z => "z",
        }
    }

    /// Orientation of the map in a scene with this up direction.
    pub fn orientation(self, up: Vec3) -> MapOrientation {
        match self {
            Self::Scene => MapOrientation::with_up(up.as_dvec3().to_array()),
            Self::Y => UpAxis::Y.into(),
            Self::Z => UpAxis::Z.into(),
        }
    }
}

/// Interpretation of an environment map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightOptions {
    /// Direction of the scene at the upper edge of the map.
    pub up: MapUp,
    /// Exposure in stops; 1 doubles the radiance.
    pub exposure: f32,
}

/// Reads a lat-long map of linear radiance. Invalid values are replaced. Returns the map, and a
/// warning for each unusual property.
///
/// # Errors
///
/// A file that cannot be read, one with the faces of a cube, or a light that is too bright.
pub fn read(input: Input<'_>) -> Result<(LatLong, Vec<String>), SceneError> {
    let path = input.path();
    let (map, replaced) = latlong::read_from(input)?;
    budget::radiance(path, &map.rgb)?;
    if map.height == 6 * map.width {
        return Err(SceneError::CubeMap(path.to_owned()));
    }
    let mut warnings = latlong::notes(input)?;
    if replaced.total() > 0 {
        warnings.push(format!(
            "replaced {} invalid numbers in {path:?}: {} NaN, {} infinite, {} negative",
            replaced.total(),
            replaced.nan,
            replaced.infinite,
            replaced.negative
        ));
    }
    if !latlong::holds_radiance(input)? {
        warnings.push(format!(
            "{path:?} has no radiance above 1, so its lamps and suns are no brighter than white; use .hdr or .exr"
        ));
    }
    if map.width != 2 * map.height {
        warnings.push(format!(
            "{path:?} has {} × {} pixels and is stretched to 2:1; check that it is a lat-long map",
            map.width, map.height
        ));
    }
    Ok((map, warnings))
}

/// Lat-long map of a light, whose upper edge is the scene's up direction, at twice its resolution.
pub fn map_of(light: &Environment<Vec<f32>>, up: Vec3) -> LatLong {
    let height = 2 * light.resolution;
    latlong::from_cube(&radiance(light), light.resolution, 2 * height, height, MapUp::Scene.orientation(up))
}

/// Writes a lat-long preview of a cube map of linear radiance, tone-mapped.
///
/// # Errors
///
/// A file that cannot be written.
pub(crate) fn write_preview(
    path: &Path,
    values: &[f32],
    resolution: usize,
    orientation: MapOrientation,
) -> specula_io::Result<()> {
    let [width, height] = PREVIEW_SIZE;
    let map = latlong::from_cube(values, resolution, width, height, orientation);
    picture::write(path, &picture::tone_map_latlong(&map))
}

/// Writes a lat-long preview of the light of a scene, with the scene's up direction at its upper
/// edge.
///
/// # Errors
///
/// A file that cannot be written.
pub fn write_light_preview(path: &Path, light: &Environment<Vec<f32>>, up: Vec3) -> specula_io::Result<()> {
    write_preview(path, &radiance(light), light.resolution, MapUp::Scene.orientation(up))
}
