//! An open device: its limits, and the errors that wgpu reports through callbacks.
//!
//! wgpu reports a lost device to one callback and other errors to another, while calls return
//! normally. Both are recorded and become the error of the next call that waits or submits. A lost
//! device stays lost: it may be in the middle of a step, so nothing is read from it again.

use crate::device::{
    adapter::{AdapterPlace, Traits, all_adapters, selected},
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
    Adapter, AdapterInfo, Backends, Device, DeviceDescriptor, DeviceLostReason, DeviceType, ExperimentalFeatures,
    Features, Instance, InstanceDescriptor, Limits, MemoryHints, PollType, PowerPreference, Queue,
    RequestAdapterOptions, Trace,
};

/// Device of wgpu. A clone is the same device for another executor, with the same compiled kernels.
/// An error of the device is returned once, to the first clone that checks for it; its loss is
/// returned to all.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) device: Device,
    pub(crate) queue: Queue,
    info: AdapterInfo,
    limits: Limits,
    /// Largest chunk of Gaussians, in bytes.
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
    /// Opens the first adapter with `wanted` in its name, preferring hardware; an empty name
    /// matches any.
    ///
    /// # Errors
    ///
    /// [`GpuError::NoAdapter`] if no adapter matches, [`GpuError::NoDevice`] if it cannot open a
    /// device.
    pub fn new(wanted: &str) -> Result<Self, GpuError> {
        Self::nth(wanted, 0).map(|(gpu, _)| gpu)
    }

    /// Opens the adapter of a rank, by its number among the ranks of this machine: the first rank
    /// has that of [`Gpu::new`], the second one the next, and so on, cyclically. Software drivers
    /// are used only without hardware, and an adapter with two backends counts once. Also returns
    /// its index among the adapters.
    ///
    /// # Errors
    ///
    /// Those of [`Gpu::new`].
    pub fn nth(wanted: &str, rank: usize) -> Result<(Self, AdapterPlace), GpuError> {
        let adapters = all_adapters();
        let traits: Vec<Traits> = adapters.iter().map(Traits::of).collect();
        let none = || GpuError::NoAdapter { wanted: wanted.to_owned() };
        let (index, place) = selected(&traits, wanted, rank).ok_or_else(none)?;
        Ok((Self::of(&adapters[index])?, place))
    }

    /// Opens the adapter that the system prefers, without blocking: in a browser only the event
    /// loop can wait.
    ///
    /// # Errors
    ///
    /// [`GpuError::NoAdapter`] if there is none, [`GpuError::TooLimited`] if its limits are below
    /// WebGPU's defaults, [`GpuError::NoDevice`] if it cannot open a device.
    pub async fn request() -> Result<Self, GpuError> {
        let instance = Instance::new(InstanceDescriptor {
            backends: Backends::PRIMARY,
            ..InstanceDescriptor::new_without_display_handle()
        });
        let options =
            RequestAdapterOptions { power_preference: PowerPreference::HighPerformance, ..Default::default() };
        let adapter = instance.request_adapter(&options).await;
        let adapter = adapter.map_err(|_| GpuError::NoAdapter { wanted: String::new() })?;
        refuse_low_limits(&adapter.get_info(), &adapter.limits())?;
        Self::requested(&adapter).await
    }

    fn of(adapter: &Adapter) -> Result<Self, GpuError> {
        pollster::block_on(Self::requested(adapter))
    }

    async fn requested(adapter: &Adapter) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let limits = wanted_limits(&adapter.limits());
        let descriptor = DeviceDescriptor {
            label: Some("specula"),
            // Optional: for timing kernels.
            required_features: adapter.features() & Features::TIMESTAMP_QUERY,
            required_limits: limits.clone(),
            experimental_features: ExperimentalFeatures::disabled(),
            memory_hints: MemoryHints::Performance,
            trace: Trace::Off,
        };
        let opened = adapter.request_device(&descriptor).await;
        let (device, queue) =
            opened.map_err(|error| GpuError::NoDevice { adapter: info.name.clone(), reason: error.to_string() })?;
        let fault = Arc::new(Mutex::new(None));
        let fault_on_error = fault.clone();
        device.on_uncaptured_error(Arc::new(move |error| keep_first(&fault_on_error, fault_of(&error))));
        let fault_on_loss = fault.clone();
        device.set_device_lost_callback(move |how, reason| keep_loss(&fault_on_loss, how, reason));
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

    /// Wraps the device of another program, so that frames are drawn into its textures without
    /// leaving the device; see [`Composer`](crate::Composer). The device needs WebGPU's default
    /// limits and no features. The callbacks for errors and for the loss of the device remain the
    /// program's.
    ///
    /// # Errors
    ///
    /// [`GpuError::TooLimited`] if its limits are below WebGPU's defaults.
    pub fn shared(device: Device, queue: Queue) -> Result<Self, GpuError> {
        let (info, limits) = (device.adapter_info(), device.limits());
        refuse_low_limits(&info, &limits)?;
        Ok(Self::with_fault(device, queue, info, limits, Arc::default()))
    }

    /// The device, for commands of another program.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The queue of the device.
    pub fn queue(&self) -> &Queue {
        &self.queue
    }

    /// Name, driver and kind of the adapter.
    pub fn info(&self) -> &AdapterInfo {
        &self.info
    }

    /// Whether the adapter is a software driver, which computes on the CPU.
    pub fn is_software(&self) -> bool {
        self.info.device_type == DeviceType::Cpu
    }

    /// Largest chunk of Gaussians, in bytes.
    pub(crate) fn chunk_max(&self) -> u64 {
        self.chunk_max.min(self.binding_max())
    }

    /// Largest storage binding, in bytes: whole vectors of four numbers.
    pub(crate) fn binding_max(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size) / 16 * 16
    }

    /// Largest number of workgroups along one axis of a dispatch.
    pub(crate) fn workgroups_max(&self) -> u32 {
        self.limits.max_compute_workgroups_per_dimension
    }

    /// Alignment of uniforms in a buffer, in bytes.
    pub(crate) fn uniform_alignment(&self) -> usize {
        self.limits.min_uniform_buffer_offset_alignment as usize
    }

    /// Returns the error that was reported since the last call, if any. The loss of a device is
    /// permanent. A lost device may reject calls before it reports its loss, so a rejection waits
    /// for that report.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let refused = match self.noted() {
            Err(refused @ GpuError::Refused { .. }) => refused,
            noted => return noted,
        };
        match self.wait() {
            Err(lost @ GpuError::Lost { .. }) => Err(lost),
            _ => Err(refused),
        }
    }

    /// Recorded error, if any; all except the loss of the device are cleared.
    fn noted(&self) -> Result<(), GpuError> {
        let mut fault = self.fault.lock().expect("no thread panics while recording an error");
        match &*fault {
            Some(lost @ GpuError::Lost { .. }) => Err(lost.clone()),
            _ => fault.take().map_or(Ok(()), Err),
        }
    }

    /// Cause of a failed call: an earlier error of the device, if any, else the call's error.
    pub(crate) fn cause_of(&self, error: &dyn fmt::Display) -> GpuError {
        self.wait().err().unwrap_or_else(|| GpuError::Refused { reason: error.to_string() })
    }

    /// Blocks until all submissions are done. In a browser nothing can block, so it returns at
    /// once.
    ///
    /// # Errors
    ///
    /// The error that the device reported, or its loss.
    pub(crate) fn wait(&self) -> Result<(), GpuError> {
        self.waits.fetch_add(1, Relaxed);
        // wgpu panics if a driver reports the loss of the device during the wait. By then it has
        // released its locks and called back, and no operation of the executor is incomplete.
        let poll = || self.device.poll(PollType::wait_indefinitely());
        let waited = panic::catch_unwind(AssertUnwindSafe(poll));
        self.noted()?;
        match waited {
            Ok(waited) => waited.map(drop).map_err(|error| GpuError::Lost { reason: error.to_string() }),
            Err(_) => Err(GpuError::Lost { reason: "the driver released it".to_owned() }),
        }
    }
}

