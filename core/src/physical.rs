//! Physical materials: albedo, metalness and roughness, lit pixel by pixel.
//!
//! A Gaussian of albedo a and metalness m has the diffuse albedo a (1 − m) and the reflectance at
//! normal incidence F₀ = 0.04 (1 − m) + a m, the dielectrics' and that of metals (Burley 2012,
//! "Physically Based Shading at Disney"). Both are blended, with normals and roughness, and a pixel
//! is shaded by the split sum (Karis 2013, "Real Shading in Unreal Engine 4"):
//!
//! ```text
//! C = A · γ((1 − 0.04 F_x − F_y) D/A ⊙ E(n)/π + (F/A F_x + F_y) ⊙ L_s(r, P/A))
//! ```
//!
//! with the premultiplied sums A of coverage, D of diffuse albedos times ambient transfers, F of
//! reflectances and P of roughness, the irradiance E along the unit normal n, and the table (F_x,
//! F_y) of [`mod@crate::split_sum`] at n·v and P/A. The scale of the light is absolute: a
//! dielectric reflects 4 % of it. The factor 1 − 0.04 F_x − F_y is the light that a dielectric's
//! surface transmits to the diffuse layer: no surface reflects more than it receives, and a white
//! dielectric reflects all of it.
//!
//! The ambient transfer of a Gaussian is the unoccluded share of the irradiance along its normal,
//! plus the light reflected by other surfaces: 1 without occlusion. It is not optimised; rays
//! against the scene's surface determine it.

use crate::{
    color::{srgb_color, srgb_color_vjp},
    real::Real,
    shade::N_DOT_V_MIN,
    shade_pixels::{Pixel, PixelSurface, pixel_normal},
    vector::{Vec3, normalize_or_vjp},
};

/// Reflectance of dielectrics at normal incidence: a refractive index of 1.5.
pub const DIELECTRIC: f32 = 0.04;

/// Shares of the specular colour in all light that leaves a Gaussian, between which [`metal_share`]
/// rises from 0 to 1. Below 1, because uniform light makes a part of each metal look diffuse.
const SPECULAR_SHARES: [f32; 2] = [0.12, 0.3];

/// Reflectances between which [`metal_share`] rises: no metal is nearly black.
const METAL_REFLECTANCES: [f32; 2] = [0.1, 0.3];

/// Radiance that keeps divisors positive without light.
const NO_LIGHT: f32 = 1e-6;

/// Share of metal, 0 to 1, that the view-dependent colours of a Gaussian suggest.
///
/// Metals have no diffuse colour, and are no darker than a few tenths. With a specular tint S and a
/// diffuse colour D, both linear and means over red, green and blue, under a light of mean radiance
/// L̄, the share is smoothstep of S L̄ / (S L̄ + D) from 0.12 to 0.3, times that of S + D / L̄ from
/// 0.1 to 0.3: independent of the brightness of the light. 0 without light.
#[inline(always)]
pub fn metal_share<R: Real>(tint: Vec3<R>, diffuse: Vec3<R>, mean_light: R) -> R {
    let specular = tint.sum() * mean_light * (1.0 / 3.0);
    let leaving = specular + diffuse.sum() * (1.0 / 3.0);
    let share = specular / (leaving + NO_LIGHT);
    let reflectance = leaving / (mean_light + NO_LIGHT);
    smoothstep(share, SPECULAR_SHARES) * smoothstep(reflectance, METAL_REFLECTANCES)
}

/// Rises smoothly from 0 to 1 between two numbers: 3t² − 2t³.
#[inline(always)]
fn smoothstep<R: Real>(x: R, [low, high]: [f32; 2]) -> R {
    let t = ((x + -low) * (1.0 / (high - low))).clamp(0.0, 1.0);
    t * t * (t * -2.0 + 3.0)
}

/// Diffuse albedo and reflectance at normal incidence of a material.
#[inline(always)]
pub fn reflectances<R: Real>(albedo: Vec3<R>, metalness: R) -> [Vec3<R>; 2] {
    let dielectric = -metalness + 1.0;
    [albedo * dielectric, albedo * metalness + Vec3::splat(dielectric * DIELECTRIC)]
}

/// Gradient of [`reflectances`] with respect to albedo and metalness.
#[inline(always)]
pub fn reflectances_vjp<R: Real>(albedo: Vec3<R>, metalness: R, [diffuse, f0]: [Vec3<R>; 2]) -> (Vec3<R>, R) {
    let grad_metalness = (f0 - diffuse).dot(albedo) - f0.sum() * DIELECTRIC;
    (diffuse * (-metalness + 1.0) + f0 * metalness, grad_metalness)
}

