//! Lists of cameras with poses as matrices: `transforms_train.json` of NeRF Synthetic, and
//! `transforms.json` of instant-ngp and nerfstudio. Keys follow nerfstudio's page on data
//! conventions.

use crate::{
    budget::{EDGE_MAX, LIST},
    cameras::rotation_of,
    error::{Error, Result},
    json,
    lens::{Distortion, Lens},
    listing::LoadOptions,
    named::{Files, plain_path},
    origin,
    photographs::Posed,
    shot::{self, PictureLight, Pose, camera_of, find_image},
};
use core::{f64::consts::PI, fmt};
use glam::{DMat3, DQuat, DVec3};
use serde::{
    Deserialize, Deserializer,
    de::{IgnoredAny, MapAccess, Visitor},
};
use serde_json::Value;
use specula_core::camera::Camera;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Tolerance for unit length and right angles of a rotation's columns; printed matrices have 1e-7.
const RIGID_TOLERANCE: f64 = 1e-3;
/// Tolerance for numbers of three decimals: products of columns have errors up to 1.7e-3, and so
/// has the mean length in a third of the cases.
const COARSE_TOLERANCE: f64 = 2.5e-3;
/// Maximum number of an object's entries in a note.
const KEYS_MAX: usize = 16;
/// Entries without effect on pictures or cameras: notes of programs, and their own placements of a
/// scene.
const IDLE_KEYS: [&str; 17] = [
    "rotation",
    "sharpness",
    "colmap_im_id",
    "aabb",
    "aabb_scale",
    "render_aabb",
    "scale",
    "offset",
    "up",
    "orientation_override",
    "auto_scale_poses_override",
    "applied_scale",
    "n_extra_learnable_dims",
    "white_transparent",
    "name",
    "id",
    "version",
];
/// Names of pinhole and polynomial camera models.
const POLYNOMIAL_MODELS: [&str; 6] = ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"];
/// Name of the fisheye model.
const FISHEYE_MODEL: &str = "OPENCV_FISHEYE";
/// Name of the model with k4 to k6 in a denominator.
const RATIONAL_MODEL: &str = "FULL_OPENCV";

/// Cameras of a file, and the folder of their image paths.
#[derive(Debug)]
pub(crate) struct Transforms {
    path: PathBuf,
    intrinsics: Intrinsics,
    pub(crate) frames: Vec<Frame>,
    pub(crate) rest: Rest,
    others: Keys,
}

/// Optional entries of nerfstudio.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Rest {
    /// Point cloud in the world of the frames.
    pub(crate) ply_file_path: Option<String>,
    /// Transform from COLMAP's world to that of the frames: three rows of four numbers.
    pub(crate) applied_transform: Option<Vec<[f64; 4]>>,
    /// Origin to which positions are relative, in files that were written for a scene.
    #[serde(default, deserialize_with = "origin::read")]
    pub(crate) origin: [f64; 3],
    /// Training frames, by their `file_path`.
    pub(crate) train_filenames: Option<Vec<String>>,
    /// Validation frames.
    pub(crate) val_filenames: Option<Vec<String>>,
    /// Test frames.
    pub(crate) test_filenames: Option<Vec<String>>,
}

#[derive(Deserialize)]
struct File {
    #[serde(flatten)]
    intrinsics: Intrinsics,
    #[serde(default)]
    frames: Vec<Frame>,
    #[serde(flatten)]
    rest: Rest,
    #[serde(flatten)]
    others: Keys,
}

/// Keys of unused entries.
#[derive(Debug, Default)]
struct Keys(Vec<String>);

impl<'de> Deserialize<'de> for Keys {
    fn deserialize<D: Deserializer<'de>>(from: D) -> core::result::Result<Self, D::Error> {
        from.deserialize_map(Self::default())
    }
}

