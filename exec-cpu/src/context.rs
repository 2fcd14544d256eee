//! Context of the stages: the machine's vectors, and pools of memory.

use crate::buffer::{Buffer, Pool};
use core::{
    any::{Any, TypeId},
    fmt,
};
use fearless_simd::Level;
use std::{
    collections::HashMap,
    sync::{Mutex, PoisonError},
};

/// Vectors and memory. There is one pool for each type of number or record that stages keep.
pub(crate) struct Context {
    /// Widest vectors of this machine.
    pub(crate) level: Level,
    pools: Mutex<HashMap<TypeId, Box<dyn Any + Send + Sync>>>,
}

impl Context {
    /// Context with the widest vectors of this machine and empty pools.
    pub(crate) fn new() -> Self {
        Self { level: Level::new(), pools: Mutex::default() }
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
