//! How long kernels take, where an adapter tells (timestamp queries).

use crate::{
    device::{Gpu, GpuError},
    executor::GpuExecutor,
    memory::read,
};
use std::collections::BTreeMap;
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, ComputePassTimestampWrites, Features, QuerySet,
    QuerySetDescriptor, QueryType,
};

/// Passes that are timed before commands have to be submitted.
const PASSES_MAX: usize = 1024;
/// Bytes of a timestamp.
const STAMP: u64 = 8;

/// How long a kernel took, all its runs together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KernelTime {
    /// How often it ran.
    pub runs: usize,
    /// Seconds on the device.
    pub seconds: f64,
}

/// Times passes.
#[derive(Debug)]
pub(crate) struct Stopwatch {
    queries: QuerySet,
    stamps: Buffer,
    /// The kernels of the passes since the last submission.
    passes: Vec<&'static str>,
    times: BTreeMap<&'static str, KernelTime>,
}

impl Stopwatch {
    /// A stopwatch, if the device has the feature.
    pub(crate) fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(Features::TIMESTAMP_QUERY) {
            return None;
        }
        let count = 2 * PASSES_MAX as u32;
        let queries = gpu.device.create_query_set(&QuerySetDescriptor { label: None, ty: QueryType::Timestamp, count });
        let stamps = buffer(gpu, BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC);
        Some(Self { queries, stamps, passes: Vec::new(), times: BTreeMap::new() })
    }

    /// Whether no further pass can be timed before commands are submitted.
    pub(crate) fn is_full(&self) -> bool {
        self.passes.len() == PASSES_MAX
    }

    /// Where the next pass, of this kernel, notes its times.
    pub(crate) fn next_pass(&mut self, entry: &'static str) -> ComputePassTimestampWrites<'_> {
        let first = 2 * self.passes.len() as u32;
        self.passes.push(entry);
        ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Records that times are to be read, at the end of commands.
    pub(crate) fn stop(&self, gpu: &Gpu, encoder: &mut CommandEncoder) -> Buffer {
        let staging = buffer(gpu, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
        encoder.resolve_query_set(&self.queries, 0..2 * self.passes.len() as u32, &self.stamps, 0);
        encoder.copy_buffer_to_buffer(&self.stamps, 0, &staging, 0, Some(2 * STAMP * self.passes.len() as u64));
        staging
    }

    /// Adds the times of what was submitted. Waits for the device.
    pub(crate) fn note(&mut self, gpu: &Gpu, staging: &Buffer) -> Result<(), GpuError> {
        let seconds = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
        let passes = core::mem::take(&mut self.passes);
        read(gpu, staging, |bytes| {
            let stamps = bytes.as_chunks::<{ STAMP as usize }>().0.iter().map(|stamp| u64::from_le_bytes(*stamp));
            let stamps: Vec<u64> = stamps.collect();
            for (entry, stamps) in passes.into_iter().zip(stamps.chunks_exact(2)) {
                let time = self.times.entry(entry).or_default();
                time.runs += 1;
                time.seconds += stamps[1].saturating_sub(stamps[0]) as f64 * seconds;
            }
        })
    }

    fn take(&mut self) -> Vec<(&'static str, KernelTime)> {
        core::mem::take(&mut self.times).into_iter().collect()
    }
}

fn buffer(gpu: &Gpu, usage: BufferUsages) -> Buffer {
    let size = 2 * STAMP * PASSES_MAX as u64;
    gpu.device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

impl GpuExecutor {
    /// Times kernels from now on, or no longer; says whether it can be done. Every submission then waits for its end, so
    /// that whole stages are slower than else.
    pub fn watch_kernels(&mut self, is_watched: bool) -> bool {
        let stopwatch = if is_watched { Stopwatch::new(&self.machine.gpu) } else { None };
        let can = stopwatch.is_some() || !is_watched;
        self.machine.kernels.stopwatch = stopwatch;
        can
    }

    /// What kernels have taken since they are watched, or since the last call, by their names.
    pub fn kernel_times(&mut self) -> Result<Vec<(&'static str, KernelTime)>, GpuError> {
        self.machine.kernels.submit(&self.machine.gpu)?;
        Ok(self.machine.kernels.stopwatch.as_mut().map_or_else(Vec::new, Stopwatch::take))
    }

    /// Waits until everything that was asked of the device is done.
    pub fn finish(&mut self) -> Result<(), GpuError> {
        self.machine.finish()
    }
}
