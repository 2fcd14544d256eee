//! Measured settings of rendering.

use crate::tradeoff::lamps::LampSetting;
use specula_accuracy::{
    error::Errors,
    off_axis::OffAxis,
    setting::Setting,
    sort::Sort,
    stability,
    trial::{STAGES, Spread, Work},
};

/// Setting of every parameter, with its errors, times and work.
#[derive(Clone, Debug)]
pub struct MeasuredSetting {
    /// Value of every parameter.
    pub setting: Setting,
    /// Index of the varied parameter, with all others most exact; `None` if several are varied.
    pub parameter: Option<usize>,
    /// Errors against exact pictures.
    pub errors: Errors,
    /// Milliseconds per picture of each of [`STAGES`].
    pub times: [Spread; STAGES.len()],
    /// Milliseconds of filtering the light, once.
    pub filter: f64,
    /// Counts of work.
    pub work: Work,
}

impl MeasuredSetting {
    /// Error (RMS) and minimum milliseconds per picture. The error is infinite if a number is not
    /// finite.
    pub(super) fn point(&self) -> [f64; 2] {
        let error = if self.errors.nonfinite == 0 { self.errors.rms } else { f64::INFINITY };
        [error, self.milliseconds()]
    }

    /// Minimum milliseconds per picture.
    pub(super) fn milliseconds(&self) -> f64 {
        self.times[STAGES.len() - 1].min
    }
}

/// Results of a measurement.
#[derive(Debug)]
pub struct Findings {
    /// Name of the scene.
    pub scene: String,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Number of views.
    pub views: usize,
    /// Width and height of the first view in pixels.
    pub size: [u32; 2],
    /// Repetitions of each time.
    pub repeats: u32,
    /// Default setting.
    pub default: Setting,
    /// Every setting that was measured.
    pub measured: Vec<MeasuredSetting>,
    /// Errors of one order per picture against an order per pixel.
    pub sort: Sort,
    /// Errors of projections off the optical axis.
    pub off_axis: Vec<OffAxis>,
    /// Settings of a sun's shadows; empty if the scene has no physical materials.
    pub lamps: Vec<LampSetting>,
    /// Invariants in scenes at the limits of valid input; empty if not measured.
    pub stability: Vec<stability::Row>,
}

impl Findings {
    /// The default setting as it was measured.
    pub(super) fn measured_default(&self) -> Option<&MeasuredSetting> {
        self.measured.iter().find(|measured| measured.setting == self.default)
    }
}
