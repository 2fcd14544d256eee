//! Columns of a table: measures, conditions and sizes of runs.

use crate::{
    comparison::run::{CONDITIONS, Run},
    evaluation::RELIT,
    light,
    measure::{
        ALBEDO_PSNR, LPIPS, MAE, MAE_WEIGHTED, MEASURES, METALNESS_ERROR, Measure, PSNR, PSNR_FITTED, ROUGHNESS_ERROR,
    },
};
use specula_scene::number::group_digits;

/// Correlation of the learned light with the true one.
const LIGHT_CORRELATION: Measure =
    Measure { name: light::CORRELATION, label: "light correlation", unit: "", decimals: 3, higher_is_better: true };

/// Quantity of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    /// Measure with this index in [`MEASURES`].
    Measure(usize),
    /// PSNR under other lights by the protocol with this index in [`RELIT`].
    Relit(usize),
    /// Correlation of the learned light with the true one.
    LightCorrelation,
    /// Radiance of the learned light relative to the true one.
    LightScale,
    /// Condition of the training with this index in [`CONDITIONS`]; shown only if unequal.
    Condition(usize),
    /// Number of Gaussians.
    Gaussians,
    /// Time of the training in seconds.
    Seconds,
    /// Size in megabytes.
    Size,
}

impl Quantity {
    /// Every quantity, in the order of columns.
    pub(super) fn all() -> impl Iterator<Item = Self> {
        let measures = (0..MEASURES.len()).map(Self::Measure);
        let relit = (0..RELIT.len()).map(Self::Relit);
        let light = [Self::LightCorrelation, Self::LightScale];
        let conditions = (0..CONDITIONS.len()).map(Self::Condition);
        measures.chain(relit).chain(light).chain(conditions).chain([Self::Gaussians, Self::Seconds, Self::Size])
    }

    /// Value of a run; none if unknown.
    pub(super) fn value(self, run: &Run) -> Option<f64> {
        match self {
            Self::Measure(index) => run.measured[index],
            Self::Relit(index) => run.relit[index],
            Self::LightCorrelation => run.light_correlation,
            Self::LightScale => run.light_scale,
            Self::Condition(index) => run.conditions[index],
            Self::Gaussians => run.gaussians,
            Self::Seconds => run.seconds,
            Self::Size => run.megabytes,
        }
    }

    /// Format and direction of quality; none for quantities without better values.
    pub(super) fn measure(self) -> Option<Measure> {
        match self {
            Self::Measure(index) => Some(MEASURES[index]),
            Self::Relit(index) => Some(Measure { label: RELIT[index].label, ..MEASURES[PSNR] }),
            Self::LightCorrelation => Some(LIGHT_CORRELATION),
            Self::LightScale | Self::Condition(_) | Self::Gaussians | Self::Seconds | Self::Size => None,
        }
    }

    /// Label and unit.
    pub(super) fn label(self) -> (&'static str, &'static str) {
        match self {
            Self::Condition(index) => (CONDITIONS[index].label, ""),
            Self::Gaussians => ("Gaussians", ""),
            Self::Seconds => ("training", "s"),
            Self::Size => ("size", "MB"),
            Self::LightScale => ("light scale", ""),
            Self::Measure(_) | Self::Relit(_) | Self::LightCorrelation => {
                self.measure().map_or(("", ""), |measure| (measure.label, measure.unit.trim()))
            }
        }
    }

    /// Value as text.
    pub(super) fn format(self, value: f64) -> String {
        match self.measure() {
            Some(measure) => measure.format(value),
            None if self == Self::Size => format!("{value:.1}"),
            None if self == Self::LightScale => format!("{value:.3}"),
            None => group_digits(value.round() as usize),
        }
    }

    /// True if a table has a column for the quantity.
    pub(super) fn is_shown(self, runs: &[Run]) -> bool {
        let is_known = runs.iter().any(|run| self.value(run).is_some());
        let first = |run: &Run| runs.iter().find(|first| first.scene == run.scene);
        let is_unequal = || runs.iter().any(|run| first(run).is_some_and(|first| self.differs(first, run)));
        is_known && (!matches!(self, Self::Condition(_)) || is_unequal())
    }

    /// Whether the quantity compares runs: two of them have it, of one scene if a scene has
    /// several.
    pub(super) fn compares(self, runs: &[Run]) -> bool {
        let known = |scene: Option<&str>| {
            let wanted = runs.iter().filter(|run| scene.is_none_or(|scene| run.scene == scene));
            wanted.filter(|run| self.value(run).is_some()).count()
        };
        let of_scene = |scene: &str| runs.iter().filter(|run| run.scene == scene).count();
        match runs.iter().any(|run| of_scene(&run.scene) > 1) {
            true => runs.iter().any(|run| known(Some(&run.scene)) > 1),
            false => known(None) > 1,
        }
    }

    /// Whether two runs have different values; false if one is unknown.
    pub(super) fn differs(self, one: &Run, other: &Run) -> bool {
        matches!([self.value(one), self.value(other)], [Some(a), Some(b)] if a != b)
    }

    /// True if a run lacks a measure that could be computed: another run has it, of the same scene
    /// if it needs ground truth of normals or other lights.
    pub(super) fn is_missing(self, run: &Run, runs: &[Run]) -> bool {
        let is_measurable = match self {
            Self::Relit(index) => run.is_shaded && index == 0,
            Self::Measure(ALBEDO_PSNR) | Self::LightCorrelation => run.is_physical,
            // They are computed with the albedo and the correlation.
            Self::Measure(ROUGHNESS_ERROR | METALNESS_ERROR) | Self::LightScale => false,
            Self::Measure(_) => true,
            Self::Condition(_) | Self::Gaussians | Self::Seconds | Self::Size => false,
        };
        let needs_truth =
            matches!(self, Self::Measure(MAE | MAE_WEIGHTED | ALBEDO_PSNR) | Self::Relit(_) | Self::LightCorrelation);
        let mut others = runs.iter().filter(|other| !needs_truth || other.scene == run.scene);
        self.value(run).is_none() && is_measurable && others.any(|other| self.value(other).is_some())
    }

    /// Kind of measurement that computes it.
    pub(super) fn measurement(self) -> Measurement {
        match self {
            Self::Measure(LPIPS) => Measurement::Lpips,
            Self::Measure(PSNR_FITTED) => Measurement::FittedExposure,
            _ => Measurement::Standard,
        }
    }
}

/// Kind of measurement that computes a missing measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measurement {
    /// Measurement without further input.
    Standard,
    /// Measurement with a network for LPIPS.
    Lpips,
    /// Measurement after the exposure that fits each view.
    FittedExposure,
}
