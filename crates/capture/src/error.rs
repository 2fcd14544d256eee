//! Errors of captures, each a sentence with a remedy.

use std::path::PathBuf;

/// Failure of a capture.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// File that cannot be read or written.
    #[error(transparent)]
    File(#[from] specula_io::Error),
    /// Unusable input, or a missing program.
    #[error("{0}")]
    Input(String),
    /// Program that failed.
    #[error("{program} failed: {message}; its output is in {log:?}")]
    Program {
        /// The program.
        program: String,
        /// Its last error.
        message: String,
        /// File of its output.
        log: PathBuf,
    },
    /// No cameras were found.
    #[error("{0}")]
    NoCameras(String),
    /// The user interrupted the capture.
    #[error("interrupted; the same command continues")]
    Interrupted,
}

impl Error {
    /// Error of a file or folder that cannot be written.
    pub(crate) fn writing(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        |cause| Self::File(specula_io::Error::Write { path, cause })
    }
}

/// Result of a capture.
pub type Result<T> = core::result::Result<T, Error>;
