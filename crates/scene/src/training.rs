//! Training with checkpoints: started from points or resumed, on an executor chosen at run time,
//! with the CPU as a fallback for devices that fail.
//!
//! [`Training`] takes the steps. An [`Observer`] shows progress, saves at pauses, ends the run, and
//! provides the pictures for the fallback. [`Checkpoints`] are written at an interval and at the
//! end, and a [`Lock`] keeps other trainings out of the folder.

mod checkpoint;
mod info;
mod lock;
mod note;
mod run;
mod session;

pub use checkpoint::{Checkpoints, describe, settings_text};
pub(crate) use checkpoint::{PictureSum, describe_pictures};
pub use info::model_info;
pub use lock::Lock;
pub use note::Note;
pub use run::Start;
pub use session::{Observer, Outcome, Training};
