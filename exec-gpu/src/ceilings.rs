//! What a device can do at best: the ceilings that its stages are held against.

use crate::{
    device::GpuError,
    executor::GpuExecutor,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    memory::Array,
    source,
};

/// Numbers that are copied: a quarter of a gigabyte, which no cache holds.
const NUMBERS: usize = 1 << 26;
/// Invocations that multiply, enough for every unit of a large device.
const INVOCATIONS: usize = 1 << 20;
/// Multiply-adds of an invocation in a step.
const SUMS: usize = 16;
/// A run is long enough, in seconds, when waking the device is nothing beside it.
const LONG_ENOUGH: f64 = 5e-3;
/// The most steps that are tried.
const STEPS_MAX: usize = 1 << 16;
/// Runs of which the fastest counts.
const RUNS: usize = 5;

/// What a device does in a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ceilings {
    /// Bytes read and written by a copy, both counted.
    pub bytes: f64,
    /// Operations in registers, two for each multiply-add.
    pub operations: f64,
}

impl GpuExecutor {
    /// Measures what the device can do at best; none where kernels cannot be timed. What kernels took before is
    /// forgotten, and they are not watched afterwards.
    pub fn ceilings(&mut self) -> Result<Option<Ceilings>, GpuError> {
        if !self.watch_kernels(true) {
            return Ok(None);
        }
        let measured = self.measure_ceilings();
        self.watch_kernels(false);
        measured.map(Some)
    }

    fn measure_ceilings(&mut self) -> Result<Ceilings, GpuError> {
        let len = NUMBERS.min((self.machine.gpu.binding_max() / 4) as usize) / 4 * 4;
        let arrays = [self.machine.zeros("numbers", len)?, self.machine.take("numbers", len)?];
        let copy = self.fastest("copy_numbers", &arrays, [len / 4, 0])?;
        let invocations = INVOCATIONS.min(len / 4);
        let mut steps = 64;
        let mut multiply = self.fastest("multiply_add", &arrays, [invocations, steps])?;
        while multiply < LONG_ENOUGH && steps < STEPS_MAX {
            steps *= 4;
            multiply = self.fastest("multiply_add", &arrays, [invocations, steps])?;
        }
        let operations = (2 * SUMS * steps * invocations) as f64;
        Ok(Ceilings { bytes: (2 * size_of::<f32>() * len) as f64 / copy, operations: operations / multiply })
    }

    /// Seconds of the fastest of some runs.
    fn fastest(&mut self, entry: &'static str, arrays: &[Array; 2], rounds: [usize; 2]) -> Result<f64, GpuError> {
        let settings = rounds.map(|number| number as u32);
        let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(&arrays[0]), Of(&arrays[1])];
        let mut fastest = f64::INFINITY;
        for _ in 0..RUNS {
            self.machine.run("ceilings", entry, &source::ceilings, &bound, Groups::For(rounds[0]))?;
            let seconds = self.kernel_times()?.iter().map(|(_, time)| time.seconds).sum();
            fastest = fastest.min(seconds);
        }
        Ok(fastest)
    }
}
