//! Kernel sets: a stage may have one kernel for hardware and another for software drivers.

use crate::device::gpu::Gpu;

/// Choice between the variants of kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KernelSet {
    /// Few invocations, each with much work: a software driver runs them in turn, and barriers and
    /// reads are expensive.
    Software,
    /// Many invocations, which share their reads and hide each other's latencies.
    Hardware,
}

impl KernelSet {
    /// Both sets.
    pub const ALL: [Self; 2] = [Self::Software, Self::Hardware];

    /// Set for a device, by its kind.
    pub fn of(gpu: &Gpu) -> Self {
        if gpu.is_software() { Self::Software } else { Self::Hardware }
    }
}
