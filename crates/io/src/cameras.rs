//! Lists of cameras: `cameras.json` of Gaussian-splatting tools, and `transforms.json` as a camera
//! path.

use crate::{
    budget::{LIST, view_size},
    error::{Error, Result},
    json, origin,
    transforms::{Frame, Transforms, orthogonal},
};
use glam::{DVec3, Mat3};
use serde::{Deserialize, Serialize, Serializer};
use specula_core::camera::{Camera, NEAR};
use std::path::Path;

/// A camera and its name.
pub type NamedCamera = (String, Camera);

/// One entry of `cameras.json`.
#[derive(Serialize, Deserialize)]
struct Entry {
    id: usize,
    img_name: String,
    width: u32,
    height: u32,
    #[serde(serialize_with = "as_f32")]
    position: [f64; 3],
    /// Origin to which the position is relative, in the world of the data set; omitted at zero.
    #[serde(default, skip_serializing_if = "origin::is_zero", deserialize_with = "origin::read")]
    origin: [f64; 3],
    /// Rows of the world-from-camera rotation.
    rotation: [[f32; 3]; 3],
    fy: f32,
    fx: f32,
    /// Rows of the rotation from world to light, omitted for a light that stands still.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    light_rotation: Option<[[f32; 3]; 3]>,
    /// Number of the light, from 0; omitted for the first.
    #[serde(default, skip_serializing_if = "json::is_default")]
    light: u32,
    /// Principal point, omitted at the centre, where other tools expect it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cx: Option<f32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    cy: Option<f32>,
}

/// Reads either format: a JSON list is `cameras.json`, an object is `transforms.json`.
///
/// `default_size` (width, height) applies to transforms without a stated size and without images.
/// Positions become relative to an `origin` in the world of the data set ([`crate::origin`]).
///
/// # Errors
///
/// An error of [`crate::Error`] for files that cannot be read or parsed, and for invalid cameras.
pub fn read_cameras(path: &Path, default_size: [u32; 2], origin: [f64; 3]) -> Result<Vec<NamedCamera>> {
    let bytes = LIST.read(path)?;
    let first = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes).trim_ascii_start().first();
    if first == Some(&b'[') { read_relative(path, Some(origin)) } else { load_transforms(path, default_size, origin) }
}

/// Reads the cameras of a `transforms.json`, whose images need not exist.
///
/// The size of a view is the stated one (`w`, `h`), or that of its image, or else `default_size`.
/// Positions become relative to an `origin` in the world of the data set.
///
/// # Errors
///
/// An error of [`crate::Error`] for files that cannot be read or parsed, and for invalid cameras.
pub fn load_transforms(path: &Path, default_size: [u32; 2], origin: [f64; 3]) -> Result<Vec<NamedCamera>> {
    let transforms = Transforms::read(path)?;
    let named = |frame: &Frame| {
        let size = size_of(&transforms, frame)?.unwrap_or(default_size);
        let size = view_size(size.map(u64::from));
        let [width, height] = size.map_err(|what| transforms.refuse(frame, format!("has {what}; correct w and h")))?;
        Ok((frame.name(), transforms.camera(frame, [width, height], origin)?))
    };
    transforms.frames.iter().filter(|frame| !frame.is_macos_shadow()).map(named).collect()
}

fn size_of(transforms: &Transforms, frame: &Frame) -> Result<Option<[u32; 2]>> {
    let image_size = || {
        let image = transforms.image_of(frame)?;
        image::image_dimensions(image).ok().map(|(width, height)| [width, height])
    };
    Ok(transforms.stated_size(frame)?.or_else(image_size))
}

/// Reads `cameras.json`. Positions are relative to the origin that the file names.
///
/// # Errors
///
/// An error of [`crate::Error`] for files that cannot be read or parsed, and for invalid cameras.
pub fn read(path: &Path) -> Result<Vec<NamedCamera>> {
    read_relative(path, None)
}

/// Reads `cameras.json`, relative to an origin, or else to that of each entry.
fn read_relative(path: &Path, origin: Option<[f64; 3]>) -> Result<Vec<NamedCamera>> {
    let entries: Vec<Entry> = json::read(path, &LIST)?;
    if entries.is_empty() {
        return Err(Error::NoFrames { path: path.to_owned() });
    }
    entries.into_iter().map(|entry| entry.check(path, origin)).collect()
}

