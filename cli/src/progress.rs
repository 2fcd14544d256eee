//! Notes and progress on stderr. A note is a `tracing` event of this workspace, printed as one line; progress is a bar on
//! a terminal, else a line every few seconds. Notes are printed between bars.

use core::{cell::Cell, fmt, time::Duration};
use indicatif::{HumanDuration, MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
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

/// Prefix of the targets whose events are printed: the program and its libraries.
const TARGET: &str = "specula";

/// All bars on the terminal.
static BARS: LazyLock<MultiProgress> = LazyLock::new(MultiProgress::new);

/// Prints the notes of the program and its libraries from now on; only errors if `quiet`.
pub(crate) fn init(quiet: bool) {
    let level = if quiet { LevelFilter::ERROR } else { LevelFilter::INFO };
    let lines =
        tracing_subscriber::fmt::layer().event_format(Sentence).with_writer(|| BetweenBars).log_internal_errors(false);
    let subscriber = tracing_subscriber::registry().with(Targets::new().with_target(TARGET, level)).with(lines);
    tracing::subscriber::set_global_default(subscriber).expect("main sets it once");
}

/// Runs `f` without its notes and its progress.
pub(crate) fn silently<T>(f: impl FnOnce() -> T) -> T {
    tracing::subscriber::with_default(NoSubscriber::default(), f)
}

/// Starts progress over `steps` steps; silent where notes are.
pub(crate) fn work(title: &str, steps: u64) -> Work {
    let is_quiet = !tracing::enabled!(Level::INFO);
    let is_terminal = stderr().is_terminal();
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
    let bar = if is_terminal && !is_quiet { BARS.add(bar) } else { bar };
    bar.set_style(style(Begin::now(0)));
    bar.set_prefix(title.to_owned());
    let lines = (!is_terminal && !is_quiet).then(|| Mutex::new(Cell::new(Instant::now())));
    Work { bar, begin: Begin::now(0), lines }
}

/// Format of a note: the program's name and the sentence.
struct Sentence;

impl<S, N> FormatEvent<S, N> for Sentence
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, context: &FmtContext<'_, S, N>, mut out: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        out.write_str("specula: ")?;
        context.format_fields(out.by_ref(), event)?;
        writeln!(out)
    }
}

/// Stderr, with the bars out of the way for each write.
struct BetweenBars;

impl io::Write for BetweenBars {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        BARS.suspend(|| stderr().write(line))
    }

    fn flush(&mut self) -> io::Result<()> {
        stderr().flush()
    }
}

fn style(begin: Begin) -> ProgressStyle {
    let template = "{prefix:>12} {wide_bar:.green/dim} {human_pos}/{human_len}  {msg}  {elapsed} < {left}";
    let left = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        // A bar that cannot say it says nothing.
        let left = begin.left(state.pos(), state.len().unwrap_or(0));
        let _ = write!(out, "{:#}", HumanDuration(Duration::from_secs(left.as_secs())));
    };
    let style = ProgressStyle::with_template(template).expect("the template is valid").with_key("left", left);
    style.progress_chars("━━─")
}

/// When, and after how many steps, this program began.
#[derive(Clone, Copy, Debug)]
struct Begin {
    steps: u64,
    time: Instant,
}

impl Begin {
    fn now(steps: u64) -> Self {
        Self { steps, time: Instant::now() }
    }

    fn left(self, done: u64, all: u64) -> Duration {
        time_left(done.saturating_sub(self.steps), all.saturating_sub(done), self.time.elapsed())
    }
}

/// Time of so many steps more, if each takes as long as these have in the mean; none where nothing is known.
fn time_left(taken: u64, more: u64, elapsed: Duration) -> Duration {
    let seconds = elapsed.as_secs_f64() * more as f64 / taken.max(1) as f64;
    if taken == 0 { Duration::ZERO } else { Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX) }
}

/// Work that is being done.
#[derive(Debug)]
pub(crate) struct Work {
    bar: ProgressBar,
    begin: Begin,
    /// When the last line was written, where there is no bar.
    lines: Option<Mutex<Cell<Instant>>>,
}

impl Work {
    /// So many steps are done; `message` is asked for only where it is shown.
    pub(crate) fn done(&self, steps: u64, message: impl FnOnce() -> String) {
        if !self.bar.is_hidden() {
            self.bar.set_message(message());
            self.bar.set_position(steps);
        } else if let Some(last) = &self.lines {
            self.bar.set_position(steps);
            let last = last.lock().expect("nobody panics while writing a line");
            if last.get().elapsed() >= LINE_INTERVAL {
                last.set(Instant::now());
                self.line(&message());
            }
        }
    }

    /// So many steps are behind it already, and took so many seconds. Clocks of some systems begin when the machine starts;
    /// what began before that is shown as if it began now.
    pub(crate) fn gone_on(self, steps: u64, seconds: f64) -> Self {
        let elapsed = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        let since = Instant::now().checked_sub(elapsed);
        let bar = self.bar.with_elapsed(since.map_or(Duration::ZERO, |_| elapsed)).with_position(steps);
        let begin = Begin::now(steps);
        bar.set_style(style(begin));
        Self { bar, begin, ..self }
    }

    /// So many steps there are, as it turns out.
    pub(crate) fn set_steps(&self, steps: u64) {
        self.bar.set_length(steps);
    }

    /// Nothing is left on the terminal.
    pub(crate) fn finish(self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, message: &str) {
        let (done, all) = (self.bar.position(), self.bar.length().unwrap_or(0));
        let left = self.begin.left(done, all).as_secs();
        let gap = if message.is_empty() { "" } else { ", " };
        tracing::info!("{} {done}/{all}{gap}{message}, {left} s left", self.bar.prefix());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_counts_from_the_step_that_was_gone_on_from() {
        let ten = Duration::from_secs(10);
        assert_eq!(time_left(100, 900, ten), Duration::from_secs(90));
        assert_eq!(time_left(0, 900, ten), Duration::ZERO, "nothing is known yet");
        assert_eq!(time_left(100, 0, ten), Duration::ZERO);
        let begin = Begin { steps: 5000, time: Instant::now() - ten };
        let left = begin.left(5100, 6000).as_secs();
        assert!((90..120).contains(&left), "{left} s for 900 steps, where 100 took 10 s");
        let work = work("training", 6000).gone_on(5000, 1000.0);
        assert_eq!(work.begin.steps, 5000, "steps of an earlier program took none of this one's time");
    }

    #[test]
    fn work_goes_on_whatever_the_clock_says_of_its_beginning() {
        for seconds in [0.0, 3600.0, 3.2e9, 1e20, f64::INFINITY, f64::NAN, -1.0] {
            let work = work("training", 10).gone_on(4, seconds);
            assert_eq!(work.bar.position(), 4, "{seconds}");
        }
    }
}
