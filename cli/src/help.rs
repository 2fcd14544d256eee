//! Help: the common options with -h, all options in groups with --help.

use crate::args::{Arguments, is_setting};
use clap::{Arg, Command, CommandFactory};
use std::{
    ffi::OsString,
    io::{IsTerminal, Write, stdout},
};

/// Options of `specula train` that -h lists.
const FIRST: [&str; 16] = [
    "dataset",
    "model_path",
    "profile",
    "iterations",
    "resolution",
    "eval",
    "background",
    "executor",
    "preset",
    "view",
    "resume",
    "overwrite",
    "config",
    "quiet",
    "threads",
    "help",
];
/// Text below the options of -h.
const MORE: &str = "\
Examples:
  specula train data/chair -m out/chair --eval -r 2 --iterations 7k
  specula train data/garden -m out/garden --eval -r 4
  specula train -m out/chair --resume
All options, profiles, presets and more examples: specula train --help";

/// Prints the help that the words of a command line request.
pub(crate) fn print(words: &[OsString]) {
    let name = command_of(words);
    let is_of_settings =
        words.windows(2).any(|pair| pair == ["--set", "help"]) || words.iter().any(|word| word == "--set=help");
    let is_long_help = words.iter().any(|word| word == "--help" || word == "help");
    let mut help = if is_of_settings {
        settings_help()
    } else if is_long_help {
        long_help(name.as_deref())
    } else {
        short_help(name.as_deref())
    };
    let help = help.render_help();
    // A closed stdout is no error.
    let _ = if stdout().is_terminal() { write!(stdout(), "{}", help.ansi()) } else { write!(stdout(), "{help}") };
}

/// Name of the command among the words of a command line.
pub(crate) fn command_of(words: &[OsString]) -> Option<String> {
    let command = Arguments::command();
    let mut names = words.iter().skip(1).filter_map(|word| word.to_str());
    names.find(|word| command.get_subcommands().any(|one| one.get_name() == *word)).map(str::to_owned)
}

fn named(name: Option<&str>) -> Command {
    let mut command = Arguments::command();
    // Global options are only added to the commands by building.
    command.build();
    match name {
        Some(name) => command.find_subcommand(name).expect("it is one of them").clone(),
        None => command,
    }
}

/// Help with all options.
pub(crate) fn long_help(name: Option<&str>) -> Command {
    let command = named(name);
    let about = command.get_long_about().or(command.get_about()).cloned().unwrap_or_default();
    // The -h of other commands prints the same options.
    let is_shorter = name == Some("train");
    let help = if is_shorter { "Print help; -h prints the most used options" } else { "Print help" };
    let without_settings = |arg: Arg| if is_setting(&arg) { arg.hide(true) } else { arg };
    command.about(about).mut_args(without_settings).mut_arg("help", |arg| arg.help(help))
}

/// Help with the settings of a training.
fn settings_help() -> Command {
    let only_settings = |arg: Arg| if is_setting(&arg) { arg } else { arg.hide(true) };
    let command = named(Some("train")).mut_args(only_settings).after_help("");
    command
        .about("Settings of a training, as --set NAME=VALUE or --NAME VALUE; those of the profile by default.")
        .override_usage("specula train [OPTIONS] --model-path <MODEL> --set <NAME=VALUE> [DATASET]")
}

/// Help that fits on a screen.
pub(crate) fn short_help(name: Option<&str>) -> Command {
    let command = named(name);
    if name != Some("train") {
        return command;
    }
    let command = command.mut_args(|arg| {
        let is_first = FIRST.contains(&arg.get_id().as_str());
        arg.hide(!is_first).help_heading(None)
    });
    command.after_help(MORE).mut_arg("help", |arg| arg.help("Print help; --help prints all options"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> Vec<OsString> {
        line.split(' ').map(OsString::from).collect()
    }

    #[test]
    fn the_first_help_of_a_training_fits_a_screen_and_the_other_has_every_option() {
        let [first, full] = [short_help, long_help].map(|help| help(Some("train")).render_help().to_string());
        assert!(first.lines().count() <= 45, "-h has {} lines:\n{first}", first.lines().count());
        assert!(full.lines().count() <= 150, "--help has {} lines:\n{full}", full.lines().count());
        let settings = settings_help().render_help().to_string();
        let train = named(Some("train"));
        for arg in train.get_arguments() {
            let Some(long) = arg.get_long().filter(|_| !arg.is_hide_set()) else { continue };
            let is_in = |help: &str| help.split_whitespace().any(|word| word == format!("--{long}"));
            assert!(is_in(&full) || is_in(&settings), "--{long} is missing:\n{full}\n{settings}");
        }
        for name in FIRST {
            assert!(train.get_arguments().any(|arg| arg.get_id() == name), "{name} is no option");
        }
    }

    #[test]
    fn the_command_is_found_among_the_words() {
        for (line, name) in [
            ("specula --help", None),
            ("specula -q --threads 2 train --help", Some("train")),
            ("specula help render", Some("render")),
            ("specula trian", None),
        ] {
            assert_eq!(command_of(&words(line)).as_deref(), name, "{line}");
        }
    }
}