impl<'de> Visitor<'de> for Keys {
    type Value = Self;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut entries: A) -> core::result::Result<Self, A::Error> {
        while let Some((key, IgnoredAny)) = entries.next_entry::<String, _>()? {
            if !IDLE_KEYS.contains(&key.as_str()) && self.0.len() < KEYS_MAX {
                self.0.push(key);
            }
        }
        Ok(self)
    }
}

/// One camera.
#[derive(Debug, Deserialize)]
pub(crate) struct Frame {
    /// Image, with or without extension.
    pub(crate) file_path: String,
    /// Mask.
    pub(crate) mask_path: Option<String>,
    /// World-from-camera matrix, rows first, in OpenGL's camera axes.
    transform_matrix: Vec<[f64; 4]>,
    /// Name of the light, or its number.
    light: Option<Value>,
    /// Rows of the rotation from world to light.
    light_rotation: Option<[[f32; 3]; 3]>,
    #[serde(flatten)]
    intrinsics: Intrinsics,
    #[serde(flatten)]
    others: Keys,
}

/// Intrinsics of all frames or of one; those of a frame take precedence.
#[derive(Clone, Debug, Default, Deserialize)]
struct Intrinsics {
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    k5: Option<f64>,
    k6: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

impl Intrinsics {
    fn or(&self, other: &Self) -> Self {
        Self {
            camera_model: self.camera_model.clone().or_else(|| other.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(other.is_fisheye),
            camera_angle_x: self.camera_angle_x.or(other.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(other.camera_angle_y),
            fl_x: self.fl_x.or(other.fl_x),
            fl_y: self.fl_y.or(other.fl_y),
            cx: self.cx.or(other.cx),
            cy: self.cy.or(other.cy),
            w: self.w.or(other.w),
            h: self.h.or(other.h),
            k1: self.k1.or(other.k1),
            k2: self.k2.or(other.k2),
            k3: self.k3.or(other.k3),
            k4: self.k4.or(other.k4),
            k5: self.k5.or(other.k5),
            k6: self.k6.or(other.k6),
            p1: self.p1.or(other.p1),
            p2: self.p2.or(other.p2),
        }
    }

    /// Distortion of the lens, or the fault of its parameters.
    fn distortion(&self) -> core::result::Result<Distortion, String> {
        let radial = [self.k1, self.k2, self.k3, self.k4, self.k5, self.k6].map(|k| k.unwrap_or(0.0));
        let [k1, k2, k3, k4, k5, k6] = radial;
        let tangential = [self.p1, self.p2].map(|p| p.unwrap_or(0.0));
        if !radial.iter().chain(&tangential).all(|number| (*number as f32).is_finite()) {
            return Err("has a distortion that is not finite; correct k1 to k6, p1 and p2".into());
        }
        let model = self.model();
        if !POLYNOMIAL_MODELS.contains(&model.as_str()) && model != FISHEYE_MODEL {
            let known = POLYNOMIAL_MODELS.join(", ");
            return Err(format!(
                "has the unsupported camera model {model:?}; supported are {known} and {FISHEYE_MODEL}"
            ));
        }
        if model != RATIONAL_MODEL && [k5, k6] != [0.0; 2] {
            return Err(format!(
                "has a k5 or k6, which only {RATIONAL_MODEL} supports; set that camera_model, or remove it"
            ));
        }
        if model == FISHEYE_MODEL {
            return Ok(Distortion::Fisheye { radial: [k1, k2, k3, k4], tangential, prism: [0.0; 2] });
        }
        if model != RATIONAL_MODEL && k4 != 0.0 {
            return Err(format!("has a k4, which only {FISHEYE_MODEL} supports; set that camera_model, or remove k4"));
        }
        Ok(Distortion::Polynomial { radial, tangential }.simplified())
    }

    /// Name of the camera model, in capitals.
    fn model(&self) -> String {
        let default = if self.is_fisheye == Some(true) { FISHEYE_MODEL } else { "OPENCV" };
        self.camera_model.as_deref().unwrap_or(default).to_uppercase()
    }

    /// Stated size, or its fault.
    fn stated_size(&self) -> core::result::Result<Option<[u32; 2]>, String> {
        let (Some(width), Some(height)) = (self.w, self.h) else { return Ok(None) };
        if [width, height].iter().all(|size| (1.0..=f64::from(EDGE_MAX)).contains(size)) {
            return Ok(Some([width as u32, height as u32]));
        }
        Err(format!("has pictures of {width} by {height} pixels; correct w and h, from 1 to {EDGE_MAX}"))
    }

    /// Lens for an image of this size, or the fault of its parameters.
    fn lens(&self, size: [u32; 2]) -> core::result::Result<Lens, String> {
        let distortion = self.distortion()?;
        let focal_px = self.focal_px(size).ok_or_else(|| NO_FOCAL.to_owned())?;
        let principal_px = self.principal_px(size);
        if !focal_px.iter().all(|focal| (*focal as f32).is_finite() && *focal as f32 > 0.0) {
            return Err(BAD_FOCAL.into());
        }
        if !principal_px.iter().all(|principal| (*principal as f32).is_finite()) {
            return Err("has a principal point that is not finite; correct cx and cy".into());
        }
        Ok(Lens { focal_px, principal_px, width: size[0], height: size[1], distortion })
    }

    /// Ratio of the image's size to the stated size, for images that were downscaled afterwards.
    fn pixel_scale(&self, [width, height]: [u32; 2]) -> [f64; 2] {
        let scale = |actual: u32, stated: Option<f64>| f64::from(actual) / stated.unwrap_or(f64::from(actual));
        [scale(width, self.w), scale(height, self.h)]
    }

    /// Focal lengths in pixels: stated, or from the fields of view; y follows x if only x is known.
    fn focal_px(&self, size: [u32; 2]) -> Option<[f64; 2]> {
        let scale = self.pixel_scale(size);
        let focal_of_angle = |pixels: u32, angle: f64| {
            if angle > 0.0 && angle < PI { 0.5 * f64::from(pixels) / (0.5 * angle).tan() } else { f64::NAN }
        };
        let focal_x = self.fl_x.map(|focal| focal * scale[0]);
        let focal_x = focal_x.or(self.camera_angle_x.map(|angle| focal_of_angle(size[0], angle)))?;
        let focal_y = self.fl_y.map(|focal| focal * scale[1]);
        let focal_y = focal_y.or(self.camera_angle_y.map(|angle| focal_of_angle(size[1], angle)));
        Some([focal_x, focal_y.unwrap_or(focal_x * scale[1] / scale[0])])
    }

    fn principal_px(&self, size: [u32; 2]) -> [f64; 2] {
        let scale = self.pixel_scale(size);
        [
            self.cx.map_or(0.5 * f64::from(size[0]), |cx| cx * scale[0]),
            self.cy.map_or(0.5 * f64::from(size[1]), |cy| cy * scale[1]),
        ]
    }
}

impl Transforms {
    /// Reads and checks a file. Companions of macOS (`._r_0`) stay in the list.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let File { intrinsics, frames, rest, others } = json::read(path, &LIST)?;
        if frames.is_empty() {
            return Err(Error::NoFrames { path: path.to_owned() });
        }
        Ok(Self { path: path.to_owned(), intrinsics, frames, rest, others })
    }

    /// Name of the file and models of its lenses.
    pub(crate) fn description(&self) -> String {
        let model = |frame: &Frame| {
            let intrinsics = frame.intrinsics.or(&self.intrinsics);
            let is_pinhole = intrinsics.camera_model.is_none() && intrinsics.distortion() == Ok(Distortion::None);
            if is_pinhole { "PINHOLE".to_owned() } else { intrinsics.model() }
        };
        let mut models: Vec<String> = self.frames.iter().map(model).collect();
        models.sort();
        models.dedup();
        format!("{:?} ({})", self.path, models.join(", "))
    }

    /// Notes on unused entries and coarse rotations.
    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let mut counts = BTreeMap::<&str, usize>::new();
        let keys = self.frames.iter().flat_map(|frame| &frame.others.0).chain(&self.others.0);
        keys.for_each(|key| *counts.entry(key).or_default() += 1);
        if !counts.is_empty() {
            let keys: Vec<&str> = counts.into_keys().collect();
            notes.push(format!("unused entries of {:?}: {}", self.path, keys.join(", ")));
        }
        let coarse = self.frames.iter().filter(|frame| frame.rotation().is_ok_and(|(_, is_coarse)| is_coarse)).count();
        if coarse > 0 {
            notes.push(format!("{coarse} rotations of {:?} have few decimals and were made orthogonal", self.path));
        }
        notes
    }

