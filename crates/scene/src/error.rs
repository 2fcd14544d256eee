//! Errors of scenes.

use specula_cpu::CpuError;
#[cfg(feature = "gpu")]
use specula_gpu::GpuError;
use specula_train::{exchange::ExchangeError, pictures::PictureError, trainer::TrainError};
use std::path::PathBuf;

/// Error of a scene that is opened, rendered or exported.
#[derive(Debug, thiserror::Error)]
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
    /// A GPU was asked for in a build without the feature `gpu`.
    #[error("GPUs are not supported by this build, which lacks the feature `gpu`; use the CPU")]
    GpuUnsupported,
    /// A GPU was asked for a projection model that only the CPU executor has.
    #[error("GPUs project Gaussians by the affine model alone; use the CPU for other models")]
    ProjectionUnsupported,
    /// A file holds the faces of a cube, as lights of models are saved, where a lat-long map is
    /// read.
    #[error("{0:?} holds the six faces of a cube, and a light is read as lat-long; name the model's brdf_mlp.hdr")]
    CubeMap(PathBuf),
    /// Views, points or a training state that no training can start from.
    #[error("{0}")]
    Training(String),
    /// A picture cannot be shown to a training when its turn comes.
    #[error(transparent)]
    Picture(PictureError),
    /// Another rank of a training failed, or cannot be reached.
    #[error("the training ends because {0}")]
    Ranks(ExchangeError),
    /// Another program trains in the folder of a model; the sentence names it.
    #[error("{0}")]
    Locked(String),
    /// The files of a model name a shading function that is not known.
    #[error("the model names the shading function {0:?}, which this version does not know; use a newer one")]
    UnknownShading(String),
    /// Physical materials were asked for of a scene without any.
    #[error("the scene was trained without physical materials")]
    NoMaterials,
    /// A split was asked for of a scene without cameras.
    #[error("the scene has no cameras")]
    NoCameras,
    /// Test views were asked for of a model that does not record them.
    #[error("the model does not say which of its cameras are test views")]
    UnknownSplit,
    /// A split without views, by its name.
    #[error("the model has no {0} views")]
    NoViews(&'static str),
    /// A PLY file on its own, which has no folder for pictures.
    #[error("a PLY file has no folder for pictures")]
    NoFolder,
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
            Self::Cpu(error) => !matches!(error, CpuError::LightResolution { .. } | CpuError::TooManySplats),
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
