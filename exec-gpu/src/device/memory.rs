//! Arrays in storage buffers, their pool, and transfers between host and device.

use crate::device::{error::GpuError, gpu::Gpu};
use core::{
    future::poll_fn,
    ops::Range,
    task::{Context as TaskContext, Poll, Waker},
};
use std::sync::{Arc, Mutex, MutexGuard};
use wgpu::{Buffer, BufferAsyncError, BufferDescriptor, BufferUsages, CommandEncoder, MapMode};

/// Size classes of buffers in each power of two: arrays of a growing scene reuse buffers.
const STEPS: u64 = 4;
/// Smallest buffer, in bytes.
const BUFFER_BYTES_MIN: u64 = 256;

/// 32-bit numbers on the device. Dropping an array returns its buffer to the pool.
#[derive(Debug)]
pub struct Array {
    /// `None` only while being dropped.
    buffer: Option<Buffer>,
    len: usize,
    pool: Arc<Mutex<PoolState>>,
}

impl Array {
    /// Number of elements.
    pub fn len(&self) -> usize {
        self.len
    }
    /// Whether the array has no elements.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
    pub(crate) fn buffer(&self) -> &Buffer {
        self.buffer.as_ref().expect("an array has its buffer until it is dropped")
    }
}

impl Drop for Array {
    fn drop(&mut self) {
        if let (Some(buffer), Ok(mut pool)) = (self.buffer.take(), self.pool.lock()) {
            pool.free.push(buffer);
        }
    }
}

/// Allocator of arrays, which reuses buffers of dropped ones.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    state: Arc<Mutex<PoolState>>,
}

#[derive(Debug, Default)]
struct PoolState {
    /// Unused buffers.
    free: Vec<Buffer>,
    /// Bytes of all buffers, free and used.
    bytes: u64,
}

impl PoolState {
    /// A free buffer of this size, or a new one.
    fn take(&mut self, gpu: &Gpu, size: u64) -> Result<Buffer, GpuError> {
        if let Some(index) = self.free.iter().position(|buffer| buffer.size() == size) {
            return Ok(self.free.swap_remove(index));
        }
        let buffer = new_buffer(gpu, size)?;
        self.bytes += size;
        Ok(buffer)
    }
}

impl Pool {
    /// Allocates `len` elements with arbitrary contents; `what` names them in errors.
    ///
    /// # Errors
    ///
    /// [`GpuError::TooLarge`] beyond the device's largest binding, [`GpuError::OutOfMemory`] if
    /// allocation fails.
    pub(crate) fn allocate(&self, gpu: &Gpu, what: &'static str, len: usize) -> Result<Array, GpuError> {
        let bytes = 4 * len as u64;
        let limit = gpu.binding_max();
        if bytes > limit {
            return Err(GpuError::TooLarge { what, bytes, limit });
        }
        let size = size_class(bytes).min(limit);
        let buffer = self.state().take(gpu, size)?;
        Ok(Array { buffer: Some(buffer), len, pool: self.state.clone() })
    }

    /// Frees unused buffers.
    pub(crate) fn free_unused(&self) {
        let mut state = self.state();
        state.bytes -= state.free.drain(..).map(|buffer| buffer.size()).sum::<u64>();
    }

    /// Bytes of all buffers, used and unused.
    pub(crate) fn bytes(&self) -> u64 {
        self.state().bytes
    }

    fn state(&self) -> MutexGuard<'_, PoolState> {
        self.state.lock().expect("no thread panics while holding the pool")
    }
}

