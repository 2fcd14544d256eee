//! Gradient of the exposure of a pixel.

use crate::{
    codegen::formula::formula,
    stages::expose::formulas::{exposure_and_pixel, take_exposure},
};
use specula_core::expose::expose_vjp;

/// Gradient of [`Expose`](crate::stages::expose::formulas::Expose)
/// ([`specula_core::expose::expose_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct ExposeVjp;

formula!(ExposeVjp, |_, inputs| expose_pixel_vjp(..exposure_and_pixel(), grad: 3) -> (
    red: 4, green: 4, blue: 4, color: 3, transmittance: 1
) {
    let (exposure, color, transmittance) = (take_exposure(inputs), inputs.vec3(), inputs.number());
    let (grad_exposure, grad_color, grad_coverage) = expose_vjp(&exposure, color, -transmittance + 1.0, inputs.vec3());
    let [red, green, blue] = grad_exposure;
    (red, green, blue, grad_color, [-grad_coverage])
});
