//! specula fits, renders and relights scenes of 3D Gaussians that carry a shading function.
//!
//! This library is the program itself, for programs that connect several ranks of a training before
//! they start it ([`run`]), and for interpreters that have it in a module ([`run_as`]). Scenes are
//! trained and rendered by the crate `specula-scene`.

mod args;
mod certified;
mod command_line;
mod commands;
mod config;
mod dataset;
mod failure;
mod help;
mod included;
mod interrupt;
mod lights;
mod manifest;
mod memory;
mod output;
mod progress;
mod ranks;
mod scene;
mod settings;
mod time_left;
mod training;
mod truth;
mod video;

pub use command_line::CommandLine;
pub use ranks::{Ranks, local_rank};

use args::{Arguments, Command};
use clap::error::ErrorKind;
use core::panic::AssertUnwindSafe;
use failure::{Failure, shortened};
use specula_scene::{ExecutorChoice, text::printable};
use std::{
    ffi::OsString,
    io::{Write, stderr},
};

/// Runs the command line of this process, as one of several ranks or as the only one. Returns the
/// exit code: 0 for success, 1 for a fault of the program or findings of `info --strict`, 2 for bad
/// input, 130 if interrupted.
pub fn run(ranks: &Ranks<'_>) -> u8 {
    let arguments = match Arguments::parse_words(command_line::given().words()) {
        Ok(arguments) => arguments,
        // All ranks have the same command line.
        Err(error) if !ranks.is_first() => return if error.use_stderr() { 2 } else { 0 },
        Err(error) => return explain(&error),
    };
    progress::init(arguments.quiet, ranks.is_first());
    interrupt::ignore_file_size_signal();
    let done = std::panic::catch_unwind(AssertUnwindSafe(|| start(arguments, ranks)));
    match done.or_else(|payload| Failure::out_of_memory(payload.as_ref()).map(Err).ok_or(())) {
        Ok(Ok(()) | Err(Failure::BrokenPipe)) => 0,
        Ok(Err(failure)) => {
            tracing::error!("{}{}", ranks.prefix(), shortened(&failure.to_string()));
            failure.exit_code()
        }
        // The panic hook has printed the message of a panic.
        Err(()) => 1,
    }
}

/// Runs a command line in the place of this process's own, as the only rank; see [`run`] for the
/// exit code.
///
/// # Panics
///
/// If the process has run one before: its settings and threads are those of the first.
pub fn run_as(command_line: CommandLine) -> u8 {
    command_line::set(command_line);
    run(&Ranks::alone())
}

/// Runs a command, with settings from files if it names any.
fn start(arguments: Arguments, ranks: &Ranks<'_>) -> Result<(), Failure> {
    let words = args::words_of(command_line::given().words());
    match manifest::of(&arguments, &words)? {
        Some(manifest) if manifest.is_listed => commands::train::many::list(&manifest),
        Some(manifest) => {
            set_threads(arguments.threads)?;
            commands::train::many::run(&manifest, ranks)
        }
        None => run_command(&config::completed(arguments, &words)?, ranks),
    }
}

fn set_threads(threads: Option<u16>) -> Result<(), Failure> {
    if let Some(threads) = threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global().map_err(|error| Failure::Internal(error.to_string()))?;
    }
    Ok(())
}

/// Runs a command as a part of another one, by its command line.
fn run_words(words: Vec<OsString>) -> Result<(), Failure> {
    let arguments = Arguments::parse_words(words.clone())?;
    let completed = config::completed(arguments, &args::words_of(words))?;
    progress::without_next(|| run_command(&completed, &Ranks::alone()))
}

fn run_command(arguments: &Arguments, ranks: &Ranks<'_>) -> Result<(), Failure> {
    set_threads(arguments.threads)?;
    if !matches!(arguments.command, Command::Train(_)) && ranks.size > 1 {
        return Err(Failure::Input("only trainings run on several ranks; run this command with specula".into()));
    }
    arguments.command.executor().map_or(Ok(()), ExecutorChoice::check)?;
    match &arguments.command {
        Command::Demo(args) => commands::demo::run(args),
        Command::Capture(args) => commands::capture::run(args),
        Command::Make(args) => commands::make::run(args),
        Command::Train(args) => commands::train::run(args, ranks),
        Command::Render(args) => commands::render::run(args),
        Command::Relight(args) => commands::relight::run(args),
        Command::FitLight(args) => commands::fit_light::run(args),
        Command::Eval(args) => commands::eval::run(args),
        Command::Compare(args) => commands::compare::run(args),
        Command::View(args) => commands::view::run(args),
        Command::Export(args) => commands::export::run(args),
        Command::Prefilter(args) => commands::prefilter::run(args),
        Command::Report(args) => commands::report::run(args),
        Command::Info(args) => commands::info::run(args),
        Command::Doctor(args) => commands::doctor::run(args),
        Command::TryNetwork(args) => commands::eval::trial::run(args),
    }
}

/// Prints help to stdout, or the error of the arguments as one sentence to stderr.
fn explain(error: &clap::Error) -> u8 {
    let words = command_line::given().words();
    match error.kind() {
        ErrorKind::DisplayHelp => help::print(&words),
        ErrorKind::DisplayVersion => {
            // A closed stdout is no error.
            let _ = error.print();
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            // A closed stderr is no error, here and below.
            let _ = write!(stderr(), "{error}");
            return 2;
        }
        _ => {
            let command = help::command_of(&words).map_or(String::new(), |name| format!("{name} "));
            let sentence = printable(&failure::sentence_of(error));
            let _ = writeln!(stderr(), "specula: {sentence}; see specula {command}--help");
            return 2;
        }
    }
    0
}
