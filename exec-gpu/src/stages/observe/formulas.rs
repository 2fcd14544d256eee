//! Statistics of densification.

use crate::codegen::formula::formula;
use specula_core::densify::grad_length;

/// Length of a projected centre's gradient ([`specula_core::densify::grad_length`]).
#[derive(Clone, Copy, Debug)]
pub struct GradLength;

formula!(GradLength, |_, inputs| grad_length(grad: 2, half_size: 2) -> (length: 1) {
    [grad_length(inputs.array(), inputs.array())]
});
