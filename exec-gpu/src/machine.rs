//! What every stage needs: the device, its memory, its kernels.

use crate::{
    blend_vjp::ReplayParts,
    device::{Gpu, GpuError},
    kernel::{Bound, Groups, Kernels},
    memory::{Array, Pool, read, staged, write},
};
use bytemuck::Pod;

/// A device with memory and kernels.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) gpu: Gpu,
    pub(crate) replay_parts: ReplayParts,
    pool: Pool,
    pub(crate) kernels: Kernels,
}

impl Machine {
    pub(crate) fn new(gpu: Gpu) -> Self {
        Self { replay_parts: ReplayParts::new(&gpu), gpu, pool: Pool::default(), kernels: Kernels::default() }
    }

    /// An array of so many numbers, whatever they are.
    pub(crate) fn take(&self, what: &'static str, len: usize) -> Result<Array, GpuError> {
        self.pool.take(&self.gpu, what, len)
    }

    /// An array of so many zeros.
    pub(crate) fn zeros(&mut self, what: &'static str, len: usize) -> Result<Array, GpuError> {
        let array = self.take(what, len)?;
        self.kernels.encoder(&self.gpu).clear_buffer(array.buffer(), 0, None);
        Ok(array)
    }

    /// An array of these numbers.
    pub(crate) fn upload<T: Pod>(&mut self, what: &'static str, values: &[T]) -> Result<Array, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let array = self.take(what, bytes.len().div_ceil(4))?;
        write(&self.gpu, self.kernels.encoder(&self.gpu), &array, bytes)?;
        Ok(array)
    }

    /// Some numbers of an array, from `first` on, or whole ones. Waits for the device.
    pub(crate) fn download<T: Pod>(&mut self, array: &Array, first: usize, values: &mut [T]) -> Result<(), GpuError> {
        const { assert!(size_of::<T>() == 4, "arrays are of 32 bits each") };
        let len = values.len();
        let own: &mut [u8] = bytemuck::cast_slice_mut(values);
        self.read(array, first, len, |bytes| own.copy_from_slice(&bytes[..own.len()]))
    }

    /// Gives back memory that no array uses.
    pub(crate) fn forget_memory(&mut self) {
        self.pool.forget();
    }

    /// Bytes of all arrays, and of those that are kept to be used again.
    pub(crate) fn memory(&self) -> u64 {
        self.pool.bytes()
    }

    fn read(&mut self, array: &Array, first: usize, len: usize, take: impl FnOnce(&[u8])) -> Result<(), GpuError> {
        if len == 0 {
            return Ok(());
        }
        let staging = staged(&self.gpu, self.kernels.encoder(&self.gpu), array, first, len);
        self.kernels.submit(&self.gpu)?;
        read(&self.gpu, &staging, take)
    }

    /// Records a kernel; see [`Kernels::run`].
    pub(crate) fn run(
        &mut self,
        key: &str,
        entry: &'static str,
        source: &dyn Fn() -> String,
        bound: &[Bound<'_>],
        groups: Groups,
    ) -> Result<(), GpuError> {
        self.kernels.run(&self.gpu, key, entry, source, bound, groups)
    }
}
