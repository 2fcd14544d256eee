//! Radiance of an environment's numbers: the activation of the light, and its gradient.

use crate::{math, real::Real, scene::RadianceActivation};

/// Radiance of one stored number: the number itself, or e to its power.
///
/// The exponential is [`Real::exp_wide`], which has the range of a light: e⁻¹⁰⁴ is zero in `f32`.
#[inline(always)]
pub fn radiance<R: Real>(activation: RadianceActivation, number: R) -> R {
    match activation {
        RadianceActivation::Identity => number,
        RadianceActivation::Exponential => number.exp_wide(),
    }
}

/// Gradient of [`radiance`] with respect to the number, from its value.
#[inline(always)]
pub fn radiance_vjp<R: Real>(activation: RadianceActivation, radiance: R, grad: R) -> R {
    match activation {
        RadianceActivation::Identity => grad,
        RadianceActivation::Exponential => grad * radiance,
    }
}

/// Stored number of a radiance: the inverse of [`radiance`]. Positive radiance only, where the
/// activation is exponential.
pub fn number_of(activation: RadianceActivation, radiance: f32) -> f32 {
    match activation {
        RadianceActivation::Identity => radiance,
        RadianceActivation::Exponential => math::ln(radiance),
    }
}
