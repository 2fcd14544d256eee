//! Signals: the first Ctrl-C requests an orderly end, another one a second later ends the program
//! at once. The signal for a file above the size limit is ignored.

use crate::failure::Failure;
use core::{
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};
use std::time::Instant;

static REQUESTED: AtomicBool = AtomicBool::new(false);
static IS_WATCHED: AtomicBool = AtomicBool::new(false);

/// Exit code of a program that was ended by SIGINT.
const EXIT_CODE: i32 = 130;

/// Interval within which signals count as one: `timeout` signals both the program and its group,
/// and keys bounce.
const DEBOUNCE: Duration = Duration::from_secs(1);

/// Handles Ctrl-C, SIGTERM and SIGHUP as requests to end; does nothing the second time.
///
/// # Errors
/// [`Failure::Internal`] if the handler cannot be installed.
pub(crate) fn watch() -> Result<(), Failure> {
    if IS_WATCHED.swap(true, Ordering::Relaxed) {
        return Ok(());
    }
    let mut first = None;
    let on_signal = move || {
        let now = Instant::now();
        if is_insisting(*first.get_or_insert(now), now) {
            std::process::exit(EXIT_CODE);
        }
        REQUESTED.store(true, Ordering::Relaxed);
    };
    ctrlc::set_handler(on_signal).map_err(|error| Failure::Internal(format!("cannot listen for Ctrl-C: {error}")))
}

/// True if a signal at `now` ends the program at once, given the time of the first one.
fn is_insisting(first: Instant, now: Instant) -> bool {
    now.saturating_duration_since(first) >= DEBOUNCE
}

/// Ignores SIGXFSZ, so that a write beyond the file size limit (`ulimit -f`) fails like one on a
/// full disk instead of ending the program in the middle of a file. Does nothing if the signal
/// cannot be caught.
pub(crate) fn ignore_file_size_signal() {
    #[cfg(unix)]
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
}

/// True once an end is requested.
pub(crate) fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_within_a_second_of_the_first_are_one() {
        let first = Instant::now();
        let after = |milliseconds| is_insisting(first, first + Duration::from_millis(milliseconds));
        assert_eq!([0, 1, 999, 1000, 60_000].map(after), [false, false, false, true, true]);
    }
}
