//! How the program can end early, and the exit code that says so.

use specula_cpu::CpuError;
#[cfg(feature = "gpu")]
use specula_gpu::GpuError;
use specula_train::trainer::TrainError;
use std::io;

/// Why the program ends early. What is said is one sentence with the file and the remedy.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] specula_io::Error),
    /// What was asked for cannot be.
    #[error("{0}")]
    Input(String),
    /// Something that should not happen.
    #[error("{0}; this is a fault of the program")]
    Internal(String),
    /// The user had enough; what there was is saved.
    #[error("{0}")]
    Interrupted(String),
    /// Nobody reads the results any more.
    #[error("the reader of the results went away")]
    BrokenPipe,
}

impl Failure {
    /// What the program exits with: 0 fine, 1 its own fault, 2 bad input, 130 interrupted.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::File(_) | Self::Input(_) => 2,
            Self::Internal(_) => 1,
            Self::Interrupted(_) => 130,
            Self::BrokenPipe => 0,
        }
    }
}

impl From<CpuError> for Failure {
    fn from(error: CpuError) -> Self {
        match error {
            CpuError::LightResolution { .. } => Self::Input(error.to_string()),
            other => Self::Internal(other.to_string()),
        }
    }
}

#[cfg(feature = "gpu")]
impl From<GpuError> for Failure {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Refused { .. } | GpuError::TargetSize { .. } => Self::Internal(error.to_string()),
            other => Self::Input(other.to_string()),
        }
    }
}

impl<E> From<TrainError<E>> for Failure
where
    E: Into<Self> + core::error::Error,
{
    fn from(error: TrainError<E>) -> Self {
        match error {
            TrainError::Executor(error) => error.into(),
            other => Self::Input(other.to_string()),
        }
    }
}

/// Of writing to stdout.
impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Self::BrokenPipe,
            _ => Self::Input(format!("cannot write the results to stdout: {error}")),
        }
    }
}
