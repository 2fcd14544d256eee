//! Errors of measurements and reports.

use specula_cpu::CpuError;
use specula_scene::SceneError;

/// Failure of a measurement or of its report.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// File that cannot be read or written.
    #[error(transparent)]
    File(#[from] specula_io::Error),
    /// The CPU executor failed on a scene.
    #[error(transparent)]
    Cpu(#[from] CpuError),
    /// Scene that cannot be rendered.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Invalid input of a measurement.
    #[error("{0}")]
    Input(String),
    /// Plot that cannot be drawn.
    #[error("a plot cannot be drawn: {0}")]
    Plot(String),
    /// Page that cannot be rendered from its template.
    #[error("a page cannot be rendered: {0}")]
    Page(#[from] askama::Error),
}

/// Result of a measurement or of its report.
pub type Result<T> = core::result::Result<T, Error>;
