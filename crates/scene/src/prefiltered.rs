//! Prefiltered lights for other programs: a cube map with a level for each roughness, in files for
//! engines, and a description of the levels.

use crate::{
    environment::{RESOLUTION_SLOW, radiance, resampled},
    light_file::write_preview,
};
use serde_json::{Value, json};
use specula_core::{
    prefilter::{Levels, MAX_LEVELS, MipRoughness, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_cpu::{CpuError, CpuExecutor};
use specula_io::{
    Result,
    ktx::{self, CubeLevel},
    latlong::{self, LatLong, UpAxis},
};
use std::path::{Path, PathBuf};

/// Face resolution of lat-long maps by default, as in Filament's tools.
const MAP_RESOLUTION: usize = 256;
/// Resolution of the last level by default. The resulting number of levels comes closest to the
/// integral, although the roughest levels have few texels (docs/lab/performance.md, The prefilter).
const COARSEST: usize = 4;

/// Levels of a prefiltered light and their weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LevelChain {
    /// Mip chain from roughness 0 to 1, integrated over the light.
    Mips {
        /// Roughness of a level.
        roughness: MipRoughness,
        /// Number of levels; by default down to 4 texels, the best in measurements.
        count: Option<usize>,
    },
    /// Levels of the authors' code, integrated over the light.
    Paper,
    /// Levels and weights of the authors' code.
    Official,
}

impl LevelChain {
    /// Name in descriptions: `specula`, `paper` or `official`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mips { .. } => "specula",
            Self::Paper => "paper",
            Self::Official => "official",
        }
    }

    /// Minimum resolution of the first level.
    pub const fn resolution_min(self) -> usize {
        match self {
            Self::Mips { .. } => PrefilterScheme::Exact.resolution_min(),
            Self::Paper | Self::Official => PrefilterScheme::Official.resolution_min(),
        }
    }

    /// Number of levels from a resolution, a power of two: the requested one, or the default.
    pub fn count(self, resolution: usize) -> usize {
        match self {
            Self::Mips { count: Some(count), .. } => count,
            Self::Mips { count: None, .. } => {
                ((resolution / COARSEST).max(1).ilog2() as usize + 1).min(Self::count_max(resolution))
            }
            Self::Paper | Self::Official => Levels::new(PrefilterScheme::Official, resolution).as_slice().len(),
        }
    }

    /// Largest number of levels of a mip chain from a resolution, a power of two.
    pub fn count_max(resolution: usize) -> usize {
        (resolution.ilog2() as usize + 1).min(MAX_LEVELS)
    }

    /// Levels from a resolution, a power of two of at least [`LevelChain::resolution_min`]; `None`
    /// if there are too few.
    pub fn levels(self, resolution: usize) -> Option<Levels> {
        match self {
            Self::Mips { roughness, .. } => Levels::mips(roughness, resolution, self.count(resolution)),
            Self::Paper | Self::Official => Some(Levels::new(PrefilterScheme::Official, resolution)),
        }
    }

    /// Weights of texels.
    const fn weights(self) -> PrefilterScheme {
        match self {
            Self::Mips { .. } | Self::Paper => PrefilterScheme::Exact,
            Self::Official => PrefilterScheme::Official,
        }
    }

    /// Level of a roughness ρ as a formula, where `last` is that of roughness 1.
    fn level_of_roughness(self, last: usize) -> String {
        match self {
            Self::Mips { roughness: MipRoughness::Linear, .. } => format!("{last} ρ"),
            Self::Mips { roughness: MipRoughness::Filament, .. } => format!("{last} ρ (2 − ρ)"),
            Self::Paper | Self::Official => "linear between the levels, the first below its roughness".to_owned(),
        }
    }
}

/// Format of a prefiltered light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CubeFormat {
    /// One file with all levels in 16-bit floats.
    Ktx2,
    /// One file per level in 32-bit floats.
    Exr,
}

impl CubeFormat {
    /// Format of an extension in lower case, without a dot.
    pub fn from_extension(extension: &str) -> Option<Self> {
        match extension {
            "ktx2" => Some(Self::Ktx2),
            "exr" => Some(Self::Exr),
            _ => None,
        }
    }

    /// Names of the files of `count` levels, and their format in a sentence.
    fn files(self, path: &Path, count: usize) -> (Vec<String>, &'static str) {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match self {
            Self::Ktx2 => (vec![name(path)], "R16G16B16A16_SFLOAT, a mip level for each level"),
            Self::Exr => {
                let names = (0..count).map(|level| name(&level_path(path, level, "exr"))).collect();
                (names, "32-bit RGB, a file for each level, six faces in a column")
            }
        }
    }
}

/// Path of a level's file: `sky.level0.png` for `sky.ktx2`.
fn level_path(path: &Path, level: usize, extension: &str) -> PathBuf {
    path.with_extension(format!("level{level}.{extension}"))
}

/// Cube map of a lat-long map, in a world with this up axis; by default of 256 texels along an
/// edge.
pub fn light_of_map(map: &LatLong, resolution: Option<usize>, up: UpAxis) -> Environment<Vec<f32>> {
    let resolution = resolution.unwrap_or(MAP_RESOLUTION);
    let values = latlong::to_cube(map, resolution, up);
    Environment { resolution, activation: RadianceActivation::Identity, values }
}

/// Light of a model, whose world is z-up, in a world with this up axis, times two to the power of
/// the exposure; that of a network at roughness 0.
pub fn light_of_model(light: &Environment<Vec<f32>>, exposure: f32, up: UpAxis) -> Environment<Vec<f32>> {
    let mut values = radiance_to_filter(light);
    values.iter_mut().for_each(|number| *number *= exposure.exp2());
    if up == UpAxis::Y {
        values = latlong::y_up_from_z_up(&values, light.resolution);
    }
    Environment { resolution: light.resolution, activation: RadianceActivation::Identity, values }
}

