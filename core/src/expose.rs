//! Exposure of photographs: an affine map of colours for each, so the scene has a single
//! appearance.
//!
//! The photograph shows C' = A C + (1 − T) b, where C is its premultiplied colour and T the
//! transmittance: the scene is mapped, the background behind it is not. This equals a scene whose
//! Gaussians have the colours A c + b, and empty pixels are unchanged.

use crate::{
    real::Real,
    vector::{Vec3, vec3},
};

/// The rows of \[A | b\]: what red, green and blue become, from red, green, blue and one.
pub type Exposure<R> = [[R; 4]; 3];

/// Exposure that keeps colours unchanged.
pub const IDENTITY: Exposure<f32> = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// A C + a b: a premultiplied colour C with coverage a = 1 − T in \[0, 1\], as in a photograph with
/// this exposure.
#[inline(always)]
pub fn expose<R: Real>(exposure: &Exposure<R>, color: Vec3<R>, coverage: R) -> Vec3<R> {
    let row = |[red, green, blue, offset]: [R; 4]| red * color.x + green * color.y + blue * color.z + offset * coverage;
    vec3(row(exposure[0]), row(exposure[1]), row(exposure[2]))
}

/// Gradient of [`expose`] with respect to the exposure, the colour and the coverage: g Cᵀ and a g,
/// Aᵀ g, and b · g.
#[inline(always)]
pub fn expose_vjp<R: Real>(
    exposure: &Exposure<R>,
    color: Vec3<R>,
    coverage: R,
    grad: Vec3<R>,
) -> (Exposure<R>, Vec3<R>, R) {
    let grad_row = |grad: R| [grad * color.x, grad * color.y, grad * color.z, grad * coverage];
    let column = |k: usize| vec3(exposure[0][k], exposure[1][k], exposure[2][k]).dot(grad);
    ([grad_row(grad.x), grad_row(grad.y), grad_row(grad.z)], vec3(column(0), column(1), column(2)), column(3))
}