    /// Paths of the images below the folder of the file, or below that of the options.
    pub(crate) fn places(&self, files: &Files, options: &LoadOptions, notes: &mut Vec<String>) -> Vec<PathBuf> {
        places_of(self.frames.iter().map(|frame| frame.file_path.as_str()), files, options, notes)
    }

    /// Camera of a frame with its image.
    pub(crate) fn posed(&self, frame: &Frame, image: PathBuf, measured_size: Option<[u32; 2]>) -> Result<Posed> {
        let lens = Box::new(self.lens(frame));
        let (pose, light) = (self.pose(frame)?, self.light(frame)?);
        Ok(Posed { image, mask: frame.mask_path.clone(), pose, light, measured_size, lens })
    }

    /// Light of a frame.
    fn light(&self, frame: &Frame) -> Result<PictureLight> {
        let rotation = |rows| {
            let found = rotation_of(rows).map(|columns| columns.transpose());
            let what = "has a light_rotation that stretches, skews or mirrors; give the three rows of a rotation";
            found.ok_or_else(|| self.refuse(frame, what.into()))
        };
        let name = match &frame.light {
            None => None,
            Some(Value::String(name)) => Some(name.clone()),
            Some(Value::Number(number)) => Some(number.to_string()),
            Some(_) => return Err(self.refuse(frame, "has a light that is neither a name nor a number".into())),
        };
        Ok(PictureLight { name, from_world: frame.light_rotation.map(rotation).transpose()? })
    }

