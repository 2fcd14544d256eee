//! The program `specula`.

use pyo3::prelude::*;
use specula::CommandLine;
use std::ffi::OsString;

/// Runs the program with these arguments, and returns its exit code; `program` are the words that
/// start it again. The program handles Ctrl-C from then on; a process can run it once.
#[pyfunction]
pub(crate) fn run_program(py: Python<'_>, program: Vec<OsString>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| specula::run_as(CommandLine { program, arguments }))
}
