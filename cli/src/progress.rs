//! Notes and progress on stderr. Notes are the `tracing` events of the program and its libraries,
//! printed as one line each. Progress is a bar on a terminal, else a line every few seconds.

use core::{fmt, time::Duration};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use specula_scene::text::printable;
use std::{
    io::{self, IsTerminal, stderr},
    sync::{LazyLock, Mutex},
    time::Instant,
};
use tracing::{Event, Level, Subscriber, level_filters::LevelFilter, subscriber::NoSubscriber};
use tracing_subscriber::{
    filter::Targets,
    fmt::{FmtContext, FormatEvent, FormatFields, format::Writer},
    layer::SubscriberExt,
    registry::LookupSpan,
};

/// Time between two lines of progress where stderr is not a terminal.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Prefix of the targets whose events are printed: the program and its libraries, but not other
/// crates.
const TARGET: &str = "specula";

/// Target of the notes that every rank of a training prints.
pub(crate) const RANKS_TARGET: &str = "specula::ranks";

/// Bars on the terminal.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// Installs the subscriber of [`subscriber`] for the whole program.
pub(crate) fn init(quiet: bool, is_first: bool) {
    tracing::subscriber::set_global_default(subscriber(quiet, is_first)).expect("main sets it once");
}

/// Subscriber that prints notes; only errors if `quiet`. Of several ranks, those after the first
/// print errors, and notes of the target [`RANKS_TARGET`].
pub(crate) fn subscriber(quiet: bool, is_first: bool) -> impl Subscriber + Send + Sync {
    let level = |is_quiet| if is_quiet { LevelFilter::ERROR } else { LevelFilter::INFO };
    let targets = Targets::new().with_target(TARGET, level(quiet || !is_first)).with_target(RANKS_TARGET, level(quiet));
    let lines =
        tracing_subscriber::fmt::layer().event_format(Sentence).with_writer(|| BetweenBars).log_internal_errors(false);
    tracing_subscriber::registry().with(targets).with(lines)
}

/// Whether only errors are printed.
pub(crate) fn is_quiet() -> bool {
    !tracing::enabled!(Level::INFO)
}

/// Runs `f` without printing its notes and its progress.
pub(crate) fn silently<T>(f: impl FnOnce() -> T) -> T {
    tracing::subscriber::with_default(NoSubscriber::default(), f)
}

/// Starts the progress of `steps` steps; silent if notes are.
pub(crate) fn work(title: &str, steps: u64) -> Work {
    let is_quiet = is_quiet();
    let is_terminal = stderr().is_terminal();
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
    let bar = if is_terminal && !is_quiet { BARS.add(bar) } else { bar };
    let template = "{prefix:>12} {wide_bar:.green/dim} {human_pos}/{human_len}  {msg}  {elapsed} < {eta}";
    let style = ProgressStyle::with_template(template).expect("the template is valid");
    bar.set_style(style.progress_chars("━━─"));
    bar.set_prefix(title.to_owned());
    let last_line = (!is_terminal && !is_quiet).then(|| Mutex::new(Instant::now()));
    Work { bar, last_line }
}

/// Format of a note: the program's name and the sentence, in one line whatever a library or a file
/// says.
struct Sentence;

impl<S, N> FormatEvent<S, N> for Sentence
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, context: &FmtContext<'_, S, N>, mut out: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let mut text = String::new();
        context.format_fields(Writer::new(&mut text), event)?;
        let words: Vec<&str> = text.split('\n').map(str::trim).filter(|line| !line.is_empty()).collect();
        writeln!(out, "specula: {}", printable(&words.join(" ")))
    }
}

/// Writer to stderr that clears the bars for each write and draws them again.
struct BetweenBars;

impl io::Write for BetweenBars {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        BARS.suspend(|| stderr().write(line))
    }

    fn flush(&mut self) -> io::Result<()> {
        stderr().flush()
    }
}

/// Progress of some work.
#[derive(Debug)]
pub(crate) struct Work {
    bar: ProgressBar,
    /// Time of the last line; `None` where a bar is drawn, or nothing.
    last_line: Option<Mutex<Instant>>,
}

impl Work {
    /// Shows that `steps` steps are done. `message` is only called if it is shown.
    pub(crate) fn done(&self, steps: u64, message: impl FnOnce() -> String) {
        if !self.bar.is_hidden() {
            self.bar.set_message(message());
            self.bar.set_position(steps);
        } else if let Some(last) = &self.last_line {
            self.bar.set_position(steps);
            let mut last = last.lock().expect("no thread panics while it writes a line");
            if last.elapsed() >= LINE_INTERVAL {
                *last = Instant::now();
                self.print_line(&message());
            }
        }
    }

    /// Resumes after `steps` steps that took `seconds`. The time left is estimated from later steps
    /// alone. Clocks of some systems start with the machine; a longer time before is shown as none.
    pub(crate) fn resumed(self, steps: u64, seconds: f64) -> Self {
        let elapsed = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        let since = Instant::now().checked_sub(elapsed);
        let bar = self.bar.with_elapsed(since.map_or(Duration::ZERO, |_| elapsed)).with_position(steps);
        bar.tick();
        bar.reset_eta();
        Self { bar, ..self }
    }

    /// Sets the number of steps.
    pub(crate) fn set_steps(&self, steps: u64) {
        self.bar.set_length(steps);
    }

    /// Removes the bar.
    pub(crate) fn finish(self) {
        self.bar.finish_and_clear();
    }

    fn print_line(&self, message: &str) {
        let (done, all, left) = (self.bar.position(), self.bar.length().unwrap_or(0), self.bar.eta().as_secs());
        let gap = if message.is_empty() { "" } else { ", " };
        tracing::info!("{} {done}/{all}{gap}{message}, {left} s left", self.bar.prefix());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds in which indicatif's weight of a measurement falls to a tenth.
    const WEIGHT_DECAY: f64 = 15.0;
    /// Relative rounding of seconds and weights.
    const ROUNDING: f64 = 1e-6;

    /// Readings of the clock enclose those of indicatif, so that the interval holds however long a
    /// loaded machine takes; on an idle one it is a few per cent wide.
    #[test]
    fn the_time_left_counts_from_the_step_that_was_resumed_from() {
        let before = Instant::now();
        let work = work("training", 6000).resumed(5000, 1000.0);
        let start = Instant::now();
        assert_eq!(work.bar.position(), 5000);
        assert_eq!(work.bar.eta(), Duration::ZERO, "nothing is known yet");
        std::thread::sleep(Duration::from_millis(50));
        let least = start.elapsed().as_secs_f64();
        work.bar.set_position(5100);
        work.bar.tick();
        let left = work.bar.eta().as_secs_f64();
        let most = before.elapsed().as_secs_f64();
        // 900 steps take nine times as long as 100; a rate decays until it is read.
        let (least, most) = (9.0 * least, 9.0 * most * 10.0_f64.powf(most / WEIGHT_DECAY));
        let interval = least * (1.0 - ROUNDING)..most * (1.0 + ROUNDING);
        assert!(interval.contains(&left), "{left} s for 900 steps, expected {interval:?} s");
        work.bar.set_position(6000);
        assert_eq!(work.bar.eta(), Duration::ZERO, "nothing is left");
    }

    #[test]
    fn work_resumes_for_any_time_that_it_is_said_to_have_taken() {
        for seconds in [0.0, 3600.0, 3.2e9, 1e20, f64::INFINITY, f64::NAN, -1.0] {
            let work = work("training", 10).resumed(4, seconds);
            assert_eq!(work.bar.position(), 4, "{seconds}");
        }
    }
}
