//! `specula demo`.

use crate::{args::Demo, failure::Failure, progress::Talk};

/// Steps of each training.
pub(crate) const ITERATIONS: u32 = 1500;

pub(crate) fn run(_args: &Demo, _talk: Talk) -> Result<(), Failure> {
    Ok(())
}