/// Devices with lower limits, with counters, or lost, for tests.
#[cfg(feature = "testing")]
impl Gpu {
    /// Device with a lower limit of the size of an array, in bytes, like a smaller device.
    #[must_use]
    pub fn limited(mut self, bytes: u64) -> Self {
        self.limits.max_storage_buffer_binding_size = bytes.min(self.limits.max_storage_buffer_binding_size);
        self
    }

    /// Device with Gaussians in chunks of at most a number of bytes, and at least one block.
    /// Results do not depend on it.
    #[must_use]
    pub fn with_chunks_of(mut self, bytes: u64) -> Self {
        self.chunk_max = bytes;
        self
    }

    /// Number of times that the host has waited for the device.
    pub fn waits(&self) -> usize {
        self.waits.load(Relaxed)
    }

    /// Function that destroys the device, as a driver may at any time: all later calls fail.
    pub fn fuse(&self) -> impl Fn() + Send + 'static {
        let device = self.device.clone();
        move || device.destroy()
    }
}

/// Rejects limits below WebGPU's defaults.
///
/// # Errors
///
/// [`GpuError::TooLimited`], with every limit that is too low.
fn refuse_low_limits(info: &AdapterInfo, limits: &Limits) -> Result<(), GpuError> {
    let mut lacks = Vec::new();
    Limits::default().check_limits_with_fail_fn(limits, false, |name, needed, allowed| {
        lacks.push(format!("{name}: {allowed} of {needed}"));
    });
    if lacks.is_empty() {
        return Ok(());
    }
    Err(GpuError::TooLimited { adapter: info.name.clone(), reason: lacks.join(", ") })
}

/// WebGPU's limits, with the adapter's largest arrays.
fn wanted_limits(adapter: &Limits) -> Limits {
    Limits {
        max_storage_buffer_binding_size: adapter.max_storage_buffer_binding_size,
        max_buffer_size: adapter.max_buffer_size,
        ..Limits::default()
    }
}

/// Records a loss, which replaces other errors because it is their cause.
fn keep_loss(fault: &Mutex<Option<GpuError>>, how: DeviceLostReason, reason: String) {
    let reason = match how {
        DeviceLostReason::Destroyed => "it was closed".to_owned(),
        DeviceLostReason::Unknown => reason,
    };
    *fault.lock().expect("no thread panics while recording an error") = Some(GpuError::Lost { reason });
}

fn keep_first(fault: &Mutex<Option<GpuError>>, error: GpuError) {
    fault.lock().expect("no thread panics while recording an error").get_or_insert(error);
}

fn fault_of(error: &wgpu::Error) -> GpuError {
    match error {
        wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory,
        wgpu::Error::Validation { description, .. } | wgpu::Error::Internal { description, .. } => {
            GpuError::Refused { reason: description.clone() }
        }
    }
}
