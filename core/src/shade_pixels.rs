//! Shading pixel by pixel: Gaussians blend their attributes, and the light is looked up once for
//! each pixel.
//!
//! With w_i = α_i T_i a pixel holds the premultiplied sums A = Σ w_i, B = Σ w_i (c_d + c_r)_i, N =
//! Σ w_i n_i, S = Σ w_i s_i and P = Σ w_i ρ_i. Its colour is A · γ(B/A + S/A ⊙ L_s(r, P/A)), r the
//! view direction mirrored at N/|N|: the paper's shading function of a mean surface (deferred
//! shading; Ye et al. 2024, "3D Gaussian Splatting with Deferred Reflection"). Like
//! [`mod@crate::shade`] it runs in steps, because the light in between is read from memory.
//!
//! The mean normal of a pixel is smoother than those of its Gaussians, and its gradient reaches all
//! of them. Neighbours therefore agree on one surface instead of painting reflections behind it.

use crate::{
    color::{srgb_color, srgb_color_vjp},
    real::Real,
    shade::{reflect, reflect_vjp},
    vector::{Vec3, normalize_or, normalize_or_vjp},
};

/// Lower bound of the coverage that sums are divided by; a splat that is drawn covers more.
pub const COVERAGE_MIN: f32 = 1e-3;

/// Surface attributes blended into a pixel, premultiplied.
#[derive(Clone, Copy, Debug)]
pub struct Pixel<R> {
    /// Diffuse and residual colour, linear.
    pub base: Vec3<R>,
    /// Normal.
    pub normal: Vec3<R>,
    /// Specular tint.
    pub tint: Vec3<R>,
    /// Perceptual roughness.
    pub roughness: R,
    /// Coverage A, 1 − transmittance.
    pub coverage: R,
}

/// The mean surface of a pixel. Also the shape of its gradient.
#[derive(Clone, Copy, Debug)]
pub struct PixelSurface<R> {
    /// Diffuse and residual colour, linear.
    pub base: Vec3<R>,
    /// Specular tint.
    pub tint: Vec3<R>,
    /// Perceptual roughness.
    pub roughness: R,
    /// The view direction, mirrored at the unit normal.
    pub reflection_dir: Vec3<R>,
}

/// The mean surface of a pixel that is seen along −`view_dir`, a unit vector to the eye. A pixel
/// whose normals cancel is taken to face the eye.
#[inline(always)]
pub fn pixel_surface<R: Real>(pixel: &Pixel<R>, view_dir: Vec3<R>) -> PixelSurface<R> {
    let per_coverage = per_coverage(pixel.coverage);
    PixelSurface {
        base: pixel.base * per_coverage,
        tint: pixel.tint * per_coverage,
        roughness: pixel.roughness * per_coverage,
        reflection_dir: reflect(view_dir, pixel_normal(pixel, view_dir)),
    }
}

/// Unit normal of a pixel; the direction to the eye, where normals cancel.
#[inline(always)]
pub(crate) fn pixel_normal<R: Real>(pixel: &Pixel<R>, view_dir: Vec3<R>) -> Vec3<R> {
    normalize_or(pixel.normal, view_dir)
}

/// Gradient of [`pixel_surface`] with respect to the pixel.
#[inline(always)]
pub fn pixel_surface_vjp<R: Real>(
    pixel: &Pixel<R>,
    view_dir: Vec3<R>,
    surface: &PixelSurface<R>,
    grad: &PixelSurface<R>,
) -> Pixel<R> {
    let per_coverage = per_coverage(pixel.coverage);
    let (_, grad_unit) = reflect_vjp(view_dir, pixel_normal(pixel, view_dir), grad.reflection_dir);
    let by_means = grad.base.dot(surface.base) + grad.tint.dot(surface.tint) + grad.roughness * surface.roughness;
    let is_free = pixel.coverage.constant(COVERAGE_MIN).less(pixel.coverage);
    Pixel {
        base: grad.base * per_coverage,
        normal: normalize_or_vjp(pixel.normal, grad_unit),
        tint: grad.tint * per_coverage,
        roughness: grad.roughness * per_coverage,
        coverage: (-(by_means * per_coverage)).keep(is_free),
    }
}

/// Factor that turns a premultiplied sum into a mean over what covers the pixel.
#[inline(always)]
pub(crate) fn per_coverage<R: Real>(coverage: R) -> R {
    coverage.max(coverage.constant(COVERAGE_MIN)).recip()
}

/// The colour of a pixel under `light`, the prefiltered radiance along its reflection:
/// sRGB-encoded, premultiplied.
#[inline(always)]
pub fn pixel_color<R: Real>(surface: &PixelSurface<R>, light: Vec3<R>, coverage: R) -> Vec3<R> {
    srgb_color(surface.base + surface.tint.times(light)) * coverage
}

/// [`pixel_color`] without any light, from only the premultiplied base; the same to the last bit.
#[inline(always)]
pub fn unlit_pixel_color<R: Real>(base: Vec3<R>, coverage: R) -> Vec3<R> {
    srgb_color(base * per_coverage(coverage)) * coverage
}

/// Gradient of [`pixel_color`]: with respect to the surface, whose reflection it does not depend
/// on; to the light; to the coverage.
#[inline(always)]
pub fn pixel_color_vjp<R: Real>(
    surface: &PixelSurface<R>,
    light: Vec3<R>,
    coverage: R,
    grad: Vec3<R>,
) -> (PixelSurface<R>, Vec3<R>, R) {
    let linear = surface.base + surface.tint.times(light);
    let srgb = srgb_color(linear);
    let grad_linear = srgb_color_vjp(linear, srgb, grad * coverage);
    let grad_surface = PixelSurface {
        base: grad_linear,
        tint: grad_linear.times(light),
        roughness: coverage.zero(),
        reflection_dir: Vec3::zero(coverage),
    };
    (grad_surface, grad_linear.times(surface.tint), grad.dot(srgb))
}
