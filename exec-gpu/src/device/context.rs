//! Execution context of the stages: a device, its memory, and the commands being recorded.

use crate::device::{
    error::GpuError,
    gpu::Gpu,
    kernel_set::KernelSet,
    kernels::{Binding, Dispatch, Recorder},
    memory::{Array, Pool, read, read_later, staged, write},
    timer::{KernelTime, KernelTimer},
};
use bytemuck::Pod;
use core::{mem, ops::Range};
use wgpu::CommandEncoder;

/// Device, memory pool and command recorder.
#[derive(Debug)]
pub(crate) struct Context {
    pub(crate) gpu: Gpu,
    /// Variants of the kernels.
    pub(crate) kernels: KernelSet,
    pool: Pool,
    pub(crate) recorder: Recorder,
}

impl Context {
    pub(crate) fn new(gpu: Gpu) -> Self {
        Self { pool: Pool::default(), kernels: KernelSet::of(&gpu), gpu, recorder: Recorder::default() }
    }

    /// Allocates `len` elements with arbitrary contents.
    ///
    /// # Errors
    ///
    /// See [`Pool::allocate`].
    pub(crate) fn allocate(&self, what: &'static str, len: usize) -> Result<Array, GpuError> {
        self.pool.allocate(&self.gpu, what, len)
    }

    /// Allocates `len` zeros.
    ///
    /// # Errors
    ///
    /// See [`Pool::allocate`].
    pub(crate) fn zeros(&mut self, what: &'static str, len: usize) -> Result<Array, GpuError> {
        let array = self.allocate(what, len)?;
        self.clear(&array, 0);
        Ok(array)
    }

    /// Records zeroing the elements from `first` on.
    pub(crate) fn clear(&mut self, array: &Array, first: usize) {
        self.recorder.encoder(&self.gpu).clear_buffer(array.buffer(), 4 * first as u64, None);
    }

    /// Uploads values to a new array.
    ///
    /// # Errors
    ///
    /// See [`Pool::allocate`].
    pub(crate) fn upload<T: Pod>(&mut self, what: &'static str, values: &[T]) -> Result<Array, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let array = self.allocate(what, bytes.len().div_ceil(4))?;
        write(&self.gpu, self.recorder.encoder(&self.gpu), &array, 0, bytes)?;
        Ok(array)
    }

