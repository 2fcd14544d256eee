//! Errors of the stages.

use specula_core::{
    executor::{BufferLength, Unsupported},
    lamps::LampError,
    light_network::LightNetworkError,
    near_field::NearFieldError,
    prefilter::RESOLUTION_MAX,
    scene::ChangeError,
};

/// Error of a stage.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum CpuError {
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
    /// A light's network cannot be evaluated.
    #[error(transparent)]
    LightNetwork(LightNetworkError),
    /// A near field cannot be traced.
    #[error("the near field is damaged: {0}")]
    NearField(NearFieldError),
    /// Lamps are invalid.
    #[error(transparent)]
    Lamps(LampError),
    /// Tiles have more splats than a counter can represent.
    #[error(
        "the tiles of a picture have more than 4 294 967 295 splats; use a smaller picture, or fewer or smaller \
         Gaussians"
    )]
    TooManySplats,
    /// A picture and its target differ in size.
    #[error("cannot compare a target of {found:?} pixels with a picture of {expected:?}")]
    FrameSize {
        /// Width and height of the target.
        expected: [usize; 2],
        /// Width and height of the frame.
        found: [usize; 2],
    },
    /// A buffer does not have the length of the numbers to read.
    #[error(transparent)]
    BufferLength(BufferLength),
    /// Changed Gaussians do not replace the uploaded ones.
    #[error(transparent)]
    Change(ChangeError),
    /// The caller has cancelled the picture.
    #[error("the picture was cancelled")]
    Cancelled,
    /// A result that this executor does not compute.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
}
