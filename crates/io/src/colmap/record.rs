//! Records of a COLMAP reconstruction: cameras with their models, images with their poses, points.

use crate::{
    budget::EDGE_MAX,
    error::Error,
    lens::{Distortion, Lens},
    shot::Pose,
};
use glam::{DMat3, DQuat, DVec3};
use std::path::Path;

/// A camera: one lens, shared by images.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Camera {
    pub(super) model: &'static Kind,
    pub(super) width: u64,
    pub(super) height: u64,
    pub(super) params: Vec<f64>,
}

/// An image with its pose.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Image {
    pub(super) id: u32,
    /// Camera-from-world rotation: w, x, y, z.
    pub(super) quat: [f64; 4],
    /// Camera-from-world translation.
    pub(super) translation: [f64; 3],
    pub(super) camera: u32,
    pub(super) name: String,
}

/// A point of the sparse cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub(super) position: [f64; 3],
    pub(super) color: [u8; 3],
}

/// A point with the images that see it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Track {
    pub(crate) position: [f64; 3],
    /// Mean reprojection error in pixels.
    pub(crate) error: f64,
    /// Identifiers of the images.
    pub(crate) images: Vec<u32>,
}

/// A camera model: number and name in files, and number of parameters.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Kind {
    pub(super) number: u32,
    pub(super) name: &'static str,
    pub(super) params: usize,
}

/// Supported camera models, by number.
pub(super) const KINDS: [Kind; 11] = [
    Kind { number: 0, name: "SIMPLE_PINHOLE", params: 3 },
    Kind { number: 1, name: "PINHOLE", params: 4 },
    Kind { number: 2, name: "SIMPLE_RADIAL", params: 4 },
    Kind { number: 3, name: "RADIAL", params: 5 },
    Kind { number: 4, name: "OPENCV", params: 8 },
    Kind { number: 5, name: "OPENCV_FISHEYE", params: 8 },
    Kind { number: 6, name: "FULL_OPENCV", params: 12 },
    Kind { number: 7, name: "FOV", params: 5 },
    Kind { number: 8, name: "SIMPLE_RADIAL_FISHEYE", params: 4 },
    Kind { number: 9, name: "RADIAL_FISHEYE", params: 5 },
    Kind { number: 10, name: "THIN_PRISM_FISHEYE", params: 12 },
];

/// Unsupported camera models, which only cameras without pictures may have.
pub(super) const UNREAD_KINDS: [Kind; 5] = [
    Kind { number: 11, name: "RAD_TAN_THIN_PRISM_FISHEYE", params: 16 },
    Kind { number: 12, name: "SIMPLE_DIVISION", params: 4 },
    Kind { number: 13, name: "DIVISION", params: 5 },
    Kind { number: 14, name: "SIMPLE_FISHEYE", params: 3 },
    Kind { number: 15, name: "FISHEYE", params: 4 },
];

/// Remedy for an unsupported camera model.
pub(super) fn unknown_model(model: &str) -> String {
    let known: Vec<&str> = KINDS.iter().map(|kind| kind.name).collect();
    format!(
        "has the unsupported camera model {model}; undistort the images with colmap image_undistorter, or reconstruct \
         with one of {}",
        known.join(", ")
    )
}

/// Error at a place of a file.
pub(crate) fn refuse(path: &Path, place: impl Into<String>, what: impl Into<String>) -> Error {
    Error::Place { path: path.to_owned(), place: place.into(), what: what.into() }
}

impl Image {
    /// Pose of the image; `None` if it is not finite or has no rotation.
    pub(super) fn pose(&self) -> Option<Pose> {
        let [w, x, y, z] = self.quat;
        let length = DQuat::from_xyzw(x, y, z, w).length();
        if !(length > 1e-6 && length < 1e6) {
            return None;
        }
        let camera_from_world = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let position = -(camera_from_world.transpose() * DVec3::from(self.translation));
        position.as_vec3().is_finite().then_some(Pose { camera_from_world, position })
    }
}

impl Camera {
    /// Checks sizes and parameters; the error describes the fault.
    pub(super) fn checked(self) -> Result<Self, String> {
        if ![self.width, self.height].iter().all(|size| (1..=u64::from(EDGE_MAX)).contains(size)) {
            return Err(format!(
                "has pictures of {} by {} pixels; 1 to {EDGE_MAX} are possible",
                self.width, self.height
            ));
        }
        if !self.params.iter().all(|param| (*param as f32).is_finite()) {
            return Err("has a parameter that is not finite; reconstruct again".into());
        }
        if !self.lens().focal_px.iter().all(|focal| *focal as f32 > 0.0) {
            return Err("has an impossible focal length; it must be above 0".into());
        }
        Ok(self)
    }

    /// Focal lengths, principal point and distortion of any model.
    pub(super) fn lens(&self) -> Lens {
        let p = |k: usize| self.params[k];
        let one_focal = [0, 2, 3, 8, 9].contains(&self.model.number);
        let (focal_px, rest) = if one_focal { ([p(0), p(0)], 1) } else { ([p(0), p(1)], 2) };
        let (width, height) = (self.width as u32, self.height as u32);
        let principal_px = [p(rest), p(rest + 1)];
        let k = |index: usize| self.params.get(rest + 2 + index).copied().unwrap_or(0.0);
        Lens { focal_px, principal_px, width, height, distortion: distortion_of(self.model, k).simplified() }
    }
}

/// Distortion of a model whose coefficients begin with `k(0)`.
fn distortion_of(model: &Kind, k: impl Fn(usize) -> f64) -> Distortion {
    let polynomial = |radial, tangential| Distortion::Polynomial { radial, tangential };
    let fisheye = |radial, tangential, prism| Distortion::Fisheye { radial, tangential, prism };
    match model.name {
        "SIMPLE_RADIAL" | "RADIAL" => polynomial([k(0), k(1), 0.0, 0.0, 0.0, 0.0], [0.0; 2]),
        "OPENCV" => polynomial([k(0), k(1), 0.0, 0.0, 0.0, 0.0], [k(2), k(3)]),
        "FULL_OPENCV" => polynomial([k(0), k(1), k(4), k(5), k(6), k(7)], [k(2), k(3)]),
        "FOV" => Distortion::FieldOfView { omega: k(0) },
        "OPENCV_FISHEYE" => fisheye([k(0), k(1), k(2), k(3)], [0.0; 2], [0.0; 2]),
        "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => fisheye([k(0), k(1), 0.0, 0.0], [0.0; 2], [0.0; 2]),
        "THIN_PRISM_FISHEYE" => fisheye([k(0), k(1), k(4), k(5)], [k(2), k(3)], [k(6), k(7)]),
        _ => Distortion::None,
    }
}