    /// Records a write of values to the start of an array.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub(crate) fn write<T: Pod>(&mut self, array: &Array, values: &[T]) -> Result<(), GpuError> {
        self.write_at(array, 0, values)
    }

    /// Records a write of values from an element of an array on.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub(crate) fn write_at<T: Pod>(&mut self, array: &Array, first: usize, values: &[T]) -> Result<(), GpuError> {
        write(&self.gpu, self.recorder.encoder(&self.gpu), array, first, bytemuck::cast_slice(values))
    }

    /// Downloads elements of an array from `first` on. Blocks until the device is done.
    ///
    /// # Errors
    ///
    /// See [`Self::submit`]; a lost device.
    pub(crate) fn download<T: Pod>(&mut self, array: &Array, first: usize, values: &mut [T]) -> Result<(), GpuError> {
        const { assert!(size_of::<T>() == 4, "arrays are of 32 bits each") };
        let part = first..first + values.len();
        let values: &mut [u8] = bytemuck::cast_slice_mut(values);
        self.read(&[(array, part)], |bytes| values.copy_from_slice(bytes))
    }

    /// Passes the bytes of several ranges, one after the other, to `consume`, with one wait for the
    /// device.
    ///
    /// # Errors
    ///
    /// See [`Self::download`].
    pub(crate) fn read(
        &mut self,
        parts: &[(&Array, Range<usize>)],
        consume: impl FnOnce(&[u8]),
    ) -> Result<(), GpuError> {
        if parts.iter().all(|(_, part)| part.is_empty()) {
            return Ok(());
        }
        self.refuse_while_recording()?;
        let staging = staged(&self.gpu, self.recorder.encoder(&self.gpu), parts);
        self.submit()?;
        read(&self.gpu, &staging, consume)
    }

    /// Bytes of several ranges, one after the other, after the device has run the recorded
    /// commands. At least one range must not be empty.
    ///
    /// # Errors
    ///
    /// See [`Self::download`].
    pub(crate) fn read_later(
        &mut self,
        parts: &[(&Array, Range<usize>)],
    ) -> Result<impl Future<Output = Result<Vec<u8>, GpuError>> + use<>, GpuError> {
        self.refuse_while_recording()?;
        let staging = staged(&self.gpu, self.recorder.encoder(&self.gpu), parts);
        self.submit()?;
        Ok(read_later(&self.gpu, staging))
    }

    /// Submits the recorded commands.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub(crate) fn submit(&mut self) -> Result<(), GpuError> {
        self.recorder.submit(&self.gpu)
    }

    /// Submits the recorded commands and blocks until the device is done.
    ///
    /// # Errors
    ///
    /// See [`Self::submit`]; a lost device.
    pub(crate) fn finish(&mut self) -> Result<(), GpuError> {
        self.refuse_while_recording()?;
        self.submit()?;
        self.gpu.wait()
    }

    /// Refuses to wait for commands that another program submits.
    fn refuse_while_recording(&self) -> Result<(), GpuError> {
        if self.recorder.is_borrowed() { Err(GpuError::NotSubmitted) } else { Ok(()) }
    }

    /// Records into the encoder of another program until [`Self::end_recording`]; returns the timer
    /// of kernels, which are not timed in between.
    ///
    /// # Errors
    ///
    /// See [`Self::submit`]; [`GpuError::NotSubmitted`] within another recording.
    pub(crate) fn start_recording(&mut self, encoder: &mut CommandEncoder) -> Result<Option<KernelTimer>, GpuError> {
        self.refuse_while_recording()?;
        self.submit()?;
        let placeholder = self.gpu.device.create_command_encoder(&Default::default());
        self.recorder.borrow(mem::replace(encoder, placeholder));
        Ok(self.recorder.timer.take())
    }

    /// Gives the encoder of [`Self::start_recording`] back, and times kernels as before.
    pub(crate) fn end_recording(&mut self, encoder: &mut CommandEncoder, timer: Option<KernelTimer>) {
        *encoder = self.recorder.give_back(&self.gpu);
        self.recorder.timer = timer;
    }

    /// Durations of kernels since the last call, by name; empty if kernels are not timed.
    ///
    /// # Errors
    ///
    /// See [`Self::submit`].
    pub(crate) fn kernel_times(&mut self) -> Result<Vec<(&'static str, KernelTime)>, GpuError> {
        self.submit()?;
        Ok(self.recorder.timer.as_mut().map_or_else(Vec::new, KernelTimer::take))
    }

    /// Frees unused memory.
    pub(crate) fn free_unused_memory(&mut self) {
        self.pool.free_unused();
    }

    /// Bytes of all arrays, and of free buffers for reuse.
    pub(crate) fn memory_bytes(&self) -> u64 {
        self.pool.bytes()
    }

    /// Records a kernel; see [`Recorder::dispatch`].
    ///
    /// # Errors
    ///
    /// See [`Recorder::dispatch`].
    pub(crate) fn dispatch(
        &mut self,
        key: &str,
        entry: &'static str,
        source: &dyn Fn() -> String,
        bindings: &[Binding<'_>],
        size: Dispatch,
    ) -> Result<(), GpuError> {
        self.recorder.dispatch(&self.gpu, key, entry, source, bindings, size)
    }
}

#[cfg(test)]
impl Context {
    /// A context on the first adapter. Without an adapter tests are skipped with a note; in CI they
    /// fail.
    pub(crate) fn for_tests() -> Option<Self> {
        match Gpu::new("") {
            Ok(gpu) => Some(Self::new(gpu)),
            Err(error) if std::env::var_os("CI").is_some() => panic!("CI needs an adapter: {error}"),
            Err(error) => {
                eprintln!("NOT TESTED, because {error}");
                None
            }
        }
    }
}
