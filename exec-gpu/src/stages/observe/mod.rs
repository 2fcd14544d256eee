//! Statistics of densification: the gradients of projected centres.

use crate::{
    codegen::source::Source,
    device::{
        chunks::ChunkedArray,
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
    },
    stages::{
        blend_vjp::{SplatGrads, formulas::GEOMETRY},
        camera::{CameraUniform, camera},
        project::{Splats, splat},
        step_counters::{StepCounters, step_counters},
    },
};
use formulas::GradLength;
use specula_core::{camera::Camera, state::Statistics};

pub mod formulas;

pub(crate) fn source(channels: usize) -> String {
    let source = Source::new().part(camera).part(splat).part(step_counters).bits().formula(&GradLength);
    source.count("GRAD_PLANES", GEOMETRY + channels).with(include_str!("observe.wgsl")).text()
}

/// Adds the length of the gradient of each projected centre, if it is finite and the Gaussian is
/// drawn.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn observe(
    context: &mut Context,
    counters: &StepCounters,
    statistics: &mut Statistics<ChunkedArray>,
    splats: &Splats,
    grads: &SplatGrads,
    camera: &Camera,
) -> Result<(), GpuError> {
    let channels = grads.channels;
    let (key, source) = (channels.to_string(), || source(channels));
    for chunk in grads.values.chunks(splats.count) {
        let view = CameraUniform::with_range(camera, chunk.gaussians.clone());
        let bindings = [
            Uniform(view.bytes()),
            Buffer(&splats.splats),
            Buffer(chunk.array),
            Buffer(statistics.grad_sum.whole()),
            Buffer(statistics.view_count.whole()),
            Buffer(counters.array()),
        ];
        context.dispatch(&key, "observe", &source, &bindings, Dispatch::Invocations(chunk.gaussians.len()))?;
    }
    Ok(())
}
