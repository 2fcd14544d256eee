//! Data sets from videos and photographs.
//!
//! [`capture()`] selects frames of videos with ffmpeg, copies photographs, and estimates cameras
//! with COLMAP or pycolmap, two programs that it finds on the path ([`Tool`]). Each step is skipped
//! if its result is there, so that an interrupted capture continues; `capture.json` records
//! decisions and command lines. [`findings`] names the causes of bad reconstructions.

mod colmap;
mod diagnosis;
mod error;
mod frames;
mod groups;
mod inputs;
mod look;
mod masks;
mod pairs;
mod pipeline;
mod process;
mod record;
mod video;

pub use colmap::Tool;
pub use diagnosis::{Evidence, Finding, findings};
pub use error::{Error, Result};
pub use look::Look;
pub use pipeline::{Options, Outcome, capture, check};
pub use process::{Monitor, command_text, has_ffmpeg, is_installed};
