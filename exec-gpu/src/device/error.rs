//! Errors of the executor.

use specula_core::{
    executor::{BufferLength, Unsupported},
    lamps::LampError,
    light_network::LightNetworkError,
    near_field::NearFieldError,
    prefilter::RESOLUTION_MAX,
};

/// Errors of devices, and of inputs that stages refuse.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
pub enum GpuError {
    /// There is no adapter, or none of that name.
    #[error(
        "no adapter of wgpu {}; install a driver for Vulkan, Metal or DirectX 12 (`mesa-vulkan-drivers` renders \
             without any GPU), or use the CPU",
        named(wanted)
    )]
    NoAdapter {
        /// Part of the name that was asked for; empty for any.
        wanted: String,
    },
    /// The adapter gave no device.
    #[error("the adapter {adapter:?} gave no device: {reason}; use another adapter or the CPU")]
    NoDevice {
        /// Its name.
        adapter: String,
        /// Message of wgpu.
        reason: String,
    },
    /// The device has no memory left.
    #[error("the device is out of memory; use smaller pictures, fewer Gaussians or the CPU")]
    OutOfMemory,
    /// An array is larger than the adapter lets a shader see.
    #[error(
        "{what} take {bytes} bytes, and the adapter lets shaders see {limit} of an array; use fewer Gaussians, \
             smaller pictures or a smaller light, another adapter, or the CPU"
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
    /// The device of another program allows too little.
    #[error(
        "the device that {adapter:?} gave the program allows less than WebGPU does by default ({reason}); ask for \
             wgpu::Limits::default() or more when it is requested"
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
    /// The device refused a command.
    #[error("the device refused a command, which is a fault of the program: {reason}")]
    Refused {
        /// Message of wgpu.
        reason: String,
    },
    /// A buffer of another length than the numbers that are read into it.
    #[error(transparent)]
    BufferLength(BufferLength),
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
        /// The smallest that can be.
        least: usize,
    },
    /// A picture's bytes do not fit its size.
    #[error("a picture of {width} × {height} pixels needs {expected} bytes of RGBA, but has {found}")]
    TargetSize {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes that it should have.
        expected: usize,
        /// Bytes that it has.
        found: usize,
    },
    /// A picture was compared with one of another size.
    #[error("a picture of {found:?} pixels was compared with one of {expected:?}")]
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
