//! Python for the scripts: `python3`, or `$SPECULA_PYTHON`.

use std::process::Command;

/// A command that runs Python.
pub(crate) fn python() -> Command {
    Command::new(std::env::var_os("SPECULA_PYTHON").unwrap_or_else(|| "python3".into()))
}

/// Whether Python has these modules; says so where a test is left out.
pub(crate) fn has_python(modules: &str) -> bool {
    let import = format!("import {modules}");
    let found = python().args(["-c", &import]).output().is_ok_and(|output| output.status.success());
    if !found {
        eprintln!("NOT TESTED, because there is no python3 with {modules}");
    }
    found
}
