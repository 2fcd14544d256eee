//! Ctrl-C: the first asks for an orderly end, the second ends at once.

use crate::failure::Failure;
use core::sync::atomic::{AtomicBool, Ordering};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// What a shell expects of a program that Ctrl-C ended.
const EXIT_CODE: i32 = 130;

/// From now on Ctrl-C, SIGTERM and SIGHUP only ask.
pub(crate) fn watch() -> Result<(), Failure> {
    let asked = || {
        if REQUESTED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE);
        }
    };
    ctrlc::set_handler(asked).map_err(|error| Failure::Internal(format!("cannot listen for Ctrl-C: {error}")))
}

/// Whether an end was asked for.
pub(crate) fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
