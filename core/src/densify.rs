//! Which Gaussians are cloned, split or removed (Kerbl et al. 2023, section 5.2).

use crate::{
    covariance::{Quat, rotation, scales},
    each, random,
    real::Real,
    vector::Vec3,
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

/// Length of the gradient of a projected centre, from pixels to normalised device coordinates; `half_size` is half the
/// width and height of the picture.
#[inline(always)]
pub fn grad_length<R: Real>(grad: [R; 2], half_size: [R; 2]) -> R {
    let (x, y) = (grad[0] * half_size[0], grad[1] * half_size[1]);
    x.mul_add(x, y * y).sqrt()
}

/// Mean over the views that saw a Gaussian; zero for none.
#[inline(always)]
pub fn mean_grad<R: Real>(grad_sum: R, view_count: R) -> R {
    grad_sum / view_count.max(view_count.constant(1.0))
}

/// The largest of a Gaussian's scales.
#[inline(always)]
pub fn largest_scale<R: Real>(log_scales: Vec3<R>) -> R {
    let scales = scales(log_scales);
    scales.x.max(scales.y).max(scales.z)
}

/// Three numbers from the normal distribution, by which one part of a split Gaussian moves.
pub fn part_noise(seed: u64, stream: u64, draw: u64) -> [f32; 3] {
    let noise = |axis: u64| random::normal(seed, stream, 3 * draw + axis);
    [noise(0), noise(1), noise(2)]
}

/// Centre of one part of a split Gaussian: drawn from the Gaussian itself, μ + R (s ⊙ ξ), with [`part_noise`] for ξ.
#[inline(always)]
pub fn part_mean<R: Real>(mean: Vec3<R>, log_scales: Vec3<R>, quat: Quat<R>, noise: Vec3<R>) -> Vec3<R> {
    mean + rotation(quat).transform(noise.times(scales(log_scales)))
}

/// Logarithms of a part's scales: those of the whole, divided by [`SPLIT_SHRINK`].
#[inline(always)]
pub fn part_log_scales<R: Real>(log_scales: Vec3<R>) -> Vec3<R> {
    let log_shrink = crate::math::ln(SPLIT_SHRINK);
    each!(log_scales, x => x - log_shrink)
}
