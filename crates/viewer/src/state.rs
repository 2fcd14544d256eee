//! Shared state of the request handlers.

use crate::{
    guard::Guard,
    http::HttpError,
    lights::Lights,
    live::LiveTraining,
    queue::{Queue, QueueError},
    render_thread::Job,
    request::FrameRequest,
    setup::LightSetup,
    worker::Frame,
};
use axum::{body::Bytes, http::StatusCode};
use core::time::Duration;
use serde_json::Value;
use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};

/// Maximum total size of pictures in transmission, in KiB.
const SENDING_MAX: usize = 256 << 10;

/// State of a server.
#[derive(Debug)]
pub(crate) struct ServerState {
    pub(crate) guard: Guard,
    pub(crate) queue: Arc<Queue<Job>>,
    pub(crate) lights: Arc<Lights>,
    /// Constant description of the scene: name, layers, views, first camera.
    pub(crate) description: Value,
    /// Whether the scene has a shading function, so that lights can be added.
    pub(crate) is_shaded: bool,
    /// Watched training.
    pub(crate) live: Option<Arc<LiveTraining>>,
    /// Folder of uploads, while they are received.
    pub(crate) upload_folder: PathBuf,
    /// Permit to read an uploaded light.
    pub(crate) uploads: Arc<Semaphore>,
    /// First light of the page; by default that of the scene.
    setup: OnceLock<LightSetup>,
    /// Permits to send pictures, one per KiB.
    sending: Arc<Semaphore>,
}

impl ServerState {
    /// Initial state of a server: one light is read at a time, and pictures in transmission are
    /// bounded.
    pub(crate) fn new(
        guard: Guard,
        queue: Arc<Queue<Job>>,
        lights: Arc<Lights>,
        description: Value,
        is_shaded: bool,
        live: Option<Arc<LiveTraining>>,
        upload_folder: PathBuf,
    ) -> Self {
        let (uploads, sending) = (Arc::new(Semaphore::new(1)), Arc::new(Semaphore::new(SENDING_MAX)));
        let setup = OnceLock::new();
        Self { guard, queue, lights, description, is_shaded, live, upload_folder, uploads, setup, sending }
    }

    /// Light that the page starts with.
    pub(crate) fn setup(&self) -> LightSetup {
        self.setup.get().cloned().unwrap_or_default()
    }

    /// Sets the first light of the page, once.
    pub(crate) fn start_under(&self, setup: LightSetup) {
        self.setup.get_or_init(|| setup);
    }

    /// Whether a light is being received or read.
    pub(crate) fn is_reading(&self) -> bool {
        self.uploads.available_permits() == 0
    }

    /// Queues a picture and waits for it.
    pub(crate) async fn render(&self, client: u64, request: FrameRequest) -> Result<(Frame, Duration), HttpError> {
        let (reply, frame) = oneshot::channel();
        self.queue.push(client, Job { request, reply }).map_err(rejected)?;
        // The queue drops a job when the same client requests another picture.
        let replaced = |_| HttpError::new(StatusCode::CONFLICT, "the same client has requested another picture");
        Ok(frame.await.map_err(replaced)??)
    }

    /// Response body of a picture, which holds its permits until the last byte is sent.
    pub(crate) fn sent(&self, bytes: Vec<u8>) -> Result<Bytes, HttpError> {
        let size = u32::try_from(bytes.len().div_ceil(1 << 10)).unwrap_or(u32::MAX);
        let permit = self.sending.clone().try_acquire_many_owned(size);
        let permit = permit.map_err(|_| HttpError::busy("too many pictures are being sent; try again in a moment"))?;
        Ok(Bytes::from_owner(SentPicture { bytes, _permit: permit }))
    }
}

/// Picture in transmission.
struct SentPicture {
    bytes: Vec<u8>,
    _permit: OwnedSemaphorePermit,
}

impl AsRef<[u8]> for SentPicture {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

fn rejected(error: QueueError) -> HttpError {
    HttpError::busy(match error {
        QueueError::Full => "too many pictures are waiting; try again in a moment",
        QueueError::Closed => "the renderer has stopped; start specula again",
    })
}
