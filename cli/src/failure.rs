//! Failures that end the program, and their exit codes.

use crate::included;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use core::any::Any;
use specula_cpu::{CpuError, OutOfMemory};
#[cfg(feature = "gpu")]
use specula_gpu::GpuError;
use specula_scene::SceneError;
use std::{io, path::Path};

/// Failure that ends the program. Its text is one sentence with the file and the remedy.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// A file cannot be read or written.
    #[error("{0}{hint}", hint = hint_of(.0))]
    File(#[from] specula_io::Error),
    /// Invalid input or options.
    #[error("{0}")]
    Input(String),
    /// Another program writes to the folder.
    #[error("{0}")]
    Locked(String),
    /// A requested check of a file found faults.
    #[error("{0}")]
    Findings(String),
    /// A device failed; another executor may succeed.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only GPUs are devices"))]
    #[error("{0}")]
    Device(String),
    /// Fault of the program.
    #[error("{0}; this is a fault of the program")]
    Internal(String),
    /// The user interrupted the program; its state is saved.
    #[error("{0}")]
    Interrupted(String),
    /// The reader of stdout closed it.
    #[error("the reader of stdout closed it")]
    BrokenPipe,
}

impl Failure {
    /// Exit code: 0 for success, 1 for a fault of the program or findings of a check, 2 for bad
    /// input, 130 if interrupted.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::File(_) | Self::Input(_) | Self::Locked(_) | Self::Device(_) => 2,
            Self::Internal(_) | Self::Findings(_) => 1,
            Self::Interrupted(_) => 130,
            Self::BrokenPipe => 0,
        }
    }

    /// Error for a folder that another program trains in, with a remedy.
    pub(crate) fn locked(error: SceneError, remedy: &str) -> Self {
        match error {
            SceneError::Locked(sentence) => Self::Locked(format!("{sentence}; {remedy}")),
            other => other.into(),
        }
    }

    /// Failure for a panic about too little memory; `None` for others, whose message the hook has
    /// printed.
    pub(crate) fn out_of_memory(payload: &(dyn Any + Send)) -> Option<Self> {
        payload.downcast_ref().map(|fault: &OutOfMemory| Self::Input(format!("{fault}, with -r or --size")))
    }

    /// True for failures of a device, which the CPU executor may avoid.
    pub(crate) fn is_of_device(&self) -> bool {
        matches!(self, Self::Device(_) | Self::Internal(_))
    }
}

/// Sentence with its middle removed if it is long, such as one that quotes a file.
pub(crate) fn shortened(sentence: &str) -> String {
    const MOST: usize = 2000;
    let count = sentence.chars().count();
    if count <= MOST {
        return sentence.to_owned();
    }
    let start: String = sentence.chars().take(MOST / 2).collect();
    let end: String = sentence.chars().skip(count - MOST / 2).collect();
    format!("{start} … {end}")
}

/// Options that help against the error of a file, as the end of its sentence.
fn hint_of(error: &specula_io::Error) -> &'static str {
    use specula_io::Error::{Checkpoint, CheckpointFormat, NoCheckpoint, NoImages, TooLong};
    match error {
        TooLong { .. } => "; omit Gaussians with --min-opacity, or harmonics with --sh-degree",
        NoImages { .. } => "; give their folder, within the data set, with --images",
        NoCheckpoint { .. } => {
            "; a training writes one every --checkpoint-every steps, on Ctrl-C and at its end: use its folder, or \
             start without --resume"
        }
        Checkpoint { .. } => "; copy the file again, or start without --resume",
        CheckpointFormat { .. } => "; continue with the program that wrote it, or start without --resume",
        _ => "",
    }
}

impl From<CpuError> for Failure {
    fn from(error: CpuError) -> Self {
        match error {
            CpuError::LightResolution { .. } | CpuError::TooManySplats => Self::Input(error.to_string()),
            other => Self::Internal(other.to_string()),
        }
    }
}

impl From<specula_report::Error> for Failure {
    fn from(error: specula_report::Error) -> Self {
        use specula_report::Error;
        match error {
            Error::File(error) => error.into(),
            Error::Cpu(error) => error.into(),
            Error::Scene(error) => error.into(),
            Error::Input(sentence) => Self::Input(sentence),
            error @ (Error::Plot(_) | Error::Page(_)) => Self::Internal(error.to_string()),
        }
    }
}

#[cfg(feature = "gpu")]
impl From<GpuError> for Failure {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Refused { .. } | GpuError::TargetSize { .. } => Self::Internal(error.to_string()),
            GpuError::OutOfMemory | GpuError::Lost { .. } | GpuError::TooLarge { .. } => {
                Self::Device(with_option(&error.to_string()))
            }
            other => Self::Input(with_option(&other.to_string())),
        }
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::File(error) => error.into(),
            SceneError::Cpu(error) => error.into(),
            #[cfg(feature = "gpu")]
            SceneError::Gpu(error) => error.into(),
            SceneError::Training(sentence) => Self::Input(sentence),
            SceneError::Locked(sentence) => Self::Locked(sentence),
            SceneError::Ranks(_) | SceneError::Picture(_) => {
                Self::Input(format!("{error}; --resume continues from the last checkpoint"))
            }
            SceneError::NoCameras => {
                Self::Input(format!("{error} for --split; add cameras with --cameras, or use --turntable"))
            }
            SceneError::UnknownSplit | SceneError::NoViews(_) => {
                Self::Input(format!("{error}; use --split all or --cameras"))
            }
            SceneError::Texture(_) => Self::Input(format!("{error}; increase --texture, or decrease --triangles")),
            SceneError::NoFolder => Self::Input(format!("{error}; set one with -o")),
            SceneError::CubeMap(_) => {
                Self::Input(format!("{error}, or a light written by specula export MODEL -o light.exr"))
            }
            SceneError::GpuUnsupported => {
                Self::Input("this program was built without its feature `gpu`; use --executor cpu".into())
            }
            SceneError::ProjectionUnsupported => {
                Self::Input("GPUs support only the affine projection; use --executor cpu with --projection".into())
            }
            other => Self::Internal(other.to_string()),
        }
    }
}

