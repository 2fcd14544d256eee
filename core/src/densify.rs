//! Cloning, splitting and pruning of Gaussians (Kerbl et al. 2023, section 5.2).

use crate::{
    covariance::{Quat, rotation, scales},
    cutoffs::ALPHA_MIN,
    each, random,
    real::Real,
    vector::Vec3,
};

/// Thresholds of densification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensifyRules<R = f32> {
    /// Mean gradient of the projected centre, in normalised device coordinates, from which a
    /// Gaussian is refined.
    pub grad_min: R,
    /// Scale, in world units, above which a Gaussian is split rather than cloned.
    pub split_scale: R,
    /// Opacity below which a Gaussian is removed.
    pub opacity_min: R,
    /// Scale, in world units, above which a Gaussian is removed; infinite for never.
    pub scale_max: R,
}

impl DensifyRules {
    /// Removal of Gaussians that are invisible at the default cutoffs: their opacity, which bounds
    /// alpha in every pixel, is below [`ALPHA_MIN`]. The sparsity loss lowers it further and no
    /// pixel raises it, so they never become visible again.
    pub const INVISIBLE: Self =
        Self { grad_min: f32::INFINITY, split_scale: f32::INFINITY, opacity_min: ALPHA_MIN, scale_max: f32::INFINITY };
}

/// Action of densification on a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Keeps the Gaussian.
    Keep,
    /// Adds a copy.
    Clone,
    /// Replaces the Gaussian by two smaller ones.
    Split,
    /// Removes the Gaussian.
    Prune,
}

impl Action {
    /// All actions, in the order of their numbers.
    pub const ALL: [Self; 4] = [Self::Keep, Self::Clone, Self::Split, Self::Prune];
}

/// Scales of the two parts of a split Gaussian are those of the whole divided by this (0.8 · 2,
/// INRIA's value).
pub const SPLIT_SHRINK: f32 = 1.6;

/// Number of the [`Action`] on a Gaussian of this mean gradient, opacity and largest scale (Kerbl
/// et al. 2023, section 5.2). A Gaussian with a NaN measure is removed, or kept if only the
/// gradient is NaN.
#[inline(always)]
pub fn decide<R: Real>(rules: &DensifyRules<R>, mean_grad: R, opacity: R, scale: R) -> R {
    let stays = rules.opacity_min.less_or_equal(opacity) & scale.less_or_equal(rules.scale_max);
    let grows = rules.grad_min.less_or_equal(mean_grad);
    let is_large = rules.split_scale.less(scale);
    let [keep, clone, split, prune] = Action::ALL.map(|action| scale.constant(action as u8 as f32));
    R::select(stays, R::select(grows, R::select(is_large, split, clone), keep), prune)
}

/// Action on one Gaussian; see [`decide`].
pub fn action(rules: &DensifyRules, mean_grad: f32, opacity: f32, scale: f32) -> Action {
    Action::ALL[decide(rules, mean_grad, opacity, scale) as usize]
}

/// Length of the gradient of a projected centre, from pixels to normalised device coordinates;
/// `half_size` is half the width and height of the picture.
#[inline(always)]
pub fn grad_length<R: Real>(grad: [R; 2], half_size: [R; 2]) -> R {
    let (x, y) = (grad[0] * half_size[0], grad[1] * half_size[1]);
    x.mul_add(x, y * y).sqrt()
}

/// Mean over the counted views of a Gaussian; zero for none.
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

/// Three normally distributed numbers, the displacement of a child of a split Gaussian.
pub fn split_noise(seed: u64, stream: u64, draw: u64) -> [f32; 3] {
    let noise = |axis: u64| random::normal(seed, stream, 3 * draw + axis);
    [noise(0), noise(1), noise(2)]
}

/// Centre of one child of a split Gaussian: drawn from the Gaussian itself, μ + R (s ⊙ ξ), with
/// [`split_noise`] for ξ.
#[inline(always)]
pub fn split_mean<R: Real>(mean: Vec3<R>, log_scales: Vec3<R>, quat: Quat<R>, noise: Vec3<R>) -> Vec3<R> {
    mean + rotation(quat).transform(noise.times(scales(log_scales)))
}

/// Logarithms of a split child's scales: those of the parent less ln [`SPLIT_SHRINK`].
#[inline(always)]
pub fn split_log_scales<R: Real>(log_scales: Vec3<R>) -> Vec3<R> {
    let log_shrink = crate::math::ln(SPLIT_SHRINK);
    each!(log_scales, x => x - log_shrink)
}