    /// Pinhole camera of a frame whose image has this size, relative to an origin.
    pub(crate) fn camera(&self, frame: &Frame, size: [u32; 2], origin: [f64; 3]) -> Result<Camera> {
        let mut pose = self.pose(frame)?;
        pose.position -= DVec3::from(origin);
        Ok(camera_of(&pose, &self.lens(frame)(size)?))
    }

    /// Pose of a frame in the world of the data set.
    pub(crate) fn pose(&self, frame: &Frame) -> Result<Pose> {
        let mut pose = frame.pose().map_err(|what| self.refuse(frame, what))?;
        // A difference keeps the sign of zero, which lists of cameras print.
        pose.position -= DVec3::ZERO - DVec3::from(self.rest.origin);
        Ok(pose)
    }

    /// Lens of a frame, as a function of the image's size.
    pub(crate) fn lens(&self, frame: &Frame) -> impl Fn([u32; 2]) -> Result<Lens> + Send + Sync + use<> {
        let intrinsics = frame.intrinsics.or(&self.intrinsics);
        let (path, frame) = (self.path.clone(), frame.file_path.clone());
        move |size| {
            let refuse = |what| Error::Frame { path: path.clone(), frame: frame.clone(), what };
            intrinsics.lens(size).map_err(refuse)
        }
    }

    /// Image of a frame, if it exists; its extension may be missing or differ.
    pub(crate) fn image_of(&self, frame: &Frame) -> Option<PathBuf> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let named = [Path::new(&frame.file_path).to_owned(), plain_path(&frame.file_path)];
        named.iter().find_map(|path| find_image(&folder.join(path)))
    }

    /// Stated size of a frame.
    pub(crate) fn stated_size(&self, frame: &Frame) -> Result<Option<[u32; 2]>> {
        frame.intrinsics.or(&self.intrinsics).stated_size().map_err(|what| self.refuse(frame, what))
    }