/// Adds the program's options to the advice of a library: fewer Gaussians, and the CPU.
#[cfg(feature = "gpu")]
fn with_option(sentence: &str) -> String {
    let sentence = sentence.replace("fewer Gaussians", "fewer Gaussians (--max-gaussians)");
    if sentence.ends_with(" the CPU") { format!("{sentence} with --executor cpu") } else { sentence }
}

impl From<clap::Error> for Failure {
    fn from(error: clap::Error) -> Self {
        Self::Input(sentence_of(&error))
    }
}

/// Error of arguments as one sentence.
pub(crate) fn sentence_of(error: &clap::Error) -> String {
    let text = error.to_string();
    let sentences = text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let is_of_parser = |line: &&str| line.starts_with("tip: to pass '");
    let words: Vec<&str> = sentences.map(str::trim).filter(|line| !line.is_empty() && !is_of_parser(line)).collect();
    let sentence = words.join("; ").replacen("error: ", "", 1).replace(":; ", ": ");
    match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(word)) if error.kind() == ErrorKind::UnknownArgument => sentence + &advice_on(word),
        _ => sentence,
    }
}

/// Advice on a word that is no argument of a command.
fn advice_on(word: &str) -> String {
    match word {
        _ if included::light(word).is_some() => "; a light follows --env, one at a time".into(),
        "--quick" => "; only make has it: --minutes trains for a time".into(),
        "--iteration" => "; render and others open the folder of an iteration, MODEL/point_cloud/iteration_7000".into(),
        "-m" | "--model-path" => "; only train has it, others take the model without -m".into(),
        _ if word.parse::<f64>().is_ok_and(|number| number >= 0.0) => {
            "; several numbers of an option are joined by commas, as in 640,480".into()
        }
        _ if word.parse::<f64>().is_ok() => "; a negative number is not valid here".into(),
        _ if word.starts_with('-') => String::new(),
        _ if Path::new(word).extension().is_some() => format!("; if it is an output, write -o {word}"),
        _ => "; outputs are named with -o, the model of a training with -m".into(),
    }
}

/// Conversion from errors of writing to stdout.
impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => Self::BrokenPipe,
            _ => Self::Input(format!("cannot write the results to stdout: {error}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_io::Error;

    #[test]
    fn a_locked_folder_is_bad_input_with_a_remedy() {
        let failure = Failure::locked(SceneError::Locked("process 7 is writing".into()), "wait");
        assert_eq!((failure.to_string().as_str(), failure.exit_code()), ("process 7 is writing; wait", 2));
    }

    #[cfg(feature = "gpu")]
    #[test]
    fn errors_of_devices_name_the_options_that_help() {
        let too_large = GpuError::TooLarge { what: "the pairs", bytes: 1 << 31, limit: 1 << 27 };
        for error in [GpuError::OutOfMemory, too_large] {
            let sentence = Failure::from(error).to_string();
            assert!(sentence.contains("fewer Gaussians (--max-gaussians)"), "{sentence}");
            assert!(sentence.ends_with(" the CPU with --executor cpu"), "{sentence}");
        }
        let lost = GpuError::Lost { reason: "it was unplugged".into() };
        let absent = GpuError::NoAdapter { wanted: String::new() };
        let refused = GpuError::NoDevice { adapter: "lavapipe".into(), reason: "it is busy".into() };
        for error in [lost, absent, refused] {
            let sentence = Failure::from(error).to_string();
            assert!(sentence.ends_with(" the CPU with --executor cpu"), "{sentence}");
        }
    }

    #[test]
    fn errors_of_files_end_with_the_option_that_helps() {
        let (path, place, cause) = ("model".into(), "the header".to_owned(), "it is cut short".to_owned());
        let sentence = Failure::from(Error::Checkpoint { path, place, cause }).to_string();
        assert!(sentence.ends_with("it is cut short; copy the file again, or start without --resume"), "{sentence}");
        for (error, option) in [
            (Error::TooLong { path: "a.glb".into(), len: 1 << 33 }, "--min-opacity"),
            (Error::NoCheckpoint { path: "model".into() }, "--checkpoint-every"),
            (Error::CheckpointFormat { path: "model".into(), found: 2, known: 1 }, "--resume"),
            (
                Error::NoImages { data: "data".into(), path: "images".into(), first: "b.png".into(), elsewhere: None },
                "--images",
            ),
        ] {
            let fact = error.to_string();
            let sentence = Failure::from(error).to_string();
            assert!(!fact.contains("--") && sentence.starts_with(&fact), "{fact}");
            assert!(sentence.contains(option), "{option} is not in: {sentence}");
        }
    }
}
