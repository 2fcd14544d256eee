//! Command line of this process, and how a process starts the program again.

use std::{ffi::OsString, sync::OnceLock};

/// Command line of this process: what [`crate::run_as`] was given, otherwise its own words.
static GIVEN: OnceLock<CommandLine> = OnceLock::new();

/// Words of a command line, for processes whose own words are not those of the program, such as an
/// interpreter that has the program in a module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandLine {
    /// Words that start the program again: an executable, and those before the arguments.
    pub program: Vec<OsString>,
    /// Arguments, without the program's name.
    pub arguments: Vec<OsString>,
}

impl CommandLine {
    /// Command line of a process that is the program.
    fn of_process() -> Self {
        let mut words = std::env::args_os();
        let name = words.next().unwrap_or_else(|| "specula".into());
        let program = std::env::current_exe().map_or(name, OsString::from);
        Self { program: vec![program], arguments: words.collect() }
    }

    /// All words, the program's name first.
    pub(crate) fn words(&self) -> Vec<OsString> {
        [OsString::from("specula")].into_iter().chain(self.arguments.iter().cloned()).collect()
    }
}

/// Sets the command line of this process.
///
/// # Panics
///
/// If it is set or was read.
pub(crate) fn set(given: CommandLine) {
    assert!(GIVEN.set(given).is_ok(), "a process runs one command line");
}

/// Command line of this process.
pub(crate) fn given() -> &'static CommandLine {
    GIVEN.get_or_init(CommandLine::of_process)
}