    /// Path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn refuse(&self, frame: &Frame, what: String) -> Error {
        Error::Frame { path: self.path.clone(), frame: frame.file_path.clone(), what }
    }
}

/// Paths of images that a list names ([`Transforms::places`]).
pub(crate) fn places_of<'a>(
    written: impl Iterator<Item = &'a str>,
    files: &Files,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Vec<PathBuf> {
    match options.other_images() {
        Some(folder) => files.placed_all(folder, Path::new(""), written, &mut Vec::new()),
        None => files.placed_all(Path::new(""), Path::new(&options.images), written, notes),
    }
}

const NO_FOCAL: &str = "has no focal length; add camera_angle_x (radians) or fl_x (pixels) to the file or to the frame";
const BAD_FOCAL: &str = "has an impossible focal length; camera_angle_x must be between 0 and π, fl_x above 0";

impl Frame {
    /// Name of a view by the field's convention: the file name of its image without folder and
    /// extension.
    pub(crate) fn name(&self) -> String {
        shot::name_of(Path::new(&self.file_path))
    }

    /// Returns whether the entry is a companion file of macOS.
    pub(crate) fn is_macos_shadow(&self) -> bool {
        shot::is_macos_shadow(Path::new(&self.file_path))
    }

    fn pose(&self) -> core::result::Result<Pose, String> {
        let (world_from_camera, _) = self.rotation()?;
        let position = DVec3::from(core::array::from_fn(|row| self.transform_matrix[row][3]));
        Ok(Pose { camera_from_world: world_from_camera.transpose(), position })
    }

    /// Rotation from camera to world, converted from OpenGL's camera axes, y up and z backwards, to
    /// y down and z forwards, and whether it had few decimals.
    fn rotation(&self) -> core::result::Result<(DMat3, bool), String> {
        let rows = &self.transform_matrix;
        if rows.len() < 3 {
            return Err(format!("has a transform_matrix of {} rows; 4 by 4 numbers are expected", rows.len()));
        }
        if let Some(row) = rows.iter().position(|row| !row.iter().all(|number| (*number as f32).is_finite())) {
            return Err(format!("has a number that is not finite in row {} of its transform_matrix", row + 1));
        }
        let column = |k: usize| DVec3::new(rows[0][k], rows[1][k], rows[2][k]);
        rigid(DMat3::from_cols(column(0), -column(1), -column(2)))
    }
}

/// Rotation without the uniform scale of some exporters, and whether it had few decimals; or the
/// fault of the matrix.
fn rigid(matrix: DMat3) -> core::result::Result<(DMat3, bool), String> {
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let scale = (columns.iter().map(|column| column.length_squared()).sum::<f64>() / 3.0).sqrt();
    let Some((rotation, is_coarse)) = orthogonal(matrix * scale.recip()).filter(|_| scale > 0.0) else {
        return Err("has a transform_matrix that stretches or skews; export a rotation, a translation and at most \
                    one uniform scale"
            .into());
    };
    if rotation.determinant() < 0.0 {
        return Err("has a transform_matrix that mirrors; export a right-handed camera".into());
    }
    Ok((DMat3::from_quat(DQuat::from_mat3(&rotation).normalize()), is_coarse))
}

/// Orthogonalised rotation, or its mirror image, and whether it had few decimals; `None` for other
/// matrices.
pub(crate) fn orthogonal(matrix: DMat3) -> Option<(DMat3, bool)> {
    let excess = (matrix.transpose() * matrix - DMat3::IDENTITY).to_cols_array();
    let is_within = |tolerance: f64| excess.iter().all(|number| number.abs() <= tolerance);
    // The mean with the inverse transpose is the nearest rotation, up to the square of the error.
    let nearest = || (matrix + matrix.inverse().transpose()) * 0.5;
    let is_coarse = !is_within(RIGID_TOLERANCE);
    is_within(COARSE_TOLERANCE).then(|| (if is_coarse { nearest() } else { matrix }, is_coarse))
}
