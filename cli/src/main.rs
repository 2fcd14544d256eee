//! The program, as a single rank.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(specula::run(&specula::Ranks::alone()))
}