/// Writes `cameras.json`, numbered in order, with the origin to which positions are relative.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write(path: &Path, cameras: &[NamedCamera], origin: [f64; 3]) -> Result<()> {
    let entries: Vec<Entry> = cameras.iter().enumerate().map(|(id, camera)| Entry::new(id, camera, origin)).collect();
    json::write(path, &entries)
}

impl Entry {
    fn new(id: usize, (name, camera): &NamedCamera, origin: [f64; 3]) -> Self {
        let off_centre = camera.principal_px != centre(camera.width, camera.height);
        Self {
            id,
            img_name: name.clone(),
            width: camera.width,
            height: camera.height,
            position: camera.position.as_dvec3().to_array(),
            origin,
            // The rows of world-from-camera are the columns of camera-from-world.
            rotation: camera.camera_from_world.to_cols_array_2d(),
            fy: camera.focal_px[1],
            fx: camera.focal_px[0],
            light_rotation: camera.light_from_world.map(|light| light.transpose().to_cols_array_2d()),
            light: camera.light,
            cx: off_centre.then_some(camera.principal_px[0]),
            cy: off_centre.then_some(camera.principal_px[1]),
        }
    }

    fn check(self, path: &Path, origin: Option<[f64; 3]>) -> Result<NamedCamera> {
        let size = view_size([self.width, self.height].map(u64::from));
        let size_fault = size.err().map(|what| format!("has {what}; correct width and height"));
        if let Some(what) = size_fault.or_else(|| self.fault().map(str::to_owned)) {
            return Err(Error::Frame { path: path.to_owned(), frame: self.img_name, what });
        }
        let camera_from_world = self.camera_from_world().expect("it has no fault");
        let moved = origin.map_or(DVec3::ZERO, |origin| DVec3::from(origin) - DVec3::from(self.origin));
        let [centre_x, centre_y] = centre(self.width, self.height);
        let camera = Camera {
            camera_from_world,
            position: (DVec3::from(self.position) - moved).as_vec3(),
            focal_px: [self.fx, self.fy],
            principal_px: [self.cx.unwrap_or(centre_x), self.cy.unwrap_or(centre_y)],
            light_from_world: self.light_rotation.and_then(rotation_of).map(|light| light.transpose()),
            scissor: None,
            light: self.light,
            near: NEAR,
            width: self.width,
            height: self.height,
        };
        Ok((self.img_name, camera))
    }

    fn camera_from_world(&self) -> Option<Mat3> {
        rotation_of(self.rotation)
    }

    fn fault(&self) -> Option<&'static str> {
        let is_rotation = self.camera_from_world().is_some();
        let is_light = self.light_rotation.is_none_or(|light| rotation_of(light).is_some());
        if !(self.fx > 0.0 && self.fy > 0.0 && self.fx.is_finite() && self.fy.is_finite()) {
            Some("has an impossible focal length; fx and fy must be above 0")
        } else if !self.position.iter().chain(&self.origin).all(|number| (*number as f32).is_finite()) {
            Some("has a position that is not finite")
        } else if !is_rotation {
            Some("has a rotation that stretches, skews or mirrors")
        } else if !is_light {
            Some("has a light_rotation that stretches, skews or mirrors")
        } else {
            None
        }
    }
}

/// Rotation with these columns; `None` for other matrices.
pub(crate) fn rotation_of(columns: [[f32; 3]; 3]) -> Option<Mat3> {
    let (rotation, _) = orthogonal(Mat3::from_cols_array_2d(&columns).as_dmat3())?;
    (rotation.determinant() > 0.0).then(|| rotation.as_mat3())
}

/// Writes only the digits of an `f32`.
fn as_f32<S: Serializer>(position: &[f64; 3], serializer: S) -> core::result::Result<S::Ok, S::Error> {
    position.map(|coordinate| coordinate as f32).serialize(serializer)
}

fn centre(width: u32, height: u32) -> [f32; 2] {
    [0.5 * width as f32, 0.5 * height as f32]
}
