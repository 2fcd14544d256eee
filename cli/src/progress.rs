//! Notes and progress on stderr. Notes are the `tracing` events of the program and its libraries,
//! printed as one line each. Progress is a bar on a terminal, else a line every few seconds.

use crate::time_left::{Plan, Spoken, TimeLeft};
use core::{cell::Cell, fmt, time::Duration};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use specula_scene::text::printable;
use std::{
    io::{self, IsTerminal, stderr},
    sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError},
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

thread_local! {
    /// Whether the command is a part of another one.
    static IS_INNER: Cell<bool> = const { Cell::new(false) };
}

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

/// Prints what can be done next, a line each; nothing within [`without_next`].
pub(crate) fn note_next(steps: impl IntoIterator<Item = String>) {
    if !IS_INNER.get() {
        steps.into_iter().for_each(|step| tracing::info!("next: {step}"));
    }
}

/// Runs a command that is a part of another one, without its next steps.
pub(crate) fn without_next<T>(command: impl FnOnce() -> T) -> T {
    let was_inner = IS_INNER.replace(true);
    let done = command();
    IS_INNER.set(was_inner);
    done
}

/// Starts the progress of `steps` steps; silent if notes are.
pub(crate) fn work(title: &str, steps: u64) -> Work {
    let is_quiet = is_quiet();
    let is_terminal = stderr().is_terminal();
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
    let bar = if is_terminal && !is_quiet { BARS.add(bar) } else { bar };
    let template = "{prefix:>12} {wide_bar:.green/dim} {human_pos}/{human_len}  {msg}  {spent} < {left}";
    let style = ProgressStyle::with_template(template).expect("the template is valid");
    let left = Arc::<Mutex<TimeLeft>>::default();
    let known = Arc::clone(&left);
    let write_left = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        // Failing to write a bar must not stop the program.
        let _ = match shown_seconds(&locked(&known), state.pos(), state.len().unwrap_or(0)) {
            Some(seconds) => write!(out, "{}", Spoken(seconds)),
            None => write!(out, "?"),
        };
    };
    let write_spent = |state: &ProgressState, out: &mut dyn fmt::Write| {
        let _ = write!(out, "{}", Spoken(state.elapsed().as_secs_f64()));
    };
    let style = style.with_key("left", write_left).with_key("spent", write_spent);
    bar.set_style(style.progress_chars("━━─"));
    bar.set_prefix(title.to_owned());
    let last_line = (!is_terminal && !is_quiet).then(|| Mutex::new(Instant::now()));
    Work { bar, start: Instant::now(), left, last_line }
}

/// Format of a note: the program's name and the sentence, in one line, whatever text a library or a
/// file contributes.
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
    start: Instant,
    left: Arc<Mutex<TimeLeft>>,
    /// Time of the last line; `None` where a bar is drawn, or nothing.
    last_line: Option<Mutex<Instant>>,
}

impl Work {
    /// Shows that `steps` steps are done. Calls `message` only if it is shown.
    pub(crate) fn done(&self, steps: u64, message: impl FnOnce() -> String) {
        locked(&self.left).advance(steps, self.start.elapsed().as_secs_f64());
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
    /// only, with the plan. Clocks of some systems start with the machine; an earlier start is
    /// shown as zero.
    pub(crate) fn resumed(self, steps: u64, seconds: f64, plan: Plan) -> Self {
        *locked(&self.left) = TimeLeft::new(plan, steps);
        let elapsed = Duration::try_from_secs_f64(seconds).unwrap_or_default();
        let since = Instant::now().checked_sub(elapsed);
        let bar = self.bar.with_elapsed(since.map_or(Duration::ZERO, |_| elapsed)).with_position(steps);
        bar.tick();
        Self { bar, start: Instant::now(), ..self }
    }

    /// Replaces the plan of the remaining steps.
    pub(crate) fn replan(&self, plan: Plan) {
        locked(&self.left).replan(plan);
    }

    /// Sets the number of steps.
    pub(crate) fn set_steps(&self, steps: u64) {
        self.bar.set_length(steps);
    }

    /// Shows that `done` of `all` steps are done.
    pub(crate) fn done_of(&self, done: usize, all: usize) {
        self.set_steps(all as u64);
        self.done(done as u64, String::new);
    }

    /// Removes the bar.
    pub(crate) fn finish(self) {
        self.bar.finish_and_clear();
    }

    fn print_line(&self, message: &str) {
        let (done, all) = (self.bar.position(), self.bar.length().unwrap_or(0));
        let gap = if message.is_empty() { "" } else { ", " };
        let left = shown_seconds(&locked(&self.left), done, all);
        let left = left.map_or(String::new(), |seconds| format!(", {} left", Spoken(seconds)));
        tracing::info!("{} {done}/{all}{gap}{message}{left}", self.bar.prefix());
    }
}

/// Seconds left, once the steps done say something about the others.
fn shown_seconds(left: &TimeLeft, done: u64, all: u64) -> Option<f64> {
    const SHARE: u64 = 50;
    if SHARE * done < all { None } else { left.seconds(all) }
}

/// Locks the estimate, even after a panic of another thread.
fn locked(left: &Mutex<TimeLeft>) -> MutexGuard<'_, TimeLeft> {
    left.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_resumes_with_any_elapsed_time() {
        for seconds in [0.0, 3600.0, 3.2e9, 1e20, f64::INFINITY, f64::NAN, -1.0] {
            let work = work("training", 10).resumed(4, seconds, Plan::default());
            assert_eq!(work.bar.position(), 4, "{seconds}");
        }
    }
}
