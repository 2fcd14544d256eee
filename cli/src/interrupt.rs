//! Ctrl-C: the first asks for an orderly end, one a second later ends at once. And the signal of a file that is too large.

use crate::failure::Failure;
use core::{
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};
use std::time::Instant;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// What a shell expects of a program that Ctrl-C ended.
const EXIT_CODE: i32 = 130;

/// Signals within this time are one: `timeout` sends it to a program and to its group, and fingers press twice.
const SAME: Duration = Duration::from_secs(1);

/// From now on Ctrl-C, SIGTERM and SIGHUP only ask.
pub(crate) fn watch() -> Result<(), Failure> {
    let mut first = None;
    let asked = move || {
        let now = Instant::now();
        if is_insisting(*first.get_or_insert(now), now) {
            std::process::exit(EXIT_CODE);
        }
        REQUESTED.store(true, Ordering::Relaxed);
    };
    ctrlc::set_handler(asked).map_err(|error| Failure::Internal(format!("cannot listen for Ctrl-C: {error}")))
}

/// Whether a signal at this time is meant to end the program at once, after the first one.
fn is_insisting(first: Instant, now: Instant) -> bool {
    now.saturating_duration_since(first) >= SAME
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
