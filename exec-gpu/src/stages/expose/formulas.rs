//! Exposure of a pixel.

use crate::codegen::formula::{Field, Inputs, fields, formula, variable};
use specula_core::{
    expose::{Exposure, expose},
    real::Real,
};

/// Rows of the shader's variable `exposure`, and a pixel's colour and transmittance.
pub(crate) fn exposure_and_pixel() -> Vec<Field> {
    let rows = ["exposure.red", "exposure.green", "exposure.blue"].map(|row| variable(row, 4));
    fields!(..rows, color: 3, transmittance: 1)
}

/// Reads an exposure from a formula's inputs.
pub(crate) fn take_exposure<R: Real>(inputs: &mut Inputs<'_, R>) -> Exposure<R> {
    [inputs.array(), inputs.array(), inputs.array()]
}

/// Colour of a pixel in a photograph ([`specula_core::expose::expose`]).
#[derive(Clone, Copy, Debug)]
pub struct Expose;

formula!(Expose, |_, inputs| expose_pixel(..exposure_and_pixel()) -> (color: 3) {
    let (exposure, color, transmittance) = (take_exposure(inputs), inputs.vec3(), inputs.number());
    expose(&exposure, color, -transmittance + 1.0)
});
