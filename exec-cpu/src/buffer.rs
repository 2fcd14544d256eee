//! Pools of memory: dropped results of stages return their memory, so a training allocates nothing
//! after its largest pictures.

use core::ops::{Deref, DerefMut};
use std::{
    panic::resume_unwind,
    sync::{Arc, Mutex, PoisonError},
};

/// Panic payload of a stage that cannot allocate its memory.
#[derive(Clone, Copy, Debug, thiserror::Error, PartialEq, Eq)]
#[error(
    "a picture needs {} MiB more than the system grants; free some memory, or make pictures \
     smaller", bytes.div_ceil(1 << 20)
)]
pub struct OutOfMemory {
    /// Requested bytes.
    pub bytes: usize,
}

/// Pool of free memory for values of one type.
#[derive(Debug)]
pub(crate) struct Pool<T>(Arc<Mutex<Vec<Vec<T>>>>);

impl<T> Clone for Pool<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T> Pool<T> {
    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Vec<T>>> {
        // The list only contains free memory, so it is valid even after a panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Returns memory to the pool.
    pub(crate) fn give(&self, values: Vec<T>) {
        if values.capacity() > 0 {
            self.lock().push(values);
        }
    }
}

impl<T: Default> Pool<T> {
    /// Takes `len` values with arbitrary contents.
    pub(crate) fn take(&self, len: usize) -> Buffer<T> {
        let mut values = self.nearest(len).unwrap_or_default();
        if values.len() < len {
            // Capacity to grow: sizes of pictures and Gaussians vary between steps.
            let roomy = len + len / 4;
            let more = roomy - values.len();
            grow(&mut values, more);
            values.resize_with(roomy, T::default);
        }
        Buffer { values, len, home: self.clone() }
    }
}

impl<T> Pool<T> {
    /// The smallest free buffer that is large enough, unless it is far too large; else the largest
    /// one that is too small.
    fn nearest(&self, len: usize) -> Option<Vec<T>> {
        const WASTE_MAX: usize = 4;
        let mut free = self.lock();
        let sizes = || free.iter().enumerate().map(|(index, values)| (values.len(), index));
        let fits = sizes().filter(|(size, _)| (len..=WASTE_MAX * len.max(1024)).contains(size)).min();
        let (_, index) = fits.or_else(|| sizes().filter(|(size, _)| *size < len).max())?;
        Some(free.swap_remove(index))
    }
}

impl<T: Copy> Pool<T> {
    /// Copy of values, in free memory if there is any. Gradients from outside return to the pool
    /// like those of stages, so copies must also take their memory from it.
    pub(crate) fn copy_of(&self, values: &[T]) -> Vec<T> {
        let mut copy = self.nearest(values.len()).unwrap_or_default();
        copy.clear();
        grow(&mut copy, values.len());
        copy.extend_from_slice(values);
        copy
    }
}

impl<T: Copy + Default> Pool<T> {
    /// `len` defaults.
    pub(crate) fn take_cleared(&self, len: usize) -> Buffer<T> {
        let mut buffer = self.take(len);
        buffer.fill(T::default());
        buffer
    }
}

/// Reserves memory for more values. On failure it unwinds with [`OutOfMemory`], which a program can
/// report; a failed allocation would abort the program.
fn grow<T>(values: &mut Vec<T>, more: usize) {
    if values.try_reserve_exact(more).is_err() {
        resume_unwind(Box::new(OutOfMemory { bytes: more.saturating_mul(size_of::<T>()) }));
    }
}

/// Values in memory that returns to its pool.
#[derive(Debug)]
pub(crate) struct Buffer<T> {
    values: Vec<T>,
    len: usize,
    home: Pool<T>,
}

impl<T> Buffer<T> {
    /// Keeps the first `len` values.
    pub(crate) fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }
    /// The values, in memory that returns only through [`Pool::give`].
    pub(crate) fn into_vec(mut self) -> Vec<T> {
        let mut values = core::mem::take(&mut self.values);
        values.truncate(self.len);
        values
    }
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        self.home.give(core::mem::take(&mut self.values));
    }
}

impl<T> Deref for Buffer<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.values[..self.len]
    }
}

impl<T> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[..self.len]
    }
}

impl<T: Copy + Default> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        let mut copy = self.home.take(self.len);
        copy.copy_from_slice(self);
        copy
    }
}

impl<T: PartialEq> PartialEq for Buffer<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

#[cfg(test)]
mod tests {
    use super::{OutOfMemory, Pool};

    #[test]
    fn an_out_of_memory_panic_can_be_caught() {
        let taken = std::panic::catch_unwind(|| drop(Pool::<u64>::default().take(usize::MAX >> 5)));
        let payload = taken.expect_err("no system has as much");
        assert!(payload.downcast_ref::<OutOfMemory>().is_some_and(|fault| fault.bytes > 1 << 40));
    }

    #[test]
    fn returned_copies_do_not_accumulate() {
        let pool = Pool::<f32>::default();
        for len in [1000, 3000, 10, 2000, 1000] {
            for _ in 0..5 {
                let numbers: Vec<f32> = (0..len).map(|index| index as f32).collect();
                let copy = pool.copy_of(&numbers);
                assert_eq!(copy, numbers);
                pool.give(copy);
                assert_eq!(pool.lock().len(), 1, "of {len} numbers");
            }
        }
    }

    #[test]
    fn dropped_buffers_return_to_the_pool() {
        let pool = Pool::<f32>::default();
        let first = pool.take(1000);
        let address = first.as_ptr();
        drop(first);
        let again = pool.take(900);
        assert_eq!((again.as_ptr(), again.len()), (address, 900), "the same memory, a little shorter");
        assert_ne!(pool.take(900).as_ptr(), address, "it is in use");
    }

    #[test]
    fn cleared_buffers_hold_defaults() {
        let pool = Pool::<f32>::default();
        pool.take(10).fill(1.0);
        assert!(pool.take_cleared(10).iter().all(|x| *x == 0.0), "values of the last user are gone");
    }
}
