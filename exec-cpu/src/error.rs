//! Errors of the stages.

use specula_core::{
    executor::{BufferLength, Unsupported},
    lamps::LampError,
    light_network::LightNetworkError,
    near_field::NearFieldError,
    prefilter::RESOLUTION_MAX,
};

/// Error of a stage.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum CpuError {
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
    /// A light's network cannot be evaluated.
    #[error(transparent)]
    LightNetwork(LightNetworkError),
    /// A near field cannot be traced.
    #[error("the near field is damaged: {0}")]
    NearField(NearFieldError),
    /// Lamps are invalid.
    #[error(transparent)]
    Lamps(LampError),
    /// Tiles hold more splats than are counted.
    #[error(
        "the tiles of a picture hold more than 4 294 967 295 splats; use a smaller picture, or fewer or smaller Gaussians"
    )]
    TooManySplats,
    /// A picture was compared with one of another size.
    #[error("a picture of {found:?} pixels was compared with one of {expected:?}")]
    FrameSize {
        /// Width and height of the target.
        expected: [usize; 2],
        /// Width and height of the frame.
        found: [usize; 2],
    },
    /// A buffer of another length than the numbers that are read into it.
    #[error(transparent)]
    BufferLength(BufferLength),
    /// A result that this executor does not compute.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
}
