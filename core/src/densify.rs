//! Which Gaussians are cloned, split or removed (Kerbl et al. 2023, section 5.2).

use crate::{
    covariance::{Quat, rotation},
    random,
    vector::{Vec3, vec3},
};

/// Thresholds of densification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensifyRules {
    /// Mean gradient of the projected centre, in normalised device coordinates, from which a Gaussian is refined.
    pub grad_min: f32,
    /// Scale, in world units, above which a Gaussian is split rather than cloned.
    pub split_scale: f32,
    /// Opacity below which a Gaussian is removed.
    pub opacity_min: f32,
    /// Scale, in world units, above which a Gaussian is removed; infinite for never.
    pub scale_max: f32,
}

/// What happens to a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// It stays.
    Keep,
    /// A copy joins it.
    Clone,
    /// Two smaller ones take its place.
    Split,
    /// It goes.
    Prune,
}

/// Scales of the two parts of a split Gaussian are those of the whole divided by this (0.8 · 2, INRIA's value).
pub const SPLIT_SHRINK: f32 = 1.6;

/// What to do with a Gaussian of this mean gradient, opacity and largest scale. Anything that is not a number goes.
pub fn decide(rules: &DensifyRules, mean_grad: f32, opacity: f32, scale_max: f32) -> Action {
    if !(opacity >= rules.opacity_min && scale_max <= rules.scale_max) {
        Action::Prune
    } else if !(mean_grad >= rules.grad_min) {
        Action::Keep
    } else if scale_max > rules.split_scale {
        Action::Split
    } else {
        Action::Clone
    }
}

/// Centre of one part of a split Gaussian: drawn from the Gaussian itself, μ + R (s ⊙ ξ).
pub fn split_mean(mean: Vec3<f32>, scales: Vec3<f32>, quat: Quat<f32>, seed: u64, stream: u64, draw: u64) -> Vec3<f32> {
    let noise = |axis: u64| random::normal(seed, stream, 3 * draw + axis);
    mean + rotation(quat).transform(vec3(noise(0), noise(1), noise(2)).times(scales))
}
