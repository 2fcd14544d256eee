//! An open device: its limits, and the errors that wgpu reports through callbacks.
//!
//! wgpu reports a lost device to one callback and other faults to another, and lets calls return as
//! if nothing had happened. Both are recorded and become the error of the next call that waits or
//! submits. A lost device stays lost: it may hold half of a step, so nothing is read from it any
//! more.

use crate::device::{
    adapter::{all_adapters, report},
    cache::KernelCache,
    error::GpuError,
};
use core::{
    fmt,
    panic::AssertUnwindSafe,
    sync::atomic::{AtomicUsize, Ordering::Relaxed},
};
use std::{
    panic,
    sync::{Arc, Mutex},
};
use wgpu::{
    Adapter, AdapterInfo, Device, DeviceDescriptor, DeviceLostReason, DeviceType, ExperimentalFeatures, Features,
    Limits, MemoryHints, PollType, Queue, Trace,
};

/// A device that kernels run on. A clone is the same device for another executor, which shares the kernel_cache kernels; what
/// goes wrong on the device is told to whoever asks it first, and its loss to all.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    info: AdapterInfo,
    limits: Limits,
    /// Most bytes of an array of Gaussians.
    chunk_max: u64,
    fault: Arc<Mutex<Option<GpuError>>>,
    pub(crate) kernel_cache: Arc<KernelCache>,
    waits: AtomicUsize,
}

impl Clone for Gpu {
    fn clone(&self) -> Self {
        let Self { device, queue, info, limits, chunk_max, fault, kernel_cache, waits: _ } = self;
        Self {
            device: device.clone(),
            queue: queue.clone(),
            info: info.clone(),
            limits: limits.clone(),
            chunk_max: *chunk_max,
            fault: fault.clone(),
            kernel_cache: kernel_cache.clone(),
            waits: AtomicUsize::new(0),
        }
    }
}

impl Gpu {
    /// The first adapter with `wanted` in its name, of real hardware if there is any; an empty name is any.
    pub fn new(wanted: &str) -> Result<Self, GpuError> {
        let is_wanted = |adapter: &Adapter| adapter.get_info().name.to_lowercase().contains(&wanted.to_lowercase());
        let mut found: Vec<Adapter> = all_adapters().into_iter().filter(is_wanted).collect();
        found.sort_by_key(|adapter| report(adapter).is_software);
        let adapter = found.into_iter().next().ok_or(GpuError::NoAdapter { wanted: wanted.to_owned() })?;
        Self::of(&adapter)
    }

