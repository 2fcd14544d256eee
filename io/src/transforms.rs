//! Lists of cameras as NeRF-synthetic scenes have them: `transforms_train.json` and its kind.

use crate::{
    error::{Error, Result},
    json,
};
use core::f64::consts::PI;
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use specula_core::{camera::Camera, project::NEAR};
use std::path::{Path, PathBuf};

/// How far the columns of a rotation may be from unit length and right angles; printed matrices have 1e-7.
const RIGID_TOLERANCE: f64 = 1e-3;
/// Endings that are tried where a frame names its image without one.
const IMAGE_ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

/// The cameras of a file, and the folder that their images are relative to.
pub(crate) struct Transforms {
    path: PathBuf,
    lens: Lens,
    pub(crate) frames: Vec<Frame>,
    /// Whether the file speaks of lens distortion, which is not modelled.
    pub(crate) is_distorted: bool,
}

#[derive(Deserialize)]
struct File {
    #[serde(flatten)]
    lens: Lens,
    #[serde(default)]
    frames: Vec<Frame>,
}

/// One camera.
#[derive(Deserialize)]
pub(crate) struct Frame {
    /// Its image, with or without ending.
    pub(crate) file_path: String,
    /// From camera to world, rows first, in OpenGL's camera axes.
    transform_matrix: Vec<[f64; 4]>,
    #[serde(flatten)]
    lens: Lens,
}

/// Intrinsics, for all frames or for one; what a frame does not say, the file says.
#[derive(Clone, Copy, Deserialize)]
struct Lens {
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
}

impl Lens {
    fn or(self, other: Self) -> Self {
        Self {
            camera_angle_x: self.camera_angle_x.or(other.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(other.camera_angle_y),
            fl_x: self.fl_x.or(other.fl_x),
            fl_y: self.fl_y.or(other.fl_y),
            cx: self.cx.or(other.cx),
            cy: self.cy.or(other.cy),
            w: self.w.or(other.w),
            h: self.h.or(other.h),
            k1: self.k1.or(other.k1),
        }
    }

    fn is_distorted(&self) -> bool {
        self.k1.is_some_and(|k1| k1 != 0.0)
    }

    /// Pixels per pixel for an image of this size: files may speak of images that were made smaller since.
    fn pixel_scale(&self, [width, height]: [u32; 2]) -> [f64; 2] {
        let scale = |actual: u32, stated: Option<f64>| f64::from(actual) / stated.unwrap_or(f64::from(actual));
        [scale(width, self.w), scale(height, self.h)]
    }

    /// Focal lengths in pixels: those stated, or else from the fields of view; y like x where only x is known.
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
    /// Reads and checks a file; frames that macOS made for its own use (`._r_0`) stay in the list.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let File { lens, frames } = json::read(path)?;
        if frames.is_empty() {
            return Err(Error::NoFrames { path: path.to_owned() });
        }
        let is_distorted = lens.is_distorted() || frames.iter().any(|frame| frame.lens.is_distorted());
        Ok(Self { path: path.to_owned(), lens, frames, is_distorted })
    }

    /// The camera of a frame whose image has this size.
    pub(crate) fn camera(&self, frame: &Frame, width: u32, height: u32) -> Result<Camera> {
        let pose = frame.pose().map_err(|what| self.refuse(frame, what))?;
        let lens = frame.lens.or(self.lens);
        let focal = lens.focal_px([width, height]).ok_or_else(|| self.refuse(frame, NO_FOCAL.into()))?;
        let principal = lens.principal_px([width, height]);
        if !focal.iter().all(|focal| focal.is_finite() && *focal > 0.0) {
            return Err(self.refuse(frame, BAD_FOCAL.into()));
        }
        if !principal.iter().all(|principal| principal.is_finite()) {
            return Err(self.refuse(frame, "has a principal point that is not finite; correct cx and cy".into()));
        }
        Ok(Camera {
            camera_from_world: pose.camera_from_world.as_mat3(),
            position: pose.position.as_vec3(),
            focal_px: focal.map(|focal| focal as f32),
            principal_px: principal.map(|principal| principal as f32),
            near: NEAR,
            width,
            height,
        })
    }

    /// The image of a frame; the ending may be missing, or another one than the frame says.
    pub(crate) fn image_of(&self, frame: &Frame) -> Result<PathBuf> {
        let named = self.folder().join(frame.file_path.trim_start_matches("./"));
        if has_image_ending(&named) && named.is_file() {
            return Ok(named);
        }
        let without_ending = if has_image_ending(&named) { named.with_extension("") } else { named.clone() };
        let mut candidates = IMAGE_ENDINGS.iter().map(|ending| with_ending(&without_ending, ending));
        candidates.find(|path| path.is_file()).ok_or_else(|| Error::MissingImage {
            path: named,
            frame: frame.file_path.clone(),
            transforms: self.path.clone(),
        })
    }

    /// The size that the file states for a frame.
    pub(crate) fn stated_size(&self, frame: &Frame) -> Option<[u32; 2]> {
        let lens = frame.lens.or(self.lens);
        let whole = |size: f64| (size >= 1.0 && size <= f64::from(u16::MAX)).then_some(size as u32);
        Some([whole(lens.w?)?, whole(lens.h?)?])
    }

    fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    fn refuse(&self, frame: &Frame, what: String) -> Error {
        Error::Frame { path: self.path.clone(), frame: frame.file_path.clone(), what }
    }
}

const NO_FOCAL: &str = "has no focal length; add camera_angle_x (radians) or fl_x (pixels) to the file or to the frame";
const BAD_FOCAL: &str = "has an impossible focal length; camera_angle_x must be between 0 and π, fl_x above 0";

struct Pose {
    camera_from_world: DMat3,
    position: DVec3,
}

impl Frame {
    /// The name by which the field's tools know a view: its image's, without folder and ending.
    pub(crate) fn name(&self) -> String {
        let path = Path::new(&self.file_path);
        let name = if has_image_ending(path) { path.file_stem() } else { path.file_name() };
        name.unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
    }

    /// Whether macOS made this entry beside the true one.
    pub(crate) fn is_macos_shadow(&self) -> bool {
        Path::new(&self.file_path).file_name().is_some_and(|name| name.to_string_lossy().starts_with("._"))
    }

    /// From OpenGL's camera axes, y up and looking along −z, to ours, y down and looking along +z.
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

/// A rotation without the uniform scale that some exporters leave in, or what is wrong with it.
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

fn has_image_ending(path: &Path) -> bool {
    path.extension().is_some_and(|ending| IMAGE_ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
}

/// Appends: `with_extension` would take `.5` off `frame_1.5`.
fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}
