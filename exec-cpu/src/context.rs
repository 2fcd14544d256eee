//! Context of the stages: the machine's vectors, pools of memory, and the caller's wish to stop.

use crate::{
    buffer::{Buffer, Pool},
    error::CpuError,
};
use core::{
    any::{Any, TypeId},
    fmt,
    sync::atomic::{AtomicBool, Ordering::Relaxed},
};
use fearless_simd::Level;
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

/// Vectors and memory. There is one pool for each type of number or record that stages keep.
pub(crate) struct Context {
    /// Widest vectors of this machine.
    pub(crate) level: Level,
    pools: Mutex<HashMap<TypeId, Box<dyn Any + Send + Sync>>>,
    /// Flag of the caller that cancels pictures.
    pub(crate) cancel: Option<Arc<AtomicBool>>,
    /// Whether a part of the current stage was skipped.
    is_cut: AtomicBool,
}

impl Context {
    /// Context with the widest vectors of this machine and empty pools.
    pub(crate) fn new() -> Self {
        Self { level: Level::new(), pools: Mutex::default(), cancel: None, is_cut: AtomicBool::new(false) }
    }
    /// Takes memory for `len` values with arbitrary contents.
    pub(crate) fn take<T: Default + Send + 'static>(&self, len: usize) -> Buffer<T> {
        self.pool::<T>().take(len)
    }
    /// Takes memory for `len` defaults.
    pub(crate) fn take_cleared<T: Copy + Default + Send + 'static>(&self, len: usize) -> Buffer<T> {
        self.pool::<T>().take_cleared(len)
    }
    /// Copy of values, in free memory if there is any.
    pub(crate) fn copy_of<T: Copy + Send + 'static>(&self, values: &[T]) -> Vec<T> {
        self.pool::<T>().copy_of(values)
    }
    /// Returns memory of [`Buffer::into_vec`] to its pool.
    pub(crate) fn give<T: Send + 'static>(&self, values: Vec<T>) {
        self.pool::<T>().give(values);
    }

    /// Returns whether to skip the next part of a stage, because the caller has cancelled the
    /// picture. Then [`Context::complete`] fails.
    pub(crate) fn skips(&self) -> bool {
        let skips = self.cancel.as_ref().is_some_and(|cancel| cancel.load(Relaxed));
        if skips {
            self.is_cut.store(true, Relaxed);
        }
        skips
    }
    /// Result of a stage, unless parts of it were skipped.
    pub(crate) fn complete<T>(&self, result: T) -> Result<T, CpuError> {
        if self.is_cut.swap(false, Relaxed) { Err(CpuError::Cancelled) } else { Ok(result) }
    }

    fn pool<T: Send + 'static>(&self) -> Pool<T> {
        let mut pools = self.pools.lock().unwrap_or_else(PoisonError::into_inner);
        let pool = pools.entry(TypeId::of::<T>()).or_insert_with(|| Box::new(Pool::<T>::default()));
        pool.downcast_ref::<Pool<T>>().expect("pools are keyed by type").clone()
    }
}

impl fmt::Debug for Context {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Context").field("level", &self.level).finish_non_exhaustive()
    }
}
