//! GGX lobes: weight of light from one direction in the reflection along another.

use crate::{math, real::Real, vector::Vec3};

/// Weight of light from `light_dir` in a lobe around `reflection_dir`; in (0, 1].
///
/// Walter et al. 2007, eq. 33, at the half vector of the two and divided by its peak 1/(π α²): `K =
/// 1 / (c² + (s/α)²)²`, with c and s the cosine and sine of half the angle between the directions
/// and α = `alpha_ggx`. The peak cancels in the weighted mean that uses K, so nothing overflows as
/// α → 0.
///
/// Directions are unit vectors, `alpha_ggx` is in (0, 1]. Equal directions weigh 1 at every
/// roughness; opposite ones weigh α⁴.
#[inline(always)]
pub fn lobe_weight<R: Real>(reflection_dir: Vec3<R>, light_dir: Vec3<R>, alpha_ggx: R) -> R {
    let q = lobe_falloff(reflection_dir, light_dir, alpha_ggx);
    (q * q).recip()
}

/// Gradient of [`lobe_weight`] with respect to `reflection_dir`.
#[inline(always)]
pub fn lobe_weight_vjp<R: Real>(reflection_dir: Vec3<R>, light_dir: Vec3<R>, alpha_ggx: R, grad_weight: R) -> Vec3<R> {
    let q = lobe_falloff(reflection_dir, light_dir, alpha_ggx);
    let grad_q = grad_weight / (q * q * q) * -2.0;

    let together = light_dir + reflection_dir;
    let apart = light_dir - reflection_dir;
    (together - apart / (alpha_ggx * alpha_ggx)) * (grad_q * 0.5)
}

/// c² + (s/α)², from the sum and the difference of the directions: exact to rounding even where the
/// arc cosine of their dot product has lost every digit.
#[inline(always)]
fn lobe_falloff<R: Real>(reflection_dir: Vec3<R>, light_dir: Vec3<R>, alpha_ggx: R) -> R {
    let together = light_dir + reflection_dir;
    let apart = light_dir - reflection_dir;
    (together.length_squared() + apart.length_squared() / (alpha_ggx * alpha_ggx)) * 0.25
}

/// max(cos, 0) of the angle between two unit vectors, from their sum and difference.
#[inline(always)]
pub fn cosine<R: Real>(a: Vec3<R>, b: Vec3<R>) -> R {
    (((a + b).length_squared() - (a - b).length_squared()) * 0.25).max(a.x.zero())
}

/// Angle from the lobe's axis, in radians, within which the share `energy` of the lobe's half
/// vectors reflects light.
///
/// ∫ D cos θ_h up to θ_h is tan²θ_h / (α² + tan²θ_h); the light's angle is twice the half vector's,
/// at most 90°.
pub fn energy_angle(alpha_ggx: f64, energy: f64) -> f64 {
    let half_angle = math::atan64(alpha_ggx * math::sqrt64(energy / (1.0 - energy)));
    (2.0 * half_angle).min(core::f64::consts::FRAC_PI_2)
}

/// Microfacet density D(θ_h) = α² / (π ((α² − 1) cos²θ_h + 1)²) in the textbook's form, from the
/// cosine. Exact only for α² well above the rounding of 1: the authors' prefilter uses it,
/// specula's uses [`lobe_weight`].
pub fn distribution(cos_half: f64, alpha_ggx: f64) -> f64 {
    let a2 = alpha_ggx * alpha_ggx;
    let q = cos_half * cos_half * (a2 - 1.0) + 1.0;
    a2 / (core::f64::consts::PI * q * q)
}
