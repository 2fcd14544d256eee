//! Statistics of densification.

use crate::codegen::formula::formula;
use specula_core::{bin::touches_picture, densify::grad_length};

/// Length of a projected centre's gradient ([`specula_core::densify::grad_length`]).
#[derive(Clone, Copy, Debug)]
pub struct GradLength;

formula!(GradLength, |_, inputs| grad_length(grad: 2, half_size: 2) -> (length: 1) {
    [grad_length(inputs.array(), inputs.array())]
});

/// One for splats whose box touches the picture ([`specula_core::bin::touches_picture`]), zero for
/// others.
#[derive(Clone, Copy, Debug)]
pub struct TouchesPicture;

formula!(TouchesPicture, |_, inputs| touches_picture(center: 2, half_extent: 2, size: 2) -> (touches: 1) {
    let (center, half_extent) = (inputs.array(), inputs.array());
    let touches = touches_picture(center, half_extent, inputs.array());
    [center[0].constant(1.0).keep(touches)]
});
