//! Lists of cameras with poses as matrices: `transforms_train.json` of NeRF Synthetic, and
//! `transforms.json` of instant-ngp and nerfstudio. Keys follow nerfstudio's page on data
//! conventions.

use crate::{
    budget::{EDGE_MAX, LIST},
    error::{Error, Result},
    json,
    lens::{Distortion, Lens},
    shot::{self, Pose, camera_of, find_image},
};
use core::f64::consts::PI;
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use specula_core::camera::Camera;
use std::path::{Path, PathBuf};

/// Tolerance for unit length and right angles of a rotation's columns; printed matrices have 1e-7.
const RIGID_TOLERANCE: f64 = 1e-3;
/// Names of pinhole and polynomial camera models.
const POLYNOMIAL_MODELS: [&str; 6] = ["PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"];
/// Name of the fisheye model.
const FISHEYE_MODEL: &str = "OPENCV_FISHEYE";

/// Cameras of a file, and the folder of their image paths.
#[derive(Debug)]
pub(crate) struct Transforms {
    path: PathBuf,
    intrinsics: Intrinsics,
    pub(crate) frames: Vec<Frame>,
    pub(crate) rest: Rest,
}

/// Optional entries of nerfstudio.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Rest {
    /// Point cloud in the world of the frames.
    pub(crate) ply_file_path: Option<String>,
    /// Transform from COLMAP's world to that of the frames: three rows of four numbers.
    pub(crate) applied_transform: Option<Vec<[f64; 4]>>,
    /// Origin to which positions are relative, in files that were written for a scene.
    #[serde(default)]
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
    #[serde(flatten)]
    intrinsics: Intrinsics,
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
            p1: self.p1.or(other.p1),
            p2: self.p2.or(other.p2),
        }
    }

    /// Distortion of the lens, or the fault of its parameters.
    fn distortion(&self) -> core::result::Result<Distortion, String> {
        let [k1, k2, k3, k4] = [self.k1, self.k2, self.k3, self.k4].map(|k| k.unwrap_or(0.0));
        let tangential = [self.p1, self.p2].map(|p| p.unwrap_or(0.0));
        if ![k1, k2, k3, k4].iter().chain(&tangential).all(|number| (*number as f32).is_finite()) {
            return Err("has a distortion that is not finite; correct k1 to k4, p1 and p2".into());
        }
        let model = self.camera_model.as_deref().unwrap_or("OPENCV");
        if model == FISHEYE_MODEL || (self.is_fisheye == Some(true) && self.camera_model.is_none()) {
            return Ok(Distortion::Fisheye { radial: [k1, k2, k3, k4], tangential, prism: [0.0; 2] });
        }
        if !POLYNOMIAL_MODELS.contains(&model) {
            let known = POLYNOMIAL_MODELS.join(", ");
            return Err(format!("is of the camera model {model:?}; known are {known} and {FISHEYE_MODEL}"));
        }
        if k4 != 0.0 {
            return Err(format!("has a k4, which only {FISHEYE_MODEL} knows; name that camera_model, or remove k4"));
        }
        Ok(Distortion::Polynomial { radial: [k1, k2, k3, 0.0, 0.0, 0.0], tangential }.simplified())
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
        let focal_px = self.focal_px(size).ok_or_else(|| NO_FOCAL.to_owned())?;
        let principal_px = self.principal_px(size);
        if !focal_px.iter().all(|focal| (*focal as f32).is_finite() && *focal as f32 > 0.0) {
            return Err(BAD_FOCAL.into());
        }
        if !principal_px.iter().all(|principal| (*principal as f32).is_finite()) {
            return Err("has a principal point that is not finite; correct cx and cy".into());
        }
        Ok(Lens { focal_px, principal_px, width: size[0], height: size[1], distortion: self.distortion()? })
    }

    /// Ratio of the image's size to the stated size, for images that were made smaller afterwards.
    fn pixel_scale(&self, [width, height]: [u32; 2]) -> [f64; 2] {
        let scale = |actual: u32, stated: Option<f64>| f64::from(actual) / stated.unwrap_or(f64::from(actual));
        [scale(width, self.w), scale(height, self.h)]
    }

    /// Focal lengths in pixels: stated, or from the fields of view; y follows x where only x is
    /// known.
    fn focal_px(&self, size: [u32; 2]) -> Option<[f64; 2]> {
        let scale = self.pixel_scale(size);
        let of_angle = |pixels: u32, angle: f64| {
            if angle > 0.0 && angle < PI { 0.5 * f64::from(pixels) / (0.5 * angle).tan() } else { f64::NAN }
        };
        let focal_x = self.fl_x.map(|focal| focal * scale[0]);
        let focal_x = focal_x.or(self.camera_angle_x.map(|angle| of_angle(size[0], angle)))?;
        let focal_y = self.fl_y.map(|focal| focal * scale[1]);
        let focal_y = focal_y.or(self.camera_angle_y.map(|angle| of_angle(size[1], angle)));
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
        let File { intrinsics, frames, rest } = json::read(path, &LIST)?;
        if frames.is_empty() {
            return Err(Error::NoFrames { path: path.to_owned() });
        }
        Ok(Self { path: path.to_owned(), intrinsics, frames, rest })
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

    /// Finds the image of a frame; its extension may be missing or differ.
    pub(crate) fn image_of(&self, frame: &Frame) -> Result<PathBuf> {
        let named = self.named_by(frame);
        find_image(&named).ok_or_else(|| Error::MissingImage {
            path: named,
            frame: frame.file_path.clone(),
            transforms: self.path.clone(),
        })
    }

    /// Path of a frame's image as the file names it.
    pub(crate) fn named_by(&self, frame: &Frame) -> PathBuf {
        self.folder().join(frame.file_path.trim_start_matches("./"))
    }

    /// Stated size of a frame.
    pub(crate) fn stated_size(&self, frame: &Frame) -> Result<Option<[u32; 2]>> {
        frame.intrinsics.or(&self.intrinsics).stated_size().map_err(|what| self.refuse(frame, what))
    }

    /// Folder of the file, to which paths are relative.
    pub(crate) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// Path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn refuse(&self, frame: &Frame, what: String) -> Error {
        Error::Frame { path: self.path.clone(), frame: frame.file_path.clone(), what }
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

    /// Converts from OpenGL's camera axes, y up and z backwards, to y down and z forwards.
    fn pose(&self) -> core::result::Result<Pose, String> {
        let rows = &self.transform_matrix;
        if rows.len() < 3 {
            return Err(format!("has a transform_matrix of {} rows; 4 by 4 numbers are expected", rows.len()));
        }
        if let Some(row) = rows.iter().position(|row| !row.iter().all(|number| (*number as f32).is_finite())) {
            return Err(format!("has a number that is not finite in row {} of its transform_matrix", row + 1));
        }
        let column = |k: usize| DVec3::new(rows[0][k], rows[1][k], rows[2][k]);
        let world_from_camera = rigid(DMat3::from_cols(column(0), -column(1), -column(2)))?;
        Ok(Pose { camera_from_world: world_from_camera.transpose(), position: column(3) })
    }
}

/// Rotation without the uniform scale that some exporters leave in, or the fault of the matrix.
fn rigid(matrix: DMat3) -> core::result::Result<DMat3, String> {
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let scale = (columns.iter().map(|column| column.length_squared()).sum::<f64>() / 3.0).sqrt();
    let rotation = matrix * scale.recip();

    let excess = rotation.transpose() * rotation - DMat3::IDENTITY;
    let error = excess.to_cols_array().into_iter().fold(0.0, |most: f64, number| most.max(number.abs()));
    if !(scale > 0.0 && error <= RIGID_TOLERANCE) {
        return Err("has a transform_matrix that stretches or skews; export a rotation, a translation and at most \
                    one uniform scale"
            .into());
    }
    if rotation.determinant() < 0.0 {
        return Err("has a transform_matrix that mirrors; export a right-handed camera".into());
    }
    Ok(DMat3::from_quat(DQuat::from_mat3(&rotation).normalize()))
}
