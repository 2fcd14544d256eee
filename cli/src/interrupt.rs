//! Ctrl-C: the first asks for an orderly end, the second ends at once. And the signal of a file that is too large.

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

/// Lets a write beyond the limit on the size of files (`ulimit -f`) fail as it does on a full disk, instead of ending the
/// program in the middle of a file. Where the signal cannot be caught, it does what it always did.
pub(crate) fn survive_limits_of_files() {
    #[cfg(unix)]
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
}

/// Whether an end was asked for.
pub(crate) fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
