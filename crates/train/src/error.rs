//! Errors of a training.

use crate::{exchange::ExchangeError, pictures::PictureError};

/// Error of a training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError<E> {
    /// There are no views.
    #[error("a training needs at least one picture")]
    NoViews,
    /// There are no initial points.
    #[error("a training needs at least one initial point; provide a point cloud or more random points")]
    NoPoints,
    /// A training state belongs to other settings or views.
    #[error("the training state does not match these settings and views: {what}")]
    OtherRun {
        /// First mismatch.
        what: &'static str,
    },
    /// Several views per step, or several ranks, under several lights.
    #[error("pictures under several lights are trained one per step, on one rank")]
    SeveralLights,
    /// Another rank of the training failed or is unreachable.
    #[error("the training ends because {0}")]
    Exchange(ExchangeError),
    /// A picture cannot be decoded when it is needed. The training is in the state before the step.
    #[error(transparent)]
    Picture(PictureError),
    /// A stage failed.
    #[error(transparent)]
    Executor(#[from] E),
}
