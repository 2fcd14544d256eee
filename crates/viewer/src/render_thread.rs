//! Thread of the render worker, which takes requests from a queue.

use crate::{
    ViewerError,
    live::LiveTraining,
    queue::Queue,
    request::FrameRequest,
    worker::{Frame, RenderWorker},
};
use core::time::Duration;
use std::{sync::Arc, thread, time::Instant};
use tokio::sync::oneshot;

/// Requested picture, and the channel of its reply: the picture, and the time of rendering.
#[derive(Debug)]
pub(crate) struct Job {
    pub(crate) request: FrameRequest,
    pub(crate) reply: oneshot::Sender<Result<(Frame, Duration), ViewerError>>,
}

/// Renders the jobs of a queue on a new thread, until the queue is closed.
pub(crate) fn spawn(mut worker: RenderWorker, queue: Arc<Queue<Job>>, live: Option<Arc<LiveTraining>>) {
    /// Closes the queue when the thread ends, even by a panic, so no client waits for it.
    struct CloseOnDrop(Arc<Queue<Job>>);
    impl Drop for CloseOnDrop {
        fn drop(&mut self) {
            self.0.close();
        }
    }
    thread::spawn(move || {
        let queue = CloseOnDrop(queue);
        worker.warm_up();
        while let Some(Job { request, reply }) = queue.0.next() {
            // The client closed its connection while it waited.
            if reply.is_closed() {
                continue;
            }
            let latest = live.as_ref().and_then(|live| live.take());
            let updated = latest.map_or(Ok(()), |scene| worker.set_scene(scene));
            // The receiver is gone if the client has closed its connection.
            let start = Instant::now();
            let frame = updated.and_then(|()| worker.render(&request));
            let _ = reply.send(frame.map(|frame| (frame, start.elapsed())));
        }
    });
}
