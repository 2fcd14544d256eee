//! Order of the splats in a pixel.
//!
//! 3DGS sorts the splats of a tile by the depth of their means, once for all its pixels. Along the
//! ray t d of a pixel, d = (x, y, 1) in camera space, a Gaussian with the mean μ and the covariance
//! Σ acts where its response is largest, at the depth
//!
//! ```text
//! t* = dᵀ Σ⁻¹ μ / dᵀ Σ⁻¹ d = z u / (u² + κ |W δ|²),    u = max(1 + l·δ, 0)
//! ```
//!
//! (Radl et al. 2024, StopThePop), where z is the depth of the mean and l, κ, W and δ are those of
//! [`crate::perspective`]: its q is 1/κ − (dᵀ Σ⁻¹ μ)² / dᵀ Σ⁻¹ d, and dᵀ Σ⁻¹ μ is u / (z κ). A
//! response with its maximum behind the eye is evaluated at the eye. t* does not depend on the
//! projection model: an affine splat is also sorted along the ray.

use crate::{
    camera::CameraOf,
    cutoffs::ProjectionModel,
    perspective::{perspective, ray_scale},
    project::{Shape, project},
    real::Real,
};

/// Depth of a Gaussian's largest response as a function of the pixel.
#[derive(Clone, Copy, Debug)]
pub struct ResponseDepth<R> {
    /// Image of the mean, in pixels.
    pub mean2d: [R; 2],
    /// l, in 1/px.
    pub slope: [R; 2],
    /// √κ W: (xx, yx, yy), in 1/px.
    pub root: [R; 3],
    /// Depth of the mean.
    pub depth: R,
}

/// Smallest squared length of a ray in standard deviations, relative to that through the mean; it
/// prevents 0 / 0 along rays on which a response vanishes in 32 bits.
const LENGTH_MIN: f32 = 1e-30;
/// Bound of the rounding of 1 + l·δ relative to its terms, and of depths, in 32 bits.
const SCALE_MARGIN: f32 = 4e-6;
const DEPTH_MARGIN: f32 = 2e-5;

/// Depth of the largest response of a Gaussian; unspecified for one that is not drawn.
#[inline(always)]
pub fn response_depth<R: Real>(shape: &Shape<R>, camera: &CameraOf<R>) -> ResponseDepth<R> {
    let camera = camera.for_projection(ProjectionModel::Ray);
    let splat = project(shape, &camera);
    let exact = perspective(ProjectionModel::Ray, shape, &splat, &camera);
    let nearness = exact.curvature.sqrt();
    ResponseDepth {
        mean2d: splat.mean2d,
        slope: exact.slope,
        root: splat.root_conic.map(|entry| entry * nearness),
        depth: splat.depth,
    }
}

impl<R: Real> ResponseDepth<R> {
    /// t* at an offset from the image of the mean, in pixels; `f32::MAX` for NaN.
    #[inline(always)]
    pub fn at(&self, [dx, dy]: [R; 2]) -> R {
        let [xx, yx, yy] = self.root;
        let (u, w) = (xx * dx, yx.mul_add(dx, yy * dy));
        let depth = self.along(ray_scale(dx.constant(1.0), self.slope, [dx, dy]), u.mul_add(u, w * w));
        depth.min(dx.constant(f32::MAX))
    }
    /// t* from 1 + l·δ and κ |W δ|².
    #[inline(always)]
    fn along(&self, ray_scale: R, squared: R) -> R {
        let scale = ray_scale.max(ray_scale.zero());
        self.depth * scale / (scale.mul_add(scale, squared) + LENGTH_MIN)
    }
    /// Lower bound of t* in a box of offsets, including its rounding to `f32`: t* decreases with |W
    /// δ| and has no minimum between two values of u. Zero if a number is not finite.
    #[inline(always)]
    pub fn least(&self, dx: [R; 2], dy: [R; 2]) -> R {
        let ([lx, ly], [xx, yx, yy]) = (self.slope, self.root);
        let farthest = |[low, high]: [R; 2]| low.abs().max(high.abs());
        let (x, y) = (farthest(dx), farthest(dy));
        let (u, w) = (xx * x, yx.abs().mul_add(x, yy * y));
        let squared = u.mul_add(u, w * w);
        let margin = lx.abs().mul_add(x, ly.abs().mul_add(y, x.constant(1.0))) * SCALE_MARGIN;
        let low = (lx * dx[0]).min(lx * dx[1]) + (ly * dy[0]).min(ly * dy[1]) + 1.0;
        let high = (lx * dx[0]).max(lx * dx[1]) + (ly * dy[0]).max(ly * dy[1]) + 1.0;
        let known = |depth: R| depth.keep(depth.less(depth.constant(f32::MAX)));
        let [near, far] = [low - margin, high + margin].map(|scale| known(self.along(scale, squared)));
        near.min(far) * (1.0 - DEPTH_MARGIN)
    }
}