/// Orientation of a pixel's surface. Also the shape of its gradient.
#[derive(Clone, Copy, Debug)]
pub struct PixelFacing<R> {
    /// Unit normal.
    pub normal: Vec3<R>,
    /// n·v, at least [`N_DOT_V_MIN`].
    pub n_dot_v: R,
}

/// Orientation of a pixel that is seen along −`view_dir`.
#[inline(always)]
pub fn pixel_facing<R: Real>(pixel: &Pixel<R>, view_dir: Vec3<R>) -> PixelFacing<R> {
    let normal = pixel_normal(pixel, view_dir);
    PixelFacing { normal, n_dot_v: view_dir.dot(normal).max(pixel.coverage.constant(N_DOT_V_MIN)) }
}

/// Gradient of [`pixel_facing`] with respect to the blended normal.
#[inline(always)]
pub fn pixel_facing_vjp<R: Real>(pixel: &Pixel<R>, view_dir: Vec3<R>, grad: &PixelFacing<R>) -> Vec3<R> {
    let is_open = pixel.coverage.constant(N_DOT_V_MIN).less(view_dir.dot(pixel_normal(pixel, view_dir)));
    normalize_or_vjp(pixel.normal, grad.normal.add_scaled(grad.n_dot_v.keep(is_open), view_dir))
}

/// Incident light of a pixel's surface. Also the shape of its gradient.
#[derive(Clone, Copy, Debug)]
pub struct PixelLight<R> {
    /// Prefiltered radiance along the reflected direction.
    pub specular: Vec3<R>,
    /// Irradiance / π along the normal.
    pub irradiance: Vec3<R>,
    /// (F_x, F_y) of the split-sum table.
    pub split_sum: [R; 2],
}

/// Light that leaves a pixel's surface, linear, in its diffuse and its specular part. The base of
/// the surface is the diffuse albedo, its tint F₀.
#[inline(always)]
pub fn reflected<R: Real>(surface: &PixelSurface<R>, light: &PixelLight<R>) -> [Vec3<R>; 2] {
    let diffuse = surface.base.times(light.irradiance) * transmitted(light.split_sum);
    [diffuse, reflectance(surface, light).times(light.specular)]
}

/// The colour of a pixel: sRGB-encoded, premultiplied.
#[inline(always)]
pub fn pixel_color<R: Real>(surface: &PixelSurface<R>, light: &PixelLight<R>, coverage: R) -> Vec3<R> {
    let [diffuse, specular] = reflected(surface, light);
    srgb_color(diffuse + specular) * coverage
}

/// Gradient of [`pixel_color`]: with respect to the surface (it does not depend on roughness and
/// reflection), the light and the coverage.
#[inline(always)]
pub fn pixel_color_vjp<R: Real>(
    surface: &PixelSurface<R>,
    light: &PixelLight<R>,
    coverage: R,
    grad: Vec3<R>,
) -> (PixelSurface<R>, PixelLight<R>, R) {
    let [diffuse, specular] = reflected(surface, light);
    let linear = diffuse + specular;
    let srgb = srgb_color(linear);
    let grad_linear = srgb_color_vjp(linear, srgb, grad * coverage);
    let by_light = grad_linear.times(light.specular);
    let by_diffuse = grad_linear * transmitted(light.split_sum);
    let grad_transmitted = grad_linear.dot(surface.base.times(light.irradiance));
    let grad_surface = PixelSurface {
        base: by_diffuse.times(light.irradiance),
        tint: by_light * light.split_sum[0],
        roughness: coverage.zero(),
        reflection_dir: Vec3::zero(coverage),
    };
    let grad_light = PixelLight {
        specular: grad_linear.times(reflectance(surface, light)),
        irradiance: by_diffuse.times(surface.base),
        split_sum: [by_light.dot(surface.tint) - grad_transmitted * DIELECTRIC, by_light.sum() - grad_transmitted],
    };
    (grad_surface, grad_light, grad.dot(srgb))
}

/// Share of the light that a dielectric does not reflect at its surface: 1 − 0.04 F_x − F_y.
#[inline(always)]
fn transmitted<R: Real>([scale, bias]: [R; 2]) -> R {
    -(scale * DIELECTRIC + bias) + 1.0
}

/// F₀ F_x + F_y.
#[inline(always)]
fn reflectance<R: Real>(surface: &PixelSurface<R>, light: &PixelLight<R>) -> Vec3<R> {
    surface.tint * light.split_sum[0] + Vec3::splat(light.split_sum[1])
}
