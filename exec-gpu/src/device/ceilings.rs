//! Peak rates of a device, for comparison with its stages.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
        timer::KernelTimer,
    },
};

/// Numbers to copy: a quarter of a gigabyte, larger than any cache.
const NUMBERS: usize = 1 << 26;
/// Invocations of multiply-adds, enough to occupy a large device.
const INVOCATIONS: usize = 1 << 20;
/// Multiply-adds of an invocation in a step.
const SUMS: usize = 16;
/// Shortest valid run of a measurement, in seconds.
const SECONDS_MIN: f64 = 5e-3;
/// Largest number of steps.
const STEPS_MAX: usize = 1 << 16;
/// Repetitions; the fastest counts.
const RUNS: usize = 5;

/// Peak rates of a device, per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ceilings {
    /// Bytes read and written by a copy, both counted.
    pub bytes: f64,
    /// Operations in registers, two for each multiply-add.
    pub operations: f64,
}

uniform! {
    /// Work of a measurement.
    struct Rounds {
        /// Vectors that are copied, or invocations that multiply.
        count: u32,
        /// Multiply-adds of each sum.
        steps: u32,
    }
}

fn source() -> String {
    Source::new().uniform::<Rounds>().with(include_str!("ceilings.wgsl")).text()
}

/// Measures the peak rates; `None` if kernels cannot be timed. Discards the durations of kernels so
/// far, and ends their timing.
///
/// # Errors
///
/// Errors of allocation and of the device.
pub(crate) fn measure(context: &mut Context) -> Result<Option<Ceilings>, GpuError> {
    context.recorder.timer = KernelTimer::new(&context.gpu);
    if context.recorder.timer.is_none() {
        return Ok(None);
    }
    let measured = measure_timed(context);
    context.recorder.timer = None;
    measured.map(Some)
}

fn measure_timed(context: &mut Context) -> Result<Ceilings, GpuError> {
    let len = NUMBERS.min((context.gpu.binding_max() / 4) as usize) / 4 * 4;
    let arrays = [context.zeros("numbers", len)?, context.allocate("numbers", len)?];
    let copy = fastest(context, "copy_numbers", &arrays, [len / 4, 0])?;
    let invocations = INVOCATIONS.min(len / 4);
    let mut steps = 64;
    let mut multiply = fastest(context, "multiply_add", &arrays, [invocations, steps])?;
    while multiply < SECONDS_MIN && steps < STEPS_MAX {
        steps *= 4;
        multiply = fastest(context, "multiply_add", &arrays, [invocations, steps])?;
    }
    let operations = (2 * SUMS * steps * invocations) as f64;
    Ok(Ceilings { bytes: (2 * size_of::<f32>() * len) as f64 / copy, operations: operations / multiply })
}

/// Seconds of the fastest of [`RUNS`] runs.
fn fastest(
    context: &mut Context,
    entry: &'static str,
    arrays: &[Array; 2],
    rounds: [usize; 2],
) -> Result<f64, GpuError> {
    let [count, steps] = rounds.map(|number| number as u32);
    let settings = Rounds { count, steps };
    let bindings = [Uniform(settings.bytes()), Buffer(&arrays[0]), Buffer(&arrays[1])];
    let mut fastest = f64::INFINITY;
    for _ in 0..RUNS {
        context.dispatch("ceilings", entry, &source, &bindings, Dispatch::Invocations(rounds[0]))?;
        let seconds = context.kernel_times()?.iter().map(|(_, time)| time.seconds).sum();
        fastest = fastest.min(seconds);
    }
    Ok(fastest)
}
