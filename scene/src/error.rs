//! Errors of scenes.

use specula_cpu::CpuError;
#[cfg(feature = "gpu")]
use specula_gpu::GpuError;
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
    /// The backend of a renderer keeps its Gaussians and its light.
    #[error("the Gaussians and the light of this renderer cannot be replaced")]
    Immutable,
}
