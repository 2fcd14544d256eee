//! Normals of the geometry, from the rendered depth (the paper's Sobel-like operator).

use crate::{
    camera::CameraOf,
    real::Real,
    vector::{Vec3, normalize_or, normalize_or_vjp, vec3},
};

/// Coverage below which a pixel has no surface.
pub const SURFACE_COVERAGE: f32 = 0.5;

/// Mask of pixels with enough coverage for a surface.
#[inline(always)]
pub fn is_surface<R: Real>(coverage: R) -> R::Mask {
    coverage.constant(SURFACE_COVERAGE).less(coverage)
}

/// Expected depth of a pixel from its blended depth Σ w z and its coverage A = Σ w: their quotient.
/// Callers skip pixels of small coverage.
#[inline(always)]
pub fn expected_depth<R: Real>(blended_depth: R, coverage: R) -> R {
    blended_depth / coverage
}

/// Gradient of [`expected_depth`] with respect to both, from its value.
#[inline(always)]
pub fn expected_depth_vjp<R: Real>(depth: R, coverage: R, grad: R) -> (R, R) {
    let grad_blended = grad / coverage;
    (grad_blended, -grad_blended * depth)
}

/// Values at the four neighbours of a pixel, such as depths.
#[derive(Clone, Copy, Debug)]
pub struct Cross<T> {
    /// At x − 1.
    pub left: T,
    /// At x + 1.
    pub right: T,
    /// At y − 1.
    pub above: T,
    /// At y + 1.
    pub below: T,
}

/// Weight of a pixel's normal: its coverage if it and its neighbours have a surface, else zero.
#[inline(always)]
pub fn surface_weight<R: Real>(coverage: R, around: &Cross<R>) -> R {
    let least = coverage.min(around.left.min(around.right)).min(around.above.min(around.below));
    coverage.keep(is_surface(least))
}

/// Camera-space rays through the neighbours of the pixel with this centre, with z = 1.
#[inline(always)]
pub fn rays_around<R: Real>(camera: &CameraOf<R>, x_px: R, y_px: R) -> Cross<Vec3<R>> {
    Cross {
        left: ray_through(camera, x_px - 1.0, y_px),
        right: ray_through(camera, x_px + 1.0, y_px),
        above: ray_through(camera, x_px, y_px - 1.0),
        below: ray_through(camera, x_px, y_px + 1.0),
    }
}

/// Camera-space ray through a point of the picture, with z = 1.
#[inline(always)]
fn ray_through<R: Real>(camera: &CameraOf<R>, x_px: R, y_px: R) -> Vec3<R> {
    let across = (x_px - camera.principal_px[0]) / camera.focal_px[0];
    let down = (y_px - camera.principal_px[1]) / camera.focal_px[1];
    vec3(across, down, x_px.constant(1.0))
}

/// Unit normal in camera space, towards the camera, of the surface through four neighbours:
/// (P_right − P_left) × (P_above − P_below), P = ray · depth. Zero if the surface has no extent.
#[inline(always)]
pub fn normal<R: Real>(rays: &Cross<Vec3<R>>, depths: &Cross<R>) -> Vec3<R> {
    let (across, up) = edges(rays, depths);
    normalize_or(across.cross(up), Vec3::zero(depths.left))
}

/// Gradient of [`normal`] with respect to the four depths.
#[inline(always)]
pub fn normal_vjp<R: Real>(rays: &Cross<Vec3<R>>, depths: &Cross<R>, grad: Vec3<R>) -> Cross<R> {
    let (across, up) = edges(rays, depths);
    let grad = normalize_or_vjp(across.cross(up), grad);
    let (grad_across, grad_up) = (up.cross(grad), grad.cross(across));
    Cross {
        left: -grad_across.dot(rays.left),
        right: grad_across.dot(rays.right),
        above: grad_up.dot(rays.above),
        below: -grad_up.dot(rays.below),
    }
}

#[inline(always)]
fn edges<R: Real>(rays: &Cross<Vec3<R>>, depths: &Cross<R>) -> (Vec3<R>, Vec3<R>) {
    (rays.right * depths.right - rays.left * depths.left, rays.above * depths.above - rays.below * depths.below)
}
