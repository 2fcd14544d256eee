//! Optimiser step: Adam.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        chunks::ChunkedArray,
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
    },
    stages::step_counters::{StepCounters, step_counters},
};
use formulas::AdamStep;
use specula_core::{
    optimise::{GRAD_MAX, corrected_epsilon, corrected_rate},
    scene::{Environment, Gaussians, RadianceActivation},
    state::AdamMoments,
};

pub mod formulas;

pub(crate) fn source() -> String {
    let source = Source::new().real().formula(&AdamStep).part(step_counters);
    source
        .count("GRAD_MAX_BITS", GRAD_MAX.to_bits() as usize)
        .uniform::<StepSize>()
        .with(include_str!("optimise.wgsl"))
        .text()
}

uniform! {
    /// Numbers that a step changes, and its limits.
    struct StepSize {
        count: u32,
        /// Planes of a block; a rate for each.
        planes: u32,
        epsilon: f32,
        /// 1 if values stay between zero and `value_max`.
        is_limited: u32,
        value_max: f32,
    }
}

/// Updates Gaussians and their moments.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn optimise(
    context: &mut Context,
    counters: &StepCounters,
    gaussians: &mut Gaussians<ChunkedArray>,
    moments: &mut AdamMoments<ChunkedArray>,
    grad: &Gaussians<ChunkedArray>,
    rates: &[f32],
    step: u32,
) -> Result<(), GpuError> {
    adam(context, counters, &gaussians.values, moments, &grad.values, &Rates { rates, step, value_max: None })
}

/// Updates an environment and its moments.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn optimise_environment(
    context: &mut Context,
    counters: &StepCounters,
    environment: &mut Environment<ChunkedArray>,
    moments: &mut AdamMoments<ChunkedArray>,
    grad: &ChunkedArray,
    rate: f32,
    radiance_max: f32,
    step: u32,
) -> Result<(), GpuError> {
    let value_max = (environment.activation == RadianceActivation::Identity).then_some(radiance_max);
    adam(context, counters, &environment.values, moments, grad, &Rates { rates: &[rate], step, value_max })
}

/// Sizes of a step.
struct Rates<'a> {
    /// Learning rate of every plane.
    rates: &'a [f32],
    /// Number of the step, from 1.
    step: u32,
    /// Upper bound of values that are clamped to [0, `value_max`]; `None` for no clamping.
    value_max: Option<f32>,
}

fn adam(
    context: &mut Context,
    counters: &StepCounters,
    values: &ChunkedArray,
    moments: &mut AdamMoments<ChunkedArray>,
    grad: &ChunkedArray,
    rates: &Rates<'_>,
) -> Result<(), GpuError> {
    let corrected: Vec<f32> = rates.rates.iter().map(|rate| corrected_rate(*rate, rates.step)).collect();
    let corrected = context.upload("learning rates", &corrected)?;
    let size = StepSize {
        count: 0,
        planes: rates.rates.len() as u32,
        epsilon: corrected_epsilon(rates.step),
        is_limited: u32::from(rates.value_max.is_some()),
        value_max: rates.value_max.unwrap_or_default(),
    };
    for [grad, values, mean, square] in ChunkedArray::side_by_side([grad, values, &moments.mean, &moments.square]) {
        let size = StepSize { count: values.len() as u32, ..size };
        let bindings = [
            Uniform(size.bytes()),
            Buffer(&corrected),
            Buffer(grad),
            Buffer(values),
            Buffer(mean),
            Buffer(square),
            Buffer(counters.array()),
        ];
        context.dispatch("optimise", "optimise", &source, &bindings, Dispatch::Invocations(values.len()))?;
    }
    Ok(())
}
