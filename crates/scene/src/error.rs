//! Errors of scenes.

use specula_core::{camera::Scissor, executor::Unsupported};
use specula_cpu::CpuError;
#[cfg(feature = "gpu")]
use specula_gpu::GpuError;
use specula_mesh::atlas::TextureTooSmall;
use specula_train::{exchange::ExchangeError, pictures::PictureError, trainer::TrainError};
use std::path::PathBuf;

/// Error of opening, rendering or exporting a scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] specula_io::Error),
    /// The CPU executor refused a stage.
    #[error(transparent)]
    Cpu(#[from] CpuError),
    /// The GPU executor refused a stage, or no device could be opened.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// An executor of another crate refused a stage.
    #[error(transparent)]
    Executor(Box<dyn core::error::Error + Send + Sync>),
    /// A GPU was requested in a build without the feature `gpu`.
    #[error("GPUs are not supported by this build, which lacks the feature `gpu`; use the CPU")]
    GpuUnsupported,
    /// A projection model that only the CPU executor supports was requested on a GPU.
    #[error("GPUs support only the affine projection; use the CPU for other models")]
    ProjectionUnsupported,
    /// A file has the faces of a cube, like saved lights of models, instead of a lat-long map.
    #[error("{0:?} has the six faces of a cube instead of a lat-long map; use the model's brdf_mlp.hdr")]
    CubeMap(PathBuf),
    /// Invalid views, points or training state at the start of a training.
    #[error("{0}")]
    Training(String),
    /// A picture cannot be decoded when a training needs it.
    #[error(transparent)]
    Picture(PictureError),
    /// Another rank of a training failed, or cannot be reached.
    #[error("the training ends because {0}")]
    Ranks(ExchangeError),
    /// Another program trains in the folder of a model; the message names it.
    #[error("{0}")]
    Locked(String),
    /// The files of a model name an unknown shading function.
    #[error("the model has the shading function {0:?}, which this version does not support; use a newer one")]
    UnknownShading(String),
    /// Physical materials of a scene without materials were requested.
    #[error("the scene was trained without physical materials")]
    NoMaterials,
    /// A scene was inserted into one with another shading model, materials or anti-aliasing.
    #[error("only a scene with the same shading model, materials and anti-aliasing can be inserted")]
    OtherModel,
    /// A light of a training that the model does not have, by its number from 1.
    #[error("the model has {lights} lights of its training, and no light {number}")]
    NoSuchLight {
        /// Requested number.
        number: usize,
        /// Number of lights.
        lights: usize,
    },
    /// A split of a scene without cameras was requested.
    #[error("the scene has no cameras")]
    NoCameras,
    /// Test views of a model that does not record them were requested.
    #[error("the model does not say which of its cameras are test views")]
    UnknownSplit,
    /// A split without views, by its name.
    #[error("the model has no {0} views")]
    NoViews(&'static str),
    /// A single PLY file, which has no folder for pictures.
    #[error("a PLY file has no folder for pictures")]
    NoFolder,
    /// A part that does not lie within the picture.
    #[error("the part {part:?} is not in a picture of {width} × {height} pixels")]
    Part {
        /// The part.
        part: Scissor,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Memory of an engine that does not have the numbers of a frame.
    #[error("{what} has {found} numbers, but needs {expected}")]
    FrameMemory {
        /// Name of the memory.
        what: &'static str,
        /// Its numbers.
        found: usize,
        /// Needed numbers.
        expected: usize,
    },
    /// The backend of a renderer does not support a feature.
    #[error(transparent)]
    Unsupported(Unsupported),
    /// A texture is too small for its mesh.
    #[error(transparent)]
    Texture(#[from] TextureTooSmall),
    /// The backend of a renderer keeps its Gaussians and its light.
    #[error("the Gaussians and the light of this renderer cannot be replaced")]
    Immutable,
}

impl SceneError {
    /// Returns whether an executor failed on valid input, such as a device that was lost, so that
    /// another executor may succeed.
    pub const fn is_device_failure(&self) -> bool {
        match self {
            Self::Executor(_) | Self::Immutable => true,
            Self::Cpu(error) => {
                !matches!(error, CpuError::LightResolution { .. } | CpuError::TooManySplats | CpuError::Cancelled)
            }
            #[cfg(feature = "gpu")]
            Self::Gpu(error) => matches!(
                error,
                GpuError::Refused { .. }
                    | GpuError::TargetSize { .. }
                    | GpuError::OutOfMemory
                    | GpuError::Lost { .. }
                    | GpuError::TooLarge { .. }
            ),
            _ => false,
        }
    }
}

impl<E: Into<Self> + core::error::Error> From<TrainError<E>> for SceneError {
    fn from(error: TrainError<E>) -> Self {
        match error {
            TrainError::Executor(error) => error.into(),
            TrainError::Exchange(error) => Self::Ranks(error),
            TrainError::Picture(error) => Self::Picture(error),
            other => Self::Training(other.to_string()),
        }
    }
}
