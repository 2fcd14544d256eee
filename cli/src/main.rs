//! specula fits, renders and relights scenes of 3D Gaussians that carry a shading function.

mod args;
mod certified;
mod commands;
mod config;
mod dataset;
mod failure;
mod help;
mod interrupt;
mod output;
mod progress;
mod scene;
mod settings;
mod training;

use args::{Arguments, Command};
use clap::error::ErrorKind;
use failure::Failure;
use specula_scene::ExecutorChoice;
use std::{ffi::OsString, process::ExitCode};

/// Allocator that keeps pages between steps, each of which allocates frames and gradients anew.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Sentence without its middle, if it quotes as much as a file.
fn shortened(sentence: &str) -> String {
    const MOST: usize = 2000;
    let count = sentence.chars().count();
    if count <= MOST {
        return sentence.to_owned();
    }
    let start: String = sentence.chars().take(MOST / 2).collect();
    let end: String = sentence.chars().skip(count - MOST / 2).collect();
    format!("{start} … {end}")
}

fn main() -> ExitCode {
    let arguments = match Arguments::parse_words(std::env::args_os()) {
        Ok(arguments) => arguments,
        Err(error) => return explain(&error),
    };
    progress::init(arguments.quiet);
    interrupt::ignore_file_size_signal();
    // The panic hook has printed the message of a panic.
    match std::panic::catch_unwind(|| run(&config::completed(arguments)?)) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(Failure::BrokenPipe)) => ExitCode::SUCCESS,
        Ok(Err(failure)) => {
            tracing::error!("{}", shortened(&failure.to_string()));
            ExitCode::from(failure.exit_code())
        }
        Err(_) => ExitCode::FAILURE,
    }
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global().map_err(|error| Failure::Internal(error.to_string()))?;
    }
    arguments.command.executor().map_or(Ok(()), ExecutorChoice::check)?;
    match &arguments.command {
        Command::Demo(args) => commands::demo::run(args),
        Command::Train(args) => commands::train::run(args),
        Command::Render(args) => commands::render::run(args),
        Command::Relight(args) => commands::relight::run(args),
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
fn explain(error: &clap::Error) -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    match error.kind() {
        ErrorKind::DisplayHelp => help::print(&words),
        ErrorKind::DisplayVersion => {
            // A closed stdout is no error.
            let _ = error.print();
        }
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            eprint!("{error}");
            return ExitCode::from(2);
        }
        _ => {
            let command = help::command_of(&words).map_or(String::new(), |name| format!("{name} "));
            eprintln!("specula: {}; see specula {command}--help", failure::sentence_of(error));
            return ExitCode::from(2);
        }
    }
    ExitCode::SUCCESS
}
