//! Errors of the executor.

use specula_core::{
    executor::{BufferLength, Unsupported},
    lamps::LampError,
    light_network::LightNetworkError,
    near_field::NearFieldError,
    prefilter::RESOLUTION_MAX,
    scene::ChangeError,
};

/// Errors of devices, and of invalid inputs of stages.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no adapter, or none of that name.
    #[error(
        "no adapter of wgpu {}; install a driver for Vulkan, Metal or DirectX 12 (`mesa-vulkan-drivers` renders \
             without any GPU), or use the CPU",
        named(wanted)
    )]
    NoAdapter {
        /// Requested part of the name; empty for any.
        wanted: String,
    },
    /// The adapter cannot open a device.
    #[error("the adapter {adapter:?} cannot open a device: {reason}; use another adapter or the CPU")]
    NoDevice {
        /// Its name.
        adapter: String,
        /// Message of wgpu.
        reason: String,
    },
    /// The device is out of memory.
    #[error("the device is out of memory; use smaller pictures, fewer Gaussians or the CPU")]
    OutOfMemory,
    /// An array exceeds the adapter's limit of storage bindings.
    #[error(
        "{what} take {bytes} bytes, above the adapter's limit of {limit} bytes per array; use fewer Gaussians, smaller \
         pictures or a smaller light, another adapter, or the CPU"
    )]
    TooLarge {
        /// Name of the array.
        what: &'static str,
        /// Size of the array, in bytes.
        bytes: u64,
        /// Largest size, in bytes.
        limit: u64,
    },
    /// A light's network cannot be evaluated.
    #[error(transparent)]
    LightNetwork(LightNetworkError),
    /// A near field cannot be traced.
    #[error("the near field is damaged: {0}")]
    NearField(NearFieldError),
    /// Lamps are invalid.
    #[error(transparent)]
    Lamps(LampError),
    /// The limits of another program's device are too low.
    #[error(
        "the program's device on {adapter:?} has limits below WebGPU's defaults ({reason}); request it with \
         wgpu::Limits::default() or more"
    )]
    TooLimited {
        /// The adapter's name.
        adapter: String,
        /// Limits that are too low.
        reason: String,
    },
    /// The device is gone.
    #[error("the device was lost: {reason}; try again, or use the CPU")]
    Lost {
        /// Message of the driver.
        reason: String,
    },
    /// The device rejected a command.
    #[error("the device rejected a command, a bug of specula: {reason}")]
    Refused {
        /// Message of wgpu.
        reason: String,
    },
    /// The host would wait for commands that another program submits.
    #[error(
        "commands in another program's encoder have no result before it is submitted; record only pictures with a \
         granted capacity, and read results afterwards"
    )]
    NotSubmitted,
    /// A buffer does not have the length of the numbers to read.
    #[error(transparent)]
    BufferLength(BufferLength),
    /// Changed Gaussians do not replace the uploaded ones.
    #[error(transparent)]
    Change(ChangeError),
    /// A result that this executor does not compute.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
    /// A light's resolution cannot be filtered.
    #[error(
        "a light of resolution {resolution} cannot be filtered; use a power of two from {least} to {RESOLUTION_MAX}"
    )]
    LightResolution {
        /// Texels along an edge of a face.
        resolution: usize,
        /// Smallest valid resolution.
        least: usize,
    },
    /// A picture's pixels do not fit its size.
    #[error("a picture of {width} × {height} pixels needs {expected} numbers, but has {found}")]
    TargetSize {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Expected numbers, four of each pixel, or three of its unclipped colour.
        expected: usize,
        /// Numbers of the picture.
        found: usize,
    },
    /// A picture and its target differ in size.
    #[error("cannot compare a target of {found:?} pixels with a picture of {expected:?}")]
    FrameSize {
        /// Width and height of the target.
        expected: [usize; 2],
        /// Width and height of the frame.
        found: [usize; 2],
    },
}

fn named(wanted: &str) -> String {
    if wanted.is_empty() { "was found".to_owned() } else { format!("has {wanted:?} in its name") }
}
