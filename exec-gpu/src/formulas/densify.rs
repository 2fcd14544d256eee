//! Formulas of densification.

use super::{Planes, flat, planes_field};
use crate::formula::{Field, Formula, Inputs, field};
use specula_core::{
    activation::sigmoid,
    densify::{grad_length, largest_scale, mean_grad, part_log_scales, part_mean},
    morton::cell,
    real::Real,
    scene::{LOG_SCALE, Layout, MEAN, OPACITY},
};

/// Length of a projected centre's gradient ([`specula_core::densify::grad_length`]).
#[derive(Clone, Copy, Debug)]
pub struct GradLength;

impl Formula for GradLength {
    fn name(&self) -> String {
        "grad_length".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("grad", 2), field("half_size", 2)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("length", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        vec![grad_length(inputs.array(), inputs.array())]
    }
}

/// What decides over a Gaussian ([`specula_core::densify::decide`]).
#[derive(Clone, Copy, Debug)]
pub struct MeasuresOf {
    /// What planes there are.
    pub layout: Layout,
}

impl Formula for MeasuresOf {
    fn name(&self) -> String {
        "measures_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![planes_field(self.layout), field("grad_sum", 1), field("view_count", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("mean_grad", 1), field("opacity", 1), field("largest_scale", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.layout.plane_count()));
        let mean_grad = mean_grad(inputs.number(), inputs.number());
        vec![mean_grad, sigmoid(planes.at(OPACITY)), largest_scale(planes.vec3(LOG_SCALE))]
    }
}

/// The cell of a coordinate between two bounds ([`specula_core::morton::cell`]).
#[derive(Clone, Copy, Debug)]
pub struct CellAt;

impl Formula for CellAt {
    fn name(&self) -> String {
        "cell_at".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("x", 1), field("low", 1), field("high", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("cell", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        vec![cell(inputs.number(), inputs.number(), inputs.number())]
    }
}

/// One part of a split Gaussian ([`specula_core::densify::part_mean`], [`specula_core::densify::part_log_scales`]).
#[derive(Clone, Copy, Debug)]
pub struct PartOf {
    /// What planes there are.
    pub layout: Layout,
}

impl Formula for PartOf {
    fn name(&self) -> String {
        "part_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![planes_field(self.layout), field("noise", 3)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("mean", 3), field("log_scales", 3)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.layout.plane_count()));
        let (log_scales, noise) = (planes.vec3(LOG_SCALE), inputs.vec3());
        let mean = part_mean(planes.vec3(MEAN), log_scales, planes.quat(), noise);
        [flat(mean), flat(part_log_scales(log_scales))].concat()
    }
}
