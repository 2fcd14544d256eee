//! Arguments of `specula info`, `specula doctor` and the hidden command that tries a network.

use clap::Args;
use std::path::PathBuf;

/// Print the contents of a model, a PLY file or a data set.
///
/// For a scene it also prints the data that pictures of its colours skip because they do not depend on it, and the saving:
/// bytes read of a Gaussian, numbers that a splat blends into a pixel, texels of light that are filtered. specula render
/// --verify-omissions shows that no bit of a picture changes.
#[derive(Args, Debug)]
#[command(
    after_help = "Examples:\n  specula info out/chair\n  specula info scene.ply --json\n  specula info data/chair"
)]
pub(crate) struct Info {
    /// Folder of a model, a PLY file, or folder of a data set.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    /// Print it as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// List the hardware that specula can use: threads, vectors, GPUs and their limits.
///
/// It marks the adapter that --executor auto uses, with the reason. A driver that computes on the CPU, such as llvmpipe, is
/// listed and can be named, but is never preferred to the CPU executor.
#[derive(Args, Debug)]
#[command(after_help = "Examples:\n  specula doctor\n  specula render out/chair --executor gpu:llvmpipe")]
pub(crate) struct Doctor {
    /// Print it as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// A network that is tried.
#[derive(Args, Debug)]
pub(crate) struct TryNetwork {
    /// Its file.
    pub(crate) network: PathBuf,
    /// Width and height of pictures that it is tried on.
    #[arg(long, num_args = 2)]
    pub(crate) size: Vec<u32>,
}
