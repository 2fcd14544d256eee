//! Compiled kernels of a device, shared by all executors on it.

use crate::device::error::GpuError;
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};
use wgpu::{BindGroupLayout, ComputePipeline};

/// A compiled kernel.
#[derive(Debug)]
pub(crate) struct Kernel {
    pub(crate) pipeline: ComputePipeline,
    pub(crate) layout: BindGroupLayout,
}

/// Kernels by variant and entry point; each is compiled once.
#[derive(Debug, Default)]
pub(crate) struct KernelCache(Mutex<HashMap<(String, &'static str), Arc<Kernel>>>);

impl KernelCache {
    /// Returns a kernel; the first request compiles it.
    ///
    /// # Errors
    ///
    /// Those of `compile`.
    pub(crate) fn get(
        &self,
        key: &str,
        entry: &'static str,
        compile: impl FnOnce() -> Result<Kernel, GpuError>,
    ) -> Result<Arc<Kernel>, GpuError> {
        let mut kernels = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let id = (key.to_owned(), entry);
        if let Some(kernel) = kernels.get(&id) {
            return Ok(kernel.clone());
        }
        let kernel = Arc::new(compile()?);
        kernels.insert(id, kernel.clone());
        Ok(kernel)
    }
}
