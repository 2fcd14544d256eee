//! Other programs: started with their output in a file, watched line by line, ended on request.

use crate::error::{Error, Result};
use core::time::Duration;
use std::{
    fs::OpenOptions,
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::mpsc::{self, RecvTimeoutError},
    thread,
};

/// Interval in which a request to end is noticed.
const INTERVAL: Duration = Duration::from_millis(200);

/// Shows the progress of a capture, and requests its end.
pub trait Monitor {
    /// Begins a part of `steps` steps.
    fn begin(&self, title: &'static str, steps: u64);
    /// Shows that `steps` steps of the part are done.
    fn done(&self, steps: u64);
    /// Ends the part.
    fn end(&self);
    /// Whether the capture should end.
    fn is_interrupted(&self) -> bool;
}

/// Words of a command line as a shell reads them: quoted where necessary.
pub fn command_text<'a>(words: impl IntoIterator<Item = &'a str>) -> String {
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-_./=:,+".contains(letter);
    let quoted = |word: &str| match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    };
    words.into_iter().map(quoted).collect::<Vec<_>>().join(" ")
}

/// Command line of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct CommandLine {
    pub(crate) program: PathBuf,
    pub(crate) arguments: Vec<String>,
}

impl CommandLine {
    pub(crate) fn new(program: impl Into<PathBuf>, arguments: &[&str]) -> Self {
        Self { program: program.into(), arguments: arguments.iter().map(|word| (*word).to_owned()).collect() }
    }

    pub(crate) fn with(mut self, arguments: &[&str]) -> Self {
        self.arguments.extend(arguments.iter().map(|word| (*word).to_owned()));
        self
    }

    /// Command line as a shell reads it.
    pub(crate) fn text(&self) -> String {
        let program = self.program.to_string_lossy();
        command_text(core::iter::once(&*program).chain(self.arguments.iter().map(String::as_str)))
    }

    /// Command without input, and without a display.
    pub(crate) fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).stdin(Stdio::null()).env("QT_QPA_PLATFORM", "offscreen");
        command
    }

    /// Output of a short command; `None` if it cannot be started or fails.
    pub(crate) fn output(&self) -> Option<String> {
        let output = self.command().output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// Runs the command, appends its output to `log`, and calls `on_line` with each line.
    ///
    /// # Errors
    ///
    /// The program cannot be started or fails, or an interruption.
    pub(crate) fn run(&self, log: &Path, monitor: &dyn Monitor, mut on_line: impl FnMut(&str)) -> Result<()> {
        let failed = |message: String| Error::Program {
            program: self.program.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            message: with_remedy(message),
            log: log.to_owned(),
        };
        let mut file = OpenOptions::new().create(true).append(true).open(log).map_err(Error::writing(log))?;
        writeln!(file, "$ {}", self.text()).map_err(Error::writing(log))?;
        let mut command = self.command();
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = child.map_err(|error| failed(error.to_string()))?;
        let (sender, lines) = mpsc::channel();
        let streams: [Option<Box<dyn Read + Send>>; 2] = [
            child.stdout.take().map(|stream| Box::new(stream) as Box<dyn Read + Send>),
            child.stderr.take().map(|stream| Box::new(stream) as Box<dyn Read + Send>),
        ];
        for stream in streams.into_iter().flatten() {
            let sender = sender.clone();
            thread::spawn(move || {
                let lines = BufReader::new(stream).split(b'\n').map_while(core::result::Result::ok);
                lines.map(|line| String::from_utf8_lossy(&line).into_owned()).try_for_each(|line| sender.send(line))
            });
        }
        drop(sender);
        let mut last = String::new();
        loop {
            match lines.recv_timeout(INTERVAL) {
                Ok(line) => {
                    writeln!(file, "{line}").map_err(Error::writing(log))?;
                    on_line(&line);
                    if !line.trim().is_empty() && !is_of_full_disk(&last) {
                        last = line;
                    }
                }
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => {}
            }
            if monitor.is_interrupted() {
                // The program may have ended meanwhile.
                let _ = child.kill();
            }
        }
        let status = child.wait().map_err(|error| failed(error.to_string()))?;
        match (monitor.is_interrupted(), status.success()) {
            (true, _) => Err(Error::Interrupted),
            (_, true) => Ok(()),
            (_, false) => Err(failed(format!("{status}: {}", last.trim()))),
        }
    }
}

fn is_of_full_disk(line: &str) -> bool {
    ["No space left", "disk is full", "disk I/O error"].iter().any(|words| line.contains(words))
}

/// Error of a program, with a remedy for known ones.
fn with_remedy(message: String) -> String {
    match () {
        () if is_of_full_disk(&message) => message + "; free some space, and the same command continues",
        () if message.contains("SIGKILL") || message.contains("bad_alloc") => {
            message + "; it probably needs more memory: use fewer frames (--frames), or close other programs"
        }
        () if message.contains("ModuleNotFoundError") || message.contains("AttributeError") => {
            message + "; update it with pip install -U pycolmap"
        }
        () => message,
    }
}

/// Whether a program of ffmpeg is on the path.
pub fn is_installed(program: &str) -> bool {
    CommandLine::new(program, &["-version"]).output().is_some()
}

/// Whether ffmpeg and ffprobe are on the path.
pub fn has_ffmpeg() -> bool {
    ["ffmpeg", "ffprobe"].into_iter().all(is_installed)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Patient;

    impl Monitor for Patient {
        fn begin(&self, _: &'static str, _: u64) {}
        fn done(&self, _: u64) {}
        fn end(&self) {}
        fn is_interrupted(&self) -> bool {
            false
        }
    }

    #[cfg(unix)]
    #[test]
    fn output_is_kept_and_a_full_disk_has_a_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("a.log");
        let run = |script: &str, lines: &mut Vec<String>| {
            CommandLine::new("sh", &["-c", script]).run(&log, &Patient, |line| lines.push(line.to_owned()))
        };
        let mut lines = Vec::new();
        run("echo one; echo two >&2", &mut lines).unwrap();
        lines.sort();
        assert_eq!(lines, ["one", "two"]);
        let error = run("echo database or disk is full; echo aborted; exit 1", &mut lines).unwrap_err().to_string();
        assert!(error.contains("disk is full; free some space"), "{error}");
        let text = std::fs::read_to_string(&log).unwrap();
        assert!(text.contains("$ sh -c") && text.contains("aborted"), "{text}");
    }

    #[test]
    fn a_command_line_is_what_a_shell_reads() {
        let line = CommandLine::new("colmap", &["mapper"]).with(&["--image_path", "my pictures/it's"]);
        assert_eq!(line.text(), r"colmap mapper --image_path 'my pictures/it'\''s'");
    }
}
