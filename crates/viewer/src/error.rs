//! Errors of a viewer.

#[cfg(feature = "server")]
use core::net::SocketAddr;
use specula_scene::SceneError;
#[cfg(feature = "server")]
use std::io;

/// Error of starting a viewer, or of adding a light to it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewerError {
    /// The address cannot be bound.
    #[cfg(feature = "server")]
    #[error("cannot listen at {address}: {cause}; use another address or port, or port 0 for any")]
    Listen {
        /// Requested address.
        address: SocketAddr,
        /// Error of the system.
        cause: io::Error,
    },
    /// The clock is before 1970, the first date of HTTP.
    #[cfg(feature = "server")]
    #[error("the clock of this machine is before 1970; set the clock")]
    Clock,
    /// The system has no random numbers for an access token.
    #[cfg(feature = "server")]
    #[error("the system has no random numbers for an access token ({0})")]
    Random(getrandom::Error),
    /// The runtime of the server cannot be started.
    #[cfg(feature = "server")]
    #[error("cannot serve: {0}")]
    Runtime(io::Error),
    /// The folder of uploads cannot be created.
    #[cfg(feature = "server")]
    #[error("cannot create a folder for uploaded lights: {0}")]
    UploadFolder(io::Error),
    /// The server ended before it was stopped.
    #[cfg(feature = "server")]
    #[error("the server ended: {0}")]
    Ended(tokio::task::JoinError),
    /// The scene cannot be rendered, or a file cannot be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A request for something that the scene does not have.
    #[error("{0}")]
    Request(String),
}

impl From<specula_io::Error> for ViewerError {
    fn from(error: specula_io::Error) -> Self {
        Self::Scene(error.into())
    }
}
