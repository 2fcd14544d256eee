//! Arrays on the device, and how bytes get there and back.

use crate::device::{Gpu, GpuError};
use core::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard};
use wgpu::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder, MapMode};

/// Buffers are made in steps of a quarter of a power of two, so that those of a growing scene fit again.
const STEPS: u64 = 4;
/// The least buffer, in bytes.
const LEAST: u64 = 256;

/// Numbers of 32 bits on the device. Its memory goes back to where it came from.
#[derive(Debug)]
pub struct Array {
    /// `None` only while being dropped.
    buffer: Option<Buffer>,
    len: usize,
    pool: Arc<Mutex<Shelf>>,
}

impl Array {
    /// How many numbers there are.
    pub fn len(&self) -> usize {
        self.len
    }
    /// Whether there are none.
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

/// Where arrays come from and go back to.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    shelf: Arc<Mutex<Shelf>>,
}

/// Buffers that no array uses, and how many bytes there are in all.
#[derive(Debug, Default)]
struct Shelf {
    free: Vec<Buffer>,
    bytes: u64,
}

impl Shelf {
    /// A buffer of this size, a new one if there is none.
    fn take(&mut self, gpu: &Gpu, size: u64) -> Result<Buffer, GpuError> {
        if let Some(place) = self.free.iter().position(|buffer| buffer.size() == size) {
            return Ok(self.free.swap_remove(place));
        }
        let buffer = new_buffer(gpu, size)?;
        self.bytes += size;
        Ok(buffer)
    }
}

impl Pool {
    /// An array of so many numbers, whatever they are. `what` names it where it is too large.
    pub(crate) fn take(&self, gpu: &Gpu, what: &'static str, len: usize) -> Result<Array, GpuError> {
        let bytes = 4 * len as u64;
        let limit = gpu.binding_max();
        if bytes > limit {
            return Err(GpuError::TooLarge { what, bytes, limit });
        }
        let size = size_class(bytes).min(limit);
        let buffer = self.shelf().take(gpu, size)?;
        Ok(Array { buffer: Some(buffer), len, pool: self.shelf.clone() })
    }

    /// Gives back what no array uses.
    pub(crate) fn forget(&self) {
        let mut shelf = self.shelf();
        shelf.bytes -= shelf.free.drain(..).map(|buffer| buffer.size()).sum::<u64>();
    }

    /// Bytes of all buffers, whether arrays use them or not.
    pub(crate) fn bytes(&self) -> u64 {
        self.shelf().bytes
    }

    fn shelf(&self) -> MutexGuard<'_, Shelf> {
        self.shelf.lock().expect("nobody panics while holding the pool")
    }
}

/// Where there is no memory for it, that is known at once, and no array is made of nothing.
fn new_buffer(gpu: &Gpu, size: u64) -> Result<Buffer, GpuError> {
    let buffer = gpu.device.create_buffer(&BufferDescriptor {
        label: None,
        size,
        usage: BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.check().map(|()| buffer)
}

/// The next size that buffers are made in.
fn size_class(bytes: u64) -> u64 {
    let bytes = bytes.max(LEAST);
    let step = (bytes.next_power_of_two() / 2 / STEPS).max(LEAST / STEPS);
    bytes.next_multiple_of(step)
}

/// A new buffer that holds these bytes.
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

/// Writes bytes to the start of an array, after all commands that were recorded before.
pub(crate) fn write(gpu: &Gpu, encoder: &mut CommandEncoder, array: &Array, bytes: &[u8]) -> Result<(), GpuError> {
    if bytes.is_empty() {
        return Ok(());
    }
    let staging = filled(gpu, bytes, BufferUsages::COPY_SRC)?;
    encoder.copy_buffer_to_buffer(&staging, 0, array.buffer(), 0, Some(bytes.len() as u64));
    Ok(())
}

/// A buffer that the host can read, which parts of arrays, not all empty, are copied to once the commands run, one
/// behind the other.
pub(crate) fn staged(gpu: &Gpu, encoder: &mut CommandEncoder, parts: &[(&Array, Range<usize>)]) -> Buffer {
    let size_of = |part: &Range<usize>| 4 * part.len() as u64;
    let staging = gpu.device.create_buffer(&BufferDescriptor {
        label: None,
        size: parts.iter().map(|(_, part)| size_of(part)).sum(),
        usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut place = 0;
    for (array, part) in parts.iter().filter(|(_, part)| !part.is_empty()) {
        debug_assert!(part.end <= array.len(), "what is read lies in the array");
        encoder.copy_buffer_to_buffer(array.buffer(), 4 * part.start as u64, &staging, place, Some(size_of(part)));
        place += size_of(part);
    }
    staging
}

/// The bytes of a staged buffer; waits for the device.
pub(crate) fn read(gpu: &Gpu, staging: &Buffer, take: impl FnOnce(&[u8])) -> Result<(), GpuError> {
    staging.map_async(MapMode::Read, .., |_| ());
    gpu.wait()?;
    let view = staging.get_mapped_range(..).map_err(|error| gpu.cause_of(&error))?;
    take(&view);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a process may address where memory is to run out, in KiB: a driver and a few arrays fit.
    const LITTLE: u64 = 6 << 20;

    #[test]
    #[ignore = "takes all memory of its process; another test runs it in one that has little"]
    fn an_array_that_does_not_fit_is_refused_and_others_still_fit() {
        let gpu = Gpu::new("").expect("there is an adapter, or this is not run");
        let pool = Pool::default();
        let len = gpu.binding_max() as usize / 4;
        let most = (2 * LITTLE * 1024 / gpu.binding_max()) as usize;
        let taken: Vec<Result<Array, GpuError>> = (0..most).map(|_| pool.take(&gpu, "too much", len)).collect();
        assert!(taken[0].is_ok(), "one fits");
        let refused: Vec<&GpuError> = taken.iter().filter_map(|array| array.as_ref().err()).collect();
        assert!(refused.iter().all(|error| **error == GpuError::OutOfMemory), "{refused:?}");
        assert!(!refused.is_empty(), "{most} arrays fit where half of them should not");
        drop(taken);
        pool.forget();
        gpu.wait().expect("the device is still there");
        pool.take(&gpu, "little", 1000).expect("there is memory again");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn memory_that_runs_out_is_no_panic() {
        if let Err(error) = Gpu::new("") {
            assert!(std::env::var_os("CI").is_none(), "CI needs an adapter: {error}");
            eprintln!("NOT TESTED, because {error}");
            return;
        }
        let name = "memory::tests::an_array_that_does_not_fit_is_refused_and_others_still_fit";
        let script = format!("ulimit -v {LITTLE} && exec \"$0\" --ignored --exact {name}");
        let tests = std::env::current_exe().expect("this is a program");
        let output =
            std::process::Command::new("sh").args(["-c", &script]).arg(tests).output().expect("there is a shell");
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && told.contains("1 passed"), "{told}");
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
