//! A photograph before it is decoded: its files, pose and lens.

use crate::{
    budget::PICTURE,
    color_space::InputSpace,
    error::{Error, Result},
    input::Input,
    lens::{Distortion, Lens},
    materials::{MaterialFiles, Materials},
    pixels::{EMPTY, Mask, NORMALS_RESIZED, Normals, Pixels, have_same_shape},
};
use glam::{DMat3, DVec3, Mat3};
use image::metadata::Orientation;
use specula_core::{
    camera::{Camera, NEAR},
    color::UNKNOWN,
};
use std::path::{Path, PathBuf};

/// Extensions of images, tried if the named file does not exist or has no extension.
pub const IMAGE_ENDINGS: [&str; 7] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "exr"];
/// Extensions of raw photographs, which are not read.
pub const RAW_ENDINGS: [&str; 8] = ["dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2"];

/// A photograph with its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name of the image, without folder and extension.
    pub name: String,
    /// Camera of the image's size.
    pub camera: Camera,
    /// Pixels of the image.
    pub image: Pixels,
    /// Ground-truth normals, if a test view has them.
    pub normal: Option<Normals>,
    /// Ground-truth materials; empty if a view has none.
    pub materials: Materials,
}

/// Light of a picture, as a data set names it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PictureLight {
    /// Name; `None` for that of all pictures without a name.
    pub name: Option<String>,
    /// Rotation from world axes to those of the light; `None` for a light that stands still.
    pub from_world: Option<Mat3>,
}

/// Position and rotation of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Rotation from world to camera axes: x right, y down, z forwards.
    pub(crate) camera_from_world: DMat3,
    /// Centre of projection in world space.
    pub(crate) position: DVec3,
}

/// A photograph to be decoded.
pub(crate) struct Shot {
    /// Name of the view.
    pub(crate) name: String,
    /// Path of the image.
    pub(crate) image: PathBuf,
    /// Colour space of the image.
    pub(crate) space: InputSpace,
    /// Path of the mask.
    pub(crate) mask: Option<PathBuf>,
    /// Whether masked pixels are empty, rather than unknown.
    pub(crate) is_cut_out: bool,
    /// Files of the ground-truth normals.
    pub(crate) normal: Option<NormalFiles>,
    /// Files of the ground-truth materials.
    pub(crate) materials: MaterialFiles,
    /// Pose of the camera.
    pub(crate) pose: Pose,
    /// Light of the picture.
    pub(crate) light: PictureLight,
    /// Size for which the lens was calibrated, if known.
    pub(crate) measured_size: Option<[u32; 2]>,
    /// Lens for the size of the decoded image.
    pub(crate) lens: Box<dyn Fn([u32; 2]) -> Result<Lens> + Send + Sync>,
    /// Factor by which the image is downscaled.
    pub(crate) downscale: u32,
}

/// Files of the ground-truth normals of a view.
#[derive(Clone, Debug)]
pub(crate) struct NormalFiles {
    /// Normal map.
    pub(crate) map: PathBuf,
    /// Coverage of the picture, if stored apart from it; normals count from one half.
    pub(crate) coverage: Option<PathBuf>,
}

impl core::fmt::Debug for Shot {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(out, "Shot({})", self.name)
    }
}

/// Changes of a picture during decoding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Whether lens distortion was removed.
    pub is_undistorted: bool,
    /// Whether the picture was rotated by its EXIF orientation.
    pub is_turned: bool,
    /// Whether the picture has no limit at white.
    pub is_unclipped: bool,
    /// Number of unknown pixels.
    pub unknown: u64,
    /// Number of all pixels.
    pub pixels: u64,
}

impl Changes {
    /// True if all pixels are unknown.
    pub const fn is_all_unknown(&self) -> bool {
        self.unknown == self.pixels
    }
}

