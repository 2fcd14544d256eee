//! Errors of a training.

use crate::{exchange::ExchangeError, pictures::PictureError};

/// Error of a training.
#[derive(Debug, thiserror::Error)]
pub enum TrainError<E> {
    /// There are no views.
    #[error("a training needs at least one picture, and there is none")]
    NoViews,
    /// There are no points to start from.
    #[error(
        "a training needs at least one point to start from, and there is none; give a point cloud or more random points"
    )]
    NoPoints,
    /// A training state belongs to other settings or views.
    #[error("what was learned is not of a training with these settings and views: {what}")]
    OtherRun {
        /// First mismatch.
        what: &'static str,
    },
    /// Another rank of the training failed, or this one can no longer reach it.
    #[error("the training ends because {0}")]
    Exchange(ExchangeError),
    /// A picture cannot be shown when its turn comes. The training is where it was before the step.
    #[error(transparent)]
    Picture(PictureError),
    /// A stage failed.
    #[error(transparent)]
    Executor(#[from] E),
}
