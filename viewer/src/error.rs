//! Errors of a viewer.

use core::net::SocketAddr;
use specula_scene::SceneError;
use std::io;

/// Error of a viewer that is started, or of a light that is added to it.
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// The address cannot be bound.
    #[error("cannot listen at {address}: {cause}; choose another address or port, or port 0 for any")]
    Listen {
        /// Requested address.
        address: SocketAddr,
        /// Error of the system.
        cause: io::Error,
    },
    /// The system gives no random numbers for an access token.
    #[error("the system gives no random numbers for an access token ({0})")]
    Random(getrandom::Error),
    /// The runtime of the server cannot be started.
    #[error("cannot serve: {0}")]
    Runtime(io::Error),
    /// The folder of uploads cannot be created.
    #[error("cannot create a folder for uploaded lights: {0}")]
    UploadFolder(io::Error),
    /// The server ended before it was stopped.
    #[error("the server ended: {0}")]
    Ended(tokio::task::JoinError),
    /// The scene cannot be rendered, or a file cannot be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A request names something that the scene lacks.
    #[error("{0}")]
    Request(String),
}

impl From<specula_io::Error> for ViewerError {
    fn from(error: specula_io::Error) -> Self {
        Self::Scene(error.into())
    }
}