/// Creates a storage buffer, and checks at once for errors of allocation.
fn new_buffer(gpu: &Gpu, size: u64) -> Result<Buffer, GpuError> {
    let buffer = gpu.device.create_buffer(&BufferDescriptor {
        label: None,
        size,
        usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.check().map(|()| buffer)
}

/// Smallest size class of at least `bytes`.
fn size_class(bytes: u64) -> u64 {
    let bytes = bytes.max(BUFFER_BYTES_MIN);
    let step = (bytes.next_power_of_two() / 2 / STEPS).max(BUFFER_BYTES_MIN / STEPS);
    bytes.next_multiple_of(step)
}

/// Creates a buffer with these bytes.
pub(crate) fn filled(gpu: &Gpu, bytes: &[u8], usage: BufferUsages) -> Result<Buffer, GpuError> {
    let size = (bytes.len() as u64).next_multiple_of(4).max(16);
    let buffer = gpu.device.create_buffer(&BufferDescriptor { label: None, size, usage, mapped_at_creation: true });
    let mapped = buffer.get_mapped_range_mut(..);
    let mut mapped = mapped.map_err(|error| gpu.cause_of(&error))?;
    mapped.slice(..bytes.len()).copy_from_slice(bytes);
    drop(mapped);
    buffer.unmap();
    Ok(buffer)
}

/// Records a write of bytes from an element of an array on, after all commands recorded before.
pub(crate) fn write(
    gpu: &Gpu,
    encoder: &mut CommandEncoder,
    array: &Array,
    first: usize,
    bytes: &[u8],
) -> Result<(), GpuError> {
    if bytes.is_empty() {
        return Ok(());
    }
    let staging = filled(gpu, bytes, BufferUsages::COPY_SRC)?;
    encoder.copy_buffer_to_buffer(&staging, 0, array.buffer(), 4 * first as u64, Some(bytes.len() as u64));
    Ok(())
}

/// Records copies of parts of arrays, not all of them empty, to a new buffer that the host can map:
/// one part after the other.
pub(crate) fn staged(gpu: &Gpu, encoder: &mut CommandEncoder, parts: &[(&Array, Range<usize>)]) -> Buffer {
    let size_of = |part: &Range<usize>| 4 * part.len() as u64;
    let staging = gpu.device.create_buffer(&BufferDescriptor {
        label: None,
        size: parts.iter().map(|(_, part)| size_of(part)).sum(),
        usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut offset = 0;
    for (array, part) in parts.iter().filter(|(_, part)| !part.is_empty()) {
        debug_assert!(part.end <= array.len(), "the range lies in the array");
        encoder.copy_buffer_to_buffer(array.buffer(), 4 * part.start as u64, &staging, offset, Some(size_of(part)));
        offset += size_of(part);
    }
    staging
}

/// Bytes of a staging buffer, after the device is done.
///
/// # Errors
///
/// The error that the device reported, or its loss.
pub(crate) fn read_later(gpu: &Gpu, staging: Buffer) -> impl Future<Output = Result<Vec<u8>, GpuError>> + use<> {
    let (gpu, mapped) = (gpu.clone(), Arc::new(Mutex::new(Mapped::default())));
    let told = mapped.clone();
    staging.map_async(MapMode::Read, .., move |result| {
        let waker = told.lock().ok().and_then(|mut mapped| {
            mapped.result = Some(result);
            mapped.waker.take()
        });
        waker.into_iter().for_each(Waker::wake);
    });
    async move {
        let result = poll_fn(|context| mapped.lock().map_or(Poll::Pending, |mut mapped| mapped.poll(context))).await;
        gpu.check()?;
        result.map_err(|error| gpu.cause_of(&error))?;
        let view = staging.get_mapped_range(..).map_err(|error| gpu.cause_of(&error))?;
        Ok(view.to_vec())
    }
}

/// State of a buffer that is being mapped.
#[derive(Default)]
struct Mapped {
    result: Option<Result<(), BufferAsyncError>>,
    waker: Option<Waker>,
}

impl Mapped {
    fn poll(&mut self, context: &TaskContext<'_>) -> Poll<Result<(), BufferAsyncError>> {
        match self.result.take() {
            Some(result) => Poll::Ready(result),
            None => {
                self.waker = Some(context.waker().clone());
                Poll::Pending
            }
        }
    }
}

/// Passes the bytes of a staging buffer to `consume`. Blocks until the device is done.
pub(crate) fn read(gpu: &Gpu, staging: &Buffer, consume: impl FnOnce(&[u8])) -> Result<(), GpuError> {
    staging.map_async(MapMode::Read, .., |_| ());
    gpu.wait()?;
    let view = staging.get_mapped_range(..).map_err(|error| gpu.cause_of(&error))?;
    consume(&view);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Address space in KiB of a process that runs out of memory: a driver and a few arrays fit.
    const LITTLE: u64 = 6 << 20;

    #[test]
    #[ignore = "takes all memory of its process; another test runs it in a limited one"]
    fn an_array_that_does_not_fit_is_an_error_and_others_still_fit() {
        let gpu = Gpu::new("").expect("there is an adapter, or this is not run");
        let pool = Pool::default();
        let len = gpu.binding_max() as usize / 4;
        let most = (2 * LITTLE * 1024 / gpu.binding_max()) as usize;
        let taken: Vec<Result<Array, GpuError>> = (0..most).map(|_| pool.allocate(&gpu, "too much", len)).collect();
        assert!(taken[0].is_ok(), "one fits");
        let refused: Vec<&GpuError> = taken.iter().filter_map(|array| array.as_ref().err()).collect();
        assert!(refused.iter().all(|error| **error == GpuError::OutOfMemory), "{refused:?}");
        assert!(!refused.is_empty(), "{most} arrays fit where half of them should not");
        drop(taken);
        pool.free_unused();
        gpu.wait().expect("the device is still there");
        pool.allocate(&gpu, "little", 1000).expect("there is memory again");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn running_out_of_memory_does_not_panic() {
        if let Err(error) = Gpu::new("") {
            assert!(std::env::var_os("CI").is_none(), "CI needs an adapter: {error}");
            eprintln!("NOT TESTED, because {error}");
            return;
        }
        let name = "device::memory::tests::an_array_that_does_not_fit_is_an_error_and_others_still_fit";
        let script = format!("ulimit -v {LITTLE} && exec \"$0\" --ignored --exact {name}");
        let tests = std::env::current_exe().expect("this is a program");
        let output =
            std::process::Command::new("sh").args(["-c", &script]).arg(tests).output().expect("there is a shell");
        let printed = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && printed.contains("1 passed"), "{printed}");
    }

    #[test]
    fn sizes_come_in_few_steps_and_waste_a_quarter_at_most() {
        for bytes in [1_u64, 256, 257, 1000, 4096, 4097, 1_000_000, 123_456_789] {
            let size = size_class(bytes);
            assert!(size >= bytes && size.is_multiple_of(64), "{bytes} fit into {size}");
            assert!(bytes < 1024 || size <= bytes + bytes / 4, "{bytes} take {size}");
            assert_eq!(size_class(size), size, "a size is its own class");
        }
    }
}
