//! Decisions of densification, and the children of split Gaussians.

use crate::{
    codegen::formula::{formula, variable},
    stages::gaussians::{Planes, planes_field},
};
use specula_core::{
    activation::sigmoid,
    attributes::AttributePlanes,
    densify::{DensifyRules, decide, largest_scale, mean_grad, split_log_scales, split_mean},
    morton::cell,
    scene::{LOG_SCALE, Layout, MEAN, OPACITY},
};

/// Measures of a Gaussian for the decision ([`specula_core::densify::decide`]).
#[derive(Clone, Copy, Debug)]
pub struct MeasuresOf {
    /// Planes of the Gaussian.
    pub layout: Layout,
}

formula!(MeasuresOf, |this, inputs| measures_of(..planes_field(this.layout), grad_sum: 1, view_count: 1) -> (
    mean_grad: 1, opacity: 1, largest_scale: 1
) {
    let planes = Planes(inputs.slice(this.layout.plane_count()));
    let mean_grad = mean_grad(inputs.number(), inputs.number());
    [mean_grad, sigmoid(planes.number(OPACITY)), largest_scale(planes.vec3(LOG_SCALE))]
});

/// Number of the action on a Gaussian ([`specula_core::densify::decide`]).
#[derive(Clone, Copy, Debug)]
pub struct Decide;

formula!(Decide, |_, inputs| decide(
    ..["grad_min", "split_scale", "opacity_min", "scale_max"].map(|rule| variable(&format!("rules.{rule}"), 1)),
    mean_grad: 1, opacity: 1, largest_scale: 1
) -> (action: 1) {
    let [grad_min, split_scale, opacity_min, scale_max] = inputs.array();
    let rules = DensifyRules { grad_min, split_scale, opacity_min, scale_max };
    let [mean_grad, opacity, largest_scale] = inputs.array();
    [decide(&rules, mean_grad, opacity, largest_scale)]
});

/// Cell of a coordinate between two bounds ([`specula_core::morton::cell`]).
#[derive(Clone, Copy, Debug)]
pub struct CellAt;

formula!(CellAt, |_, inputs| cell_at(x: 1, low: 1, high: 1) -> (cell: 1) {
    [cell(inputs.number(), inputs.number(), inputs.number())]
});

/// Child of a split Gaussian ([`specula_core::densify::split_mean`],
/// [`specula_core::densify::split_log_scales`]).
#[derive(Clone, Copy, Debug)]
pub struct SplitChild {
    /// Planes of the Gaussian.
    pub layout: Layout,
}

formula!(SplitChild, |this, inputs| split_child(..planes_field(this.layout), noise: 3) -> (mean: 3, log_scales: 3) {
    let planes = Planes(inputs.slice(this.layout.plane_count()));
    let (log_scales, noise) = (planes.vec3(LOG_SCALE), inputs.vec3());
    let mean = split_mean(planes.vec3(MEAN), log_scales, planes.quat(), noise);
    (mean, split_log_scales(log_scales))
});
