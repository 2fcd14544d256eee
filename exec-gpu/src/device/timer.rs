//! Durations of kernels, by timestamp queries.

use crate::device::{error::GpuError, gpu::Gpu, memory::read};
use std::collections::BTreeMap;
use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, ComputePassTimestampWrites, Features, QuerySet,
    QuerySetDescriptor, QueryType,
};

/// Maximum number of timed passes in one submission.
const PASSES_MAX: usize = 1024;
/// Bytes of a timestamp.
const TIMESTAMP: u64 = 8;

/// Duration of a kernel, summed over its dispatches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KernelTime {
    /// Number of dispatches.
    pub runs: usize,
    /// Seconds on the device.
    pub seconds: f64,
}

/// Timer of compute passes.
#[derive(Debug)]
pub(crate) struct KernelTimer {
    queries: QuerySet,
    timestamps: Buffer,
    /// The kernels of the passes since the last submission.
    passes: Vec<&'static str>,
    times: BTreeMap<&'static str, KernelTime>,
}

impl KernelTimer {
    /// A timer, if the device supports timestamp queries.
    pub(crate) fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(Features::TIMESTAMP_QUERY) {
            return None;
        }
        let count = 2 * PASSES_MAX as u32;
        let queries = gpu.device.create_query_set(&QuerySetDescriptor { label: None, ty: QueryType::Timestamp, count });
        let timestamps = buffer(gpu, BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC);
        Some(Self { queries, timestamps, passes: Vec::new(), times: BTreeMap::new() })
    }

    /// True if commands must be submitted before timing another pass.
    pub(crate) fn is_full(&self) -> bool {
        self.passes.len() == PASSES_MAX
    }

    /// Timestamp writes of the next pass, a dispatch of this kernel.
    pub(crate) fn next_pass(&mut self, entry: &'static str) -> ComputePassTimestampWrites<'_> {
        let first = 2 * self.passes.len() as u32;
        self.passes.push(entry);
        ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Records the copy of all timestamps to a staging buffer, at the end of a submission.
    pub(crate) fn resolve(&self, gpu: &Gpu, encoder: &mut CommandEncoder) -> Buffer {
        let staging = buffer(gpu, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
        encoder.resolve_query_set(&self.queries, 0..2 * self.passes.len() as u32, &self.timestamps, 0);
        encoder.copy_buffer_to_buffer(&self.timestamps, 0, &staging, 0, Some(2 * TIMESTAMP * self.passes.len() as u64));
        staging
    }

    /// Adds the durations of a submission. Blocks until the device is done.
    ///
    /// # Errors
    ///
    /// A lost device.
    pub(crate) fn collect(&mut self, gpu: &Gpu, staging: &Buffer) -> Result<(), GpuError> {
        let seconds = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
        let passes = core::mem::take(&mut self.passes);
        read(gpu, staging, |bytes| {
            let timestamps =
                bytes.as_chunks::<{ TIMESTAMP as usize }>().0.iter().map(|bytes| u64::from_le_bytes(*bytes));
            let timestamps: Vec<u64> = timestamps.collect();
            for (entry, timestamps) in passes.into_iter().zip(timestamps.chunks_exact(2)) {
                let time = self.times.entry(entry).or_default();
                time.runs += 1;
                time.seconds += timestamps[1].saturating_sub(timestamps[0]) as f64 * seconds;
            }
        })
    }

    /// Durations by kernel since the last call, sorted by name.
    pub(crate) fn take(&mut self) -> Vec<(&'static str, KernelTime)> {
        core::mem::take(&mut self.times).into_iter().collect()
    }
}

fn buffer(gpu: &Gpu, usage: BufferUsages) -> Buffer {
    let size = 2 * TIMESTAMP * PASSES_MAX as u64;
    gpu.device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}
