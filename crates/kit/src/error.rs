//! Errors of the rasteriser.

use specula_core::camera::CameraError;

/// Column of [`Inputs`](crate::Inputs).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column {
    /// Centres.
    Means,
    /// Orientations.
    Quats,
    /// Standard deviations.
    Scales,
    /// Opacities.
    Opacities,
    /// Colours, or coefficients of harmonics.
    Colors,
}

impl Column {
    const fn name(self) -> &'static str {
        match self {
            Self::Means => "means",
            Self::Quats => "quats",
            Self::Scales => "scales",
            Self::Opacities => "opacities",
            Self::Colors => "colors",
        }
    }
    const fn range(self) -> &'static str {
        match self {
            Self::Means | Self::Colors => "three finite numbers",
            Self::Quats => "four finite numbers (w, x, y, z), not all zero",
            Self::Scales => "three finite standard deviations above zero",
            Self::Opacities => "a number from 0 to 1",
        }
    }
}

impl core::fmt::Display for Column {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        out.write_str(self.name())
    }
}

/// Input that the rasteriser refuses.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A column has another number of rows than the means.
    #[error("{column} has {found} rows, and means has {expected}; give one row for each Gaussian")]
    Length {
        /// The column.
        column: Column,
        /// Rows of the means.
        expected: usize,
        /// Rows of the column.
        found: usize,
    },
    /// A value is outside of its range.
    #[error("row {row} of {column} is out of range; a row is {}", column.range())]
    Value {
        /// The column.
        column: Column,
        /// First row with such a value.
        row: usize,
    },
    /// Harmonics have no degree.
    #[error(
        "{coefficients} coefficients of harmonics for {count} Gaussians are none of 1, 4, 9 or 16 for each, or fewer \
         than degree {degree} reads; use a degree from 0 to 3 with (degree + 1)² coefficients or more"
    )]
    Harmonics {
        /// Degree that is evaluated.
        degree: u8,
        /// Coefficients of all Gaussians.
        coefficients: usize,
        /// Gaussians.
        count: usize,
    },
    /// A view is not that of a pinhole camera.
    #[error("view {view}: {error}")]
    Camera {
        /// Index of the view.
        view: usize,
        /// Reason.
        error: CameraError,
    },
    /// A view has no pixels, or more than an edge can have.
    #[error("view {view} has {width} × {height} pixels; use edges from 1 to 65 536 pixels")]
    Size {
        /// Index of the view.
        view: usize,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A background is not finite.
    #[error("view {view} has a background that is not finite")]
    Background {
        /// Index of the view.
        view: usize,
    },
    /// Near and far plane are no range.
    #[error("the planes near {near} and far {far} are no range; use 0 ≤ near < far")]
    Planes {
        /// Near plane.
        near: f32,
        /// Far plane.
        far: f32,
    },
    /// A radius that is below zero or not a number.
    #[error("a radius of {radius_clip} pixels is no limit; use 0 to draw all Gaussians, or more")]
    RadiusClip {
        /// Largest radius that is not drawn.
        radius_clip: f32,
    },
    /// A low-pass that the executors do not have.
    #[error(
        "a low-pass of {eps2d} px² {} is not supported; use 0.3, or 0.1 with antialiasing",
        if *antialiased { "with antialiasing" } else { "without antialiasing" }
    )]
    LowPass {
        /// Variance that is added, in px².
        eps2d: f32,
        /// Whether opacity is compensated.
        antialiased: bool,
    },
    /// Cotangents are not those of the pictures.
    #[error("{found} cotangents were given for {expected} views; give one for each view of the forward pass")]
    Cotangents {
        /// Views.
        expected: usize,
        /// Cotangents.
        found: usize,
    },
    /// A cotangent has another length than its picture.
    #[error(
        "the cotangent of {image} of view {view} has {found} numbers, and the picture {expected}; leave it empty for \
         zeros"
    )]
    CotangentLength {
        /// Index of the view.
        view: usize,
        /// Name of the picture.
        image: &'static str,
        /// Numbers of the picture.
        expected: usize,
        /// Numbers of the cotangent.
        found: usize,
    },
}

/// Error of the rasteriser on an executor with errors `E`.
#[derive(Debug, thiserror::Error)]
pub enum RasterizeError<E: core::error::Error + 'static> {
    /// An input was refused.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A stage of the executor failed.
    #[error(transparent)]
    Executor(E),
}
