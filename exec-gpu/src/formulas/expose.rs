//! What a photograph makes of the scene's colours, and the way back.

use super::flat;
use crate::formula::{Field, Formula, Inputs, field, variable};
use specula_core::{
    expose::{Exposure, expose, expose_vjp},
    real::Real,
};

/// The variable `exposure` of a shader, row by row, and what of the scene is seen in a pixel.
fn exposure_and_pixel() -> Vec<Field> {
    vec![
        variable("exposure.red", 4),
        variable("exposure.green", 4),
        variable("exposure.blue", 4),
        field("color", 3),
        field("passed", 1),
    ]
}

fn take_exposure<R: Real>(inputs: &mut Inputs<'_, R>) -> Exposure<R> {
    [inputs.array(), inputs.array(), inputs.array()]
}

/// The colour of a pixel in a photograph ([`specula_core::expose::expose`]).
#[derive(Clone, Copy, Debug)]
pub struct Expose;

impl Formula for Expose {
    fn name(&self) -> String {
        "expose_pixel".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        exposure_and_pixel()
    }
    fn results(&self) -> Vec<Field> {
        vec![field("color", 3)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (exposure, color, passed) = (take_exposure(inputs), inputs.vec3(), inputs.number());
        flat(expose(&exposure, color, -passed + 1.0)).to_vec()
    }
}

/// Gradient of [`Expose`] ([`specula_core::expose::expose_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct ExposeVjp;

impl Formula for ExposeVjp {
    fn name(&self) -> String {
        "expose_pixel_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = exposure_and_pixel();
        fields.push(field("grad", 3));
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![field("red", 4), field("green", 4), field("blue", 4), field("color", 3), field("passed", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (exposure, color, passed) = (take_exposure(inputs), inputs.vec3(), inputs.number());
        let (own, of_color, of_coverage) = expose_vjp(&exposure, color, -passed + 1.0, inputs.vec3());
        let mut numbers = own.as_flattened().to_vec();
        numbers.extend(flat(of_color));
        numbers.push(-of_coverage);
        numbers
    }
}
