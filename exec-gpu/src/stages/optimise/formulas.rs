//! Adam's step of a number.

use crate::codegen::formula::formula;
use specula_core::optimise::{Moment, adam};

/// One step of Adam ([`specula_core::optimise::adam`]).
#[derive(Clone, Copy, Debug)]
pub struct AdamStep;

formula!(AdamStep, |_, inputs| adam_step(
    value: 1, mean: 1, square: 1, grad: 1, rate: 1, epsilon: 1
) -> (value: 1, mean: 1, square: 1) {
    let [value, mean, square, grad, rate, epsilon] = inputs.array();
    let next = adam(Moment { value, mean, square }, grad, rate, epsilon);
    [next.value, next.mean, next.square]
});
