//! Anti-aliasing of splats (Mip-Splatting, Yu et al. 2024): a low-pass on the screen that keeps
//! brightness, and a low-pass in space at the sampling rate of the training views.
//!
//! * On the screen (section 5.2, the 2D Mip filter) the covariance Σ₂ of a splat is widened to Σ₂ +
//!   b I, and its opacity is multiplied by √(det Σ₂ / det(Σ₂ + b I)), so opacity times area is
//!   preserved: a splat much smaller than a pixel becomes faint rather than large ([`LowPass`], in
//!   [`mod@crate::project`]).
//! * In space (section 5.1, the 3D smoothing filter) the covariance Σ of a Gaussian is widened to
//!   Σ + s² I, and its opacity is multiplied by √(det Σ / det(Σ + s² I)) ([`smoothed`]). The
//!   deviation s is √0.2 times the smallest distance of two samples, depth / focal length, over the
//!   views that see the Gaussian ([`sampling_interval`]).
//!
//! The deviations are the last plane of a cloud ([`crate::scene::Layout::filter_plane`]) and have
//! no gradient. As a plane they follow their Gaussian through densification, Morton order,
//! checkpoints, uploads and files without special code. Gaussians without the plane take no
//! additional memory or time.

use crate::{
    camera::CameraOf,
    each,
    real::Real,
    vector::{Vec3, vec3},
};

/// Low-pass of splats on the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LowPass {
    /// Widened by [`BLUR`] without compensation (INRIA).
    #[default]
    Dilated,
    /// Widened by [`BLUR`], opacity compensated: `antialiased` of gsplat, `antialiasing` of INRIA.
    Compensated,
    /// Widened by [`MIP_BLUR`], opacity compensated (Mip-Splatting).
    Mip,
}

/// Variance, in px², added to splats, so none is smaller than a pixel (INRIA's low-pass).
pub const BLUR: f32 = 0.3;
/// Variance of Mip-Splatting's low-pass, in px²: about that of a pixel's box, 1/12.
pub const MIP_BLUR: f32 = 0.1;

impl LowPass {
    /// Variance b, in px².
    #[inline(always)]
    pub const fn variance(self) -> f32 {
        match self {
            Self::Dilated | Self::Compensated => BLUR,
            Self::Mip => MIP_BLUR,
        }
    }
    /// Tests whether opacity is multiplied by √(det Σ₂ / det(Σ₂ + b I)).
    #[inline(always)]
    pub const fn is_compensated(self) -> bool {
        matches!(self, Self::Compensated | Self::Mip)
    }
}

/// Smallest det Σ₂ / det(Σ₂ + b I) in the compensation. Its root, 1/1000, makes any splat too faint
/// for an 8-bit picture, and the slope of the root is finite above it.
pub const COMPENSATION_MIN: f32 = 1e-6;

/// Upper bound of the 3D filter's deviations, e^40, the limit of scales.
const DEVIATION_MAX: f32 = 2.353_852_7e17;

/// Deviation of the filter in space, as a share of the distance between two samples: √0.2.
pub const DEVIATION_SHARE: f32 = 0.447_213_6;

/// Absolute deviation s of the filter, within its limits.
#[inline(always)]
fn deviation<R: Real>(filter: R) -> R {
    filter.abs().min(filter.constant(DEVIATION_MAX))
}

/// Scales and opacity of a Gaussian under the filter in space of deviation s: √(s_k² + s²), and
/// opacity · Π s_k / √(s_k² + s²).
///
/// Exact: a Gaussian convolved with another.
#[inline(always)]
pub fn smoothed<R: Real>(scales: Vec3<R>, opacity: R, filter: R) -> (Vec3<R>, R) {
    let deviation = deviation(filter);
    let wider = widened(scales, deviation);
    (wider, opacity * share(scales, wider))
}

/// Gradient of [`smoothed`] with respect to scales and opacity; the filter has none.
#[inline(always)]
pub fn smoothed_vjp<R: Real>(
    scales: Vec3<R>,
    opacity: R,
    filter: R,
    grad_scales: Vec3<R>,
    grad_opacity: R,
) -> (Vec3<R>, R) {
    let deviation = deviation(filter);
    let wider = widened(scales, deviation);
    let share = share(scales, wider);
    let through_opacity = grad_opacity * opacity * share;
    let added = each!(wider, wider => (deviation / wider).squared());
    let grad = vec3(
        grad_scales.x * (scales.x / wider.x) + through_opacity * (added.x / scales.x),
        grad_scales.y * (scales.y / wider.y) + through_opacity * (added.y / scales.y),
        grad_scales.z * (scales.z / wider.z) + through_opacity * (added.z / scales.z),
    );
    (grad, grad_opacity * share)
}

#[inline(always)]
fn widened<R: Real>(scales: Vec3<R>, deviation: R) -> Vec3<R> {
    each!(scales, scale => scale.mul_add(scale, deviation * deviation).sqrt())
}

#[inline(always)]
fn share<R: Real>(scales: Vec3<R>, wider: Vec3<R>) -> R {
    (scales.x / wider.x) * (scales.y / wider.y) * (scales.z / wider.z)
}

/// Distances of two samples of views at a point, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplingInterval<R> {
    /// Smallest depth / focal length of the views that see the point; `f32::MAX` for none.
    pub seen: R,
    /// Smallest distance / focal length of all views: the interval of a view turned to the point.
    pub turned: R,
}

impl<R: Real> SamplingInterval<R> {
    /// Interval of no view.
    #[inline(always)]
    pub fn none(like: R) -> Self {
        Self { seen: like.constant(f32::MAX), turned: like.constant(f32::MAX) }
    }
    /// Smaller intervals of two sets of views.
    #[must_use]
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self { seen: other.seen.min(self.seen), turned: other.turned.min(self.turned) }
    }
    /// Deviation of the filter in space, [`DEVIATION_SHARE`] of the interval; an unseen point uses
    /// the smallest interval of a view turned to it.
    #[inline(always)]
    pub fn filter(self) -> R {
        let is_seen = self.seen.less(self.seen.constant(f32::MAX));
        deviation(R::select(is_seen, self.seen, self.turned) * DEVIATION_SHARE)
    }
}

/// Sampling interval of one view at a point. A view sees the range in which splats are projected
/// ([`crate::camera::SLOPE_MARGIN`]): the picture and 15 % around it, Mip-Splatting's margin,
/// beyond the near plane. The focal length is the longer of the two.
#[inline(always)]
pub fn sampling_interval<R: Real>(point: Vec3<R>, camera: &CameraOf<R>) -> SamplingInterval<R> {
    let p = camera.to_camera(point);
    let inverse_focal = camera.focal_px[0].max(camera.focal_px[1]).recip();
    let is_seen = camera.near.less(p.z)
        & p.x.abs().less(camera.slope_limit[0] * p.z)
        & p.y.abs().less(camera.slope_limit[1] * p.z);
    SamplingInterval {
        seen: R::select(is_seen, p.z * inverse_focal, p.z.constant(f32::MAX)),
        turned: p.length_squared().sqrt() * inverse_focal,
    }
}