impl Shot {
    /// Decodes the photograph: rotated to fit its camera, masked, downscaled and undistorted.
    pub(crate) fn open(&self) -> Result<(View, Changes)> {
        // A mask applies to the picture at full size, pixel by pixel.
        let downscale = if self.mask.is_some() { 1 } else { self.downscale };
        let mut stored = Pixels::open(&self.image, self.space, downscale, |size| self.fits(size))?;
        let (size, turned) = (stored.size, stored.turned);
        self.refuse_other_shape(size)?;
        let lens = (self.lens)(size)?;
        if let Some(mask) = &self.mask {
            let hidden = if self.is_cut_out { EMPTY } else { UNKNOWN };
            stored.pixels = Mask::for_photograph(mask, size, turned)?.applied(stored.pixels, hidden);
        }

        let [width, height] = size.map(|size| rounded_quotient(size, self.downscale));
        let image = stored.resized([width, height]);
        let lens = lens.resized(width, height);
        let is_undistorted = lens.distortion != Distortion::None;
        let undistorted = |image: Pixels| if is_undistorted { lens.undistorted(&image) } else { image };
        let image = undistorted(image);

        let normal = self.normal.as_ref().map(|files| normals_at(files, [width, height])).transpose()?;
        let materials = self.materials.read(size, |truth| {
            let is_full = [truth.width, truth.height] == [width, height];
            undistorted(if is_full { truth } else { truth.resized(width, height) })
        })?;
        let [unknown, pixels] = [image.unknown_count(), image.rgba.len() / 4].map(|count| count as u64);
        let camera = camera_of(&self.pose, &lens);
        let view = View { name: self.name.clone(), camera, image, normal, materials };
        let is_turned = turned != Orientation::NoTransforms;
        let is_unclipped = view.image.unclipped.is_some();
        Ok((view, Changes { is_undistorted, is_turned, is_unclipped, unknown, pixels }))
    }

    /// True if a picture of this size has the aspect ratio of its camera; `None` if that is
    /// unknown.
    fn fits(&self, size: [u32; 2]) -> Option<bool> {
        self.measured_size.map(|camera| have_same_shape(size, camera))
    }

    fn refuse_other_shape(&self, found: [u32; 2]) -> Result<()> {
        match (self.measured_size, self.fits(found)) {
            (Some(expected), Some(false)) => Err(Error::OtherShape { path: self.image.clone(), found, expected }),
            _ => Ok(()),
        }
    }
}

/// Reads ground-truth normals at the size of their picture. Coverage applies at full size.
fn normals_at(files: &NormalFiles, [width, height]: [u32; 2]) -> Result<Normals> {
    let path = files.map.as_path();
    let mut normals = Normals::read(path)?;
    if let Some(coverage) = &files.coverage {
        normals = Mask::read(coverage)?.applied_to_normals(normals);
    }
    if [normals.width, normals.height] == [width, height] {
        return Ok(normals);
    }
    let wanted = u64::from(width) * u64::from(height) * NORMALS_RESIZED;
    PICTURE.ask(path, Input::file(path).len()?, format!("its normals at {width} by {height} pixels"), wanted)?;
    Ok(normals.resized(width, height))
}

fn rounded_quotient(size: u32, downscale: u32) -> u32 {
    (f64::from(size) / f64::from(downscale)).round().max(1.0) as u32
}

/// Pinhole camera of an undistorted picture.
pub(crate) fn camera_of(pose: &Pose, lens: &Lens) -> Camera {
    Camera {
        camera_from_world: pose.camera_from_world.as_mat3(),
        position: pose.position.as_vec3(),
        focal_px: lens.focal_px.map(|focal| focal as f32),
        principal_px: lens.principal_px.map(|principal| principal as f32),
        light_from_world: None,
        scissor: None,
        light: 0,
        near: NEAR,
        width: lens.width,
        height: lens.height,
    }
}

/// Name of a view by the field's convention: the file name of its image without folder and
/// extension.
pub(crate) fn name_of(image: &Path) -> String {
    let name = if has_image_ending(image) { image.file_stem() } else { image.file_name() };
    name.unwrap_or(image.as_os_str()).to_string_lossy().into_owned()
}

/// Finds the file of an image, even if the extension is missing or differs from the list's.
pub(crate) fn find_image(named: &Path) -> Option<PathBuf> {
    if has_image_ending(named) && named.is_file() {
        return Some(named.to_owned());
    }
    let without_ending = without_image_ending(named);
    let candidates = IMAGE_ENDINGS.iter().flat_map(|ending| [(*ending).to_owned(), ending.to_uppercase()]);
    candidates.map(|ending| with_ending(&without_ending, &ending)).find(|path| path.is_file())
}

/// Finds the mask of an image in a folder of masks: `a.jpg`, COLMAP's `a.jpg.png`, or `a` with
/// another extension.
pub(crate) fn find_mask(folder: &Path, image: &Path) -> Option<PathBuf> {
    let named = folder.join(image);
    let double = with_ending(&named, "png");
    if double.is_file() { Some(double) } else { find_image(&named) }
}

/// Whether a file is a picture of a format that is read, by its name.
pub fn has_image_ending(path: &Path) -> bool {
    path.extension().is_some_and(|ending| IMAGE_ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

pub(crate) fn without_image_ending(path: &Path) -> PathBuf {
    if has_image_ending(path) { path.with_extension("") } else { path.to_owned() }
}

/// Returns whether a file is one of the `._` companions that macOS creates.
pub(crate) fn is_macos_shadow(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("._"))
}

/// Appends an extension; `with_extension` would replace `.5` in `frame_1.5`.
fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}
