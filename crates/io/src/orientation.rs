//! Scene orientation as `specula.json` records it: up direction, centre and viewing distance.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Largest deviation of a unit up direction from length 1.
const UNIT_TOLERANCE: f64 = 1e-4;

/// Up direction, centre and viewing distance of a scene in world space, and the evidence for them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Orientation {
    /// Up direction, a unit vector.
    pub up: [f64; 3],
    /// Point that the cameras look at.
    pub centre: [f64; 3],
    /// Median distance of the cameras from the centre, above 0.
    pub distance: f64,
    /// Source of the up direction.
    #[serde(rename = "told_by")]
    pub up_source: UpSource,
    /// Number of cameras.
    pub cameras: usize,
    /// Number of their pictures that lie on their side or upside down.
    pub rolled: usize,
    /// Standard error of the up direction in degrees; `None` if the pictures do not determine it.
    pub error_degrees: Option<f64>,
}

/// Source of a scene's up direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpSource {
    /// Level pictures, most of them upright.
    Upright,
    /// Level pictures of cameras that look down.
    Height,
    /// Level pictures only: the sum of their up directions determines the sign.
    Level,
    /// Mean up direction of the pictures: too few or too similar cameras for a fit.
    Mean,
    /// No common up direction: the reverse of the common view direction, or else +z.
    Nothing,
    /// The user.
    Hand,
    /// A file of Gaussians.
    File,
}

impl Orientation {
    /// Returns whether `up` is a unit vector, the centre is finite and the distance positive.
    pub fn is_valid(&self) -> bool {
        let is_unit = (DVec3::from(self.up).length() - 1.0).abs() < UNIT_TOLERANCE;
        is_unit && DVec3::from(self.centre).is_finite() && self.distance > 0.0 && self.distance.is_finite()
    }
}