    fn of(adapter: &Adapter) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let limits = wanted_limits(&adapter.limits());
        let descriptor = DeviceDescriptor {
            label: Some("specula"),
            // Nothing needs it: it tells how long kernels take.
            required_features: adapter.features() & Features::TIMESTAMP_QUERY,
            required_limits: limits.clone(),
            experimental_features: ExperimentalFeatures::disabled(),
            memory_hints: MemoryHints::Performance,
            trace: Trace::Off,
        };
        let opened = pollster::block_on(adapter.request_device(&descriptor));
        let (device, queue) =
            opened.map_err(|error| GpuError::NoDevice { adapter: info.name.clone(), reason: error.to_string() })?;
        let fault = Arc::new(Mutex::new(None));
        let of_errors = fault.clone();
        device.on_uncaptured_error(Arc::new(move |error| keep_first(&of_errors, fault_of(&error))));
        let of_loss = fault.clone();
        device.set_device_lost_callback(move |how, reason| keep_loss(&of_loss, how, reason));
        Ok(Self::with_fault(device, queue, info, limits, fault))
    }

    fn with_fault(
        device: Device,
        queue: Queue,
        info: AdapterInfo,
        limits: Limits,
        fault: Arc<Mutex<Option<GpuError>>>,
    ) -> Self {
        let kernel_cache = Arc::default();
        Self { device, queue, info, limits, chunk_max: u64::MAX, fault, kernel_cache, waits: AtomicUsize::new(0) }
    }

    /// The device of a program that draws itself, so that pictures get to its textures without leaving the device; see
    /// [`crate::compose`]. It has to allow what WebGPU does by default, and needs no features. Its errors go where the
    /// program wants them: the callbacks for errors and for a lost device stay the program's.
    pub fn shared(device: Device, queue: Queue) -> Result<Self, GpuError> {
        let (info, limits) = (device.adapter_info(), device.limits());
        let mut lacks = Vec::new();
        Limits::default().check_limits_with_fail_fn(&limits, false, |name, needed, allowed| {
            lacks.push(format!("{name}: {allowed} of {needed}"));
        });
        if !lacks.is_empty() {
            return Err(GpuError::TooLimited { adapter: info.name, reason: lacks.join(", ") });
        }
        Ok(Self::with_fault(device, queue, info, limits, Arc::default()))
    }

    /// Name, driver and kind of the adapter.
    pub fn info(&self) -> &AdapterInfo {
        &self.info
    }

    /// Whether the adapter is a program that computes on the CPU.
    pub fn is_software(&self) -> bool {
        self.info.device_type == DeviceType::Cpu
    }

    /// This device, but shaders see no more of an array than so many bytes: what a smaller device would do.
    #[must_use]
    pub fn limited(mut self, bytes: u64) -> Self {
        self.limits.max_storage_buffer_binding_size = bytes.min(self.limits.max_storage_buffer_binding_size);
        self
    }

    /// This device, but Gaussians lie in pieces of no more than so many bytes, or of sixteen. Results do not depend on it.
    #[must_use]
    pub fn with_chunks_of(mut self, bytes: u64) -> Self {
        self.chunk_max = bytes;
        self
    }

    /// Largest array that Gaussians are put into, in bytes.
    pub(crate) fn chunk_max(&self) -> u64 {
        self.chunk_max.min(self.binding_max())
    }

    /// Largest array that a shader may see, in bytes: whole vectors of four numbers.
    pub(crate) fn binding_max(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size) / 16 * 16
    }

    /// Most workgroups along one axis of a dispatch.
    pub(crate) fn workgroups_max(&self) -> u32 {
        self.limits.max_compute_workgroups_per_dimension
    }

    /// What went wrong since the last call, if anything did. A device that was lost stays so.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let mut fault = self.fault.lock().expect("nobody panics while noting a fault");
        match &*fault {
            Some(lost @ GpuError::Lost { .. }) => Err(lost.clone()),
            _ => fault.take().map_or(Ok(()), Err),
        }
    }

    /// Why a call failed that says so itself: what was noted before is the cause, if there is anything.
    pub(crate) fn cause_of(&self, error: &dyn fmt::Display) -> GpuError {
        self.wait().err().unwrap_or_else(|| GpuError::Refused { reason: error.to_string() })
    }

    /// How often the host has waited for the device so far.
    pub fn waits(&self) -> usize {
        self.waits.load(Relaxed)
    }

    /// Waits until everything that was submitted is done.
    pub(crate) fn wait(&self) -> Result<(), GpuError> {
        self.waits.fetch_add(1, Relaxed);
        // wgpu panics where a driver says while it is waited for that the device is gone. By then it has let go of its
        // locks and told of the loss, and nothing of ours is half done.
        let poll = || self.device.poll(PollType::wait_indefinitely());
        let waited = panic::catch_unwind(AssertUnwindSafe(poll));
        self.check()?;
        match waited {
            Ok(waited) => waited.map(drop).map_err(|error| GpuError::Lost { reason: error.to_string() }),
            Err(_) => Err(GpuError::Lost { reason: "the driver gave it up".to_owned() }),
        }
    }

    /// What ends the device when it is called, as a driver may at any time: whatever is asked of it afterwards fails.
    pub fn fuse(&self) -> impl Fn() + Send + 'static {
        let device = self.device.clone();
        move || device.destroy()
    }
}

/// The limits of WebGPU, but arrays as large as the adapter takes them.
fn wanted_limits(adapter: &Limits) -> Limits {
    Limits {
        max_storage_buffer_binding_size: adapter.max_storage_buffer_binding_size,
        max_buffer_size: adapter.max_buffer_size,
        ..Limits::default()
    }
}

/// A loss is the cause of whatever else goes wrong, so it counts more.
fn keep_loss(fault: &Mutex<Option<GpuError>>, how: DeviceLostReason, reason: String) {
    let reason = match how {
        DeviceLostReason::Destroyed => "it was closed".to_owned(),
        DeviceLostReason::Unknown => reason,
    };
    *fault.lock().expect("nobody panics while noting a fault") = Some(GpuError::Lost { reason });
}

fn keep_first(fault: &Mutex<Option<GpuError>>, error: GpuError) {
    fault.lock().expect("nobody panics while noting a fault").get_or_insert(error);
}

fn fault_of(error: &wgpu::Error) -> GpuError {
    match error {
        wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory,
        wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
            GpuError::Refused { reason: description.clone() }
        }
    }
}
