//! Adam.

use crate::{
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    pieces::Pieces,
    source,
};
use bytemuck::{Pod, Zeroable};
use specula_core::{
    optimise::{corrected_epsilon, corrected_rate},
    scene::{Environment, Gaussians, RadianceActivation},
    state::AdamMoments,
};

/// `StepSize` of `optimise.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct StepSize {
    count: u32,
    planes: u32,
    epsilon: f32,
    is_limited: u32,
    value_max: f32,
    padding: [u32; 3],
}

pub(crate) fn optimise(
    machine: &mut Machine,
    gaussians: &mut Gaussians<Pieces>,
    moments: &mut AdamMoments<Pieces>,
    grad: &Gaussians<Pieces>,
    rates: &[f32],
    step: u32,
) -> Result<(), GpuError> {
    adam(machine, &gaussians.values, moments, &grad.values, &Pace { rates, step, value_max: None })
}

pub(crate) fn optimise_environment(
    machine: &mut Machine,
    environment: &mut Environment<Pieces>,
    moments: &mut AdamMoments<Pieces>,
    grad: &Pieces,
    rate: f32,
    radiance_max: f32,
    step: u32,
) -> Result<(), GpuError> {
    let value_max = (environment.activation == RadianceActivation::Identity).then_some(radiance_max);
    adam(machine, &environment.values, moments, grad, &Pace { rates: &[rate], step, value_max })
}

/// How far a step goes.
struct Pace<'a> {
    /// Learning rate of every plane.
    rates: &'a [f32],
    /// Number of the step, from 1.
    step: u32,
    /// Where values stay between zero and a limit, the limit.
    value_max: Option<f32>,
}

fn adam(
    machine: &mut Machine,
    values: &Pieces,
    moments: &mut AdamMoments<Pieces>,
    grad: &Pieces,
    pace: &Pace<'_>,
) -> Result<(), GpuError> {
    let rates: Vec<f32> = pace.rates.iter().map(|rate| corrected_rate(*rate, pace.step)).collect();
    let rates = machine.upload("learning rates", &rates)?;
    let ledger = machine.ledger.clone();
    let size = StepSize {
        count: 0,
        planes: pace.rates.len() as u32,
        epsilon: corrected_epsilon(pace.step),
        is_limited: u32::from(pace.value_max.is_some()),
        value_max: pace.value_max.unwrap_or_default(),
        padding: [0; 3],
    };
    for [grad, values, mean, square] in Pieces::side_by_side([grad, values, &moments.mean, &moments.square]) {
        let size = StepSize { count: values.len() as u32, ..size };
        let bound = [
            Uniform(bytemuck::bytes_of(&size)),
            Of(&rates),
            Of(grad),
            Of(values),
            Of(mean),
            Of(square),
            Of(ledger.array()),
        ];
        machine.run("optimise", "optimise", &source::optimise, &bound, Groups::For(values.len()))?;
    }
    Ok(())
}
