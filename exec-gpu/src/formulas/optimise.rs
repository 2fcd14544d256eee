//! The optimiser's step.

use crate::formula::{Field, Formula, Inputs, field};
use specula_core::{
    optimise::{Moment, adam},
    real::Real,
};

/// One step of Adam ([`specula_core::optimise::adam`]).
#[derive(Clone, Copy, Debug)]
pub struct AdamStep;

impl Formula for AdamStep {
    fn name(&self) -> String {
        "adam_step".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        ["value", "mean", "square", "grad", "rate", "epsilon"].map(|name| field(name, 1)).to_vec()
    }
    fn results(&self) -> Vec<Field> {
        ["value", "mean", "square"].map(|name| field(name, 1)).to_vec()
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let [value, mean, square, grad, rate, epsilon] = inputs.array();
        let next = adam(Moment { value, mean, square }, grad, rate, epsilon);
        vec![next.value, next.mean, next.square]
    }
}
