//! Events of a training to report to the user.

use core::fmt::{self, Display, Formatter};
use std::path::PathBuf;

/// Event of a training to report to the user.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Note<E> {
    /// The training runs on a GPU.
    StartsOnGpu {
        /// Name of the adapter.
        name: String,
        /// Whether its driver computes on the CPU.
        is_software: bool,
        /// Number of the GPU, from 1, and count of the GPUs of this machine's ranks; `None` for a
        /// training on one rank.
        place: Option<(usize, usize)>,
    },
    /// The training runs on the CPU.
    StartsOnCpu {
        /// Number of threads.
        threads: usize,
    },
    /// The GPU failed before the first step; the CPU takes over.
    GpuRefused {
        /// Failure of the GPU.
        error: E,
    },
    /// The GPU failed; the CPU takes over.
    GpuFailed {
        /// Failure of the GPU.
        error: E,
        /// Path and iteration of the checkpoint that the CPU continues from; none for the start.
        checkpoint: Option<(PathBuf, u32)>,
    },
    /// A checkpoint could not be written; the training continues.
    CheckpointFailed {
        /// Failure of the file.
        error: E,
    },
}

impl<E: Display> Display for Note<E> {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::StartsOnGpu { name, is_software, place } => {
                match is_software {
                    true => write!(out, "training on {name}, a driver that computes on the CPU")?,
                    false => write!(out, "training on the GPU {name}")?,
                }
                place.map_or(Ok(()), |(number, count)| write!(out, ", {number} of {count} of this machine"))
            }
            Self::StartsOnCpu { threads } => write!(out, "training on the CPU, {threads} threads"),
            Self::GpuRefused { error } => write!(out, "{error}; the CPU takes over"),
            Self::GpuFailed { error, checkpoint: Some((path, last)) } => {
                write!(out, "{error}; the CPU continues from iteration {last} in {path:?}")
            }
            Self::GpuFailed { error, checkpoint: None } => {
                write!(out, "{error}; there is no checkpoint yet, so the CPU starts from the beginning")
            }
            Self::CheckpointFailed { error } => write!(out, "{error}; the training continues without this checkpoint"),
        }
    }
}