/// Radiance of a light to be filtered for other programs; warns if a network has its own levels.
pub fn radiance_to_filter(light: &Environment<Vec<f32>>) -> Vec<f32> {
    if light.is_network() {
        tracing::warn!(
            "the light is a network; the levels are filtered from its light at roughness 0, so rough levels differ \
             from the trained ones"
        );
    }
    radiance(light)
}

/// Light at a resolution, by default its own rounded up to one that the chain supports.
pub fn at_resolution(
    light: &Environment<Vec<f32>>,
    resolution: Option<usize>,
    chain: LevelChain,
) -> Environment<Vec<f32>> {
    resampled(light, resolution.unwrap_or(light.resolution.next_power_of_two().max(chain.resolution_min())))
}

/// Faces of a light for each level of roughness.
#[derive(Clone, Debug)]
pub struct PrefilteredLight {
    chain: LevelChain,
    up: UpAxis,
    levels: Levels,
    faces: Vec<CubeLevel>,
}

impl PrefilteredLight {
    /// Filters a light, whose world has this up axis, into levels of a chain on the CPU.
    ///
    /// # Errors
    ///
    /// [`CpuError::LightResolution`] if the first level and the light differ in resolution.
    pub fn new(
        light: &Environment<Vec<f32>>,
        chain: LevelChain,
        levels: Levels,
        up: UpAxis,
    ) -> core::result::Result<Self, CpuError> {
        if light.resolution > RESOLUTION_SLOW {
            tracing::info!("filtering six times {0} × {0} texels; this takes a while", light.resolution);
        }
        let filtered = CpuExecutor::new().prefilter_into(light, chain.weights(), levels)?;
        let numbered = levels.as_slice().iter().enumerate();
        let faces = numbered
            .map(|(number, level)| CubeLevel { resolution: level.resolution, rgb: filtered.faces(number) })
            .collect();
        Ok(Self { chain, up, levels, faces })
    }

    /// Writes the levels: one file, or `sky.level0.exr` and so on for `sky.exr`.
    ///
    /// # Errors
    ///
    /// A file that cannot be written.
    pub fn write(&self, path: &Path, format: CubeFormat) -> Result<()> {
        match format {
            CubeFormat::Ktx2 => {
                let levels = self.levels.as_slice();
                let roughness: Vec<String> = levels.iter().map(|level| level.roughness.to_string()).collect();
                ktx::write_cube(path, &self.faces, &[("roughness", &roughness.join(" "))])
            }
            CubeFormat::Exr => self.faces.iter().enumerate().try_for_each(|(level, CubeLevel { resolution, rgb })| {
                latlong::write_cube_exr(&level_path(path, level, "exr"), rgb, *resolution)
            }),
        }
    }

    /// Writes a lat-long preview of each level: `sky.level0.png` and so on for `sky.ktx2`.
    ///
    /// # Errors
    ///
    /// A file that cannot be written.
    pub fn write_previews(&self, path: &Path) -> Result<()> {
        self.faces.iter().enumerate().try_for_each(|(level, CubeLevel { resolution, rgb })| {
            write_preview(&level_path(path, level, "png"), rgb, *resolution, self.up.into())
        })
    }

    /// Description of the files at `path` for programs that sample them; `environment` is the path
    /// of the light, `exposure` its exposure in stops.
    pub fn description(&self, path: &Path, format: CubeFormat, environment: &str, exposure: f32) -> Value {
        let levels = self.levels.as_slice();
        let (files, format) = format.files(path, levels.len());
        let level = |number: usize| {
            let (roughness, resolution) = (levels[number].roughness, levels[number].resolution);
            let alpha_ggx = roughness * roughness;
            json!({"level": number, "resolution": resolution, "roughness": roughness, "alpha_ggx": alpha_ggx})
        };
        json!({
            "environment": environment,
            "exposure": exposure,
            "scheme": self.chain.name(),
            "files": files,
            "format": format,
            "faces": ["+X", "-X", "+Y", "-Y", "+Z", "-Z"],
            "orientation": "columns to the right, rows down, seen from inside as Vulkan, Direct3D, WebGPU and OpenGL \
                            look cube maps up: a lookup of (x, y, z) gives the light that comes from there",
            "up": match self.up {
                UpAxis::Y => "+y; the middle of a lat-long map lies at −z",
                UpAxis::Z => "+z; the middle of a lat-long map lies at +x",
            },
            "levels": (0..levels.len()).map(level).collect::<Vec<_>>(),
            "level_of_roughness": self.chain.level_of_roughness(levels.len() - 1),
            "lobe": "GGX around the reflected direction r, for n = v = r: ∫ L(ω) D(h·r) (ω·r)₊ dω / ∫ D(h·r) (ω·r)₊ \
                     dω, alpha_ggx = ρ²; it has no Fresnel or shadowing term",
            "split_sum": "specular = level(r, ρ) (F0 A(n·v, ρ) + B(n·v, ρ)); A and B as Karis 2013 has them, with \
                          height-correlated Smith shadowing and Schlick's Fresnel, not stored here",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_ends_at_four_texels_unless_a_number_of_levels_is_asked_for() {
        let chain = |count| LevelChain::Mips { roughness: MipRoughness::Linear, count };
        assert_eq!([16, 64, 256].map(|resolution| chain(None).count(resolution)), [3, 5, 7]);
        assert_eq!(chain(Some(4)).levels(64).map(|levels| levels.as_slice().len()), Some(4));
        assert!(chain(Some(8)).levels(64).is_none() && chain(Some(1)).levels(64).is_none());
        assert_eq!(LevelChain::count_max(64), 7);
    }
}
