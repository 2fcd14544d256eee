//! Arguments of `specula info`, `specula doctor` and the hidden command that tests an LPIPS
//! network.

use clap::Args;
use std::path::PathBuf;

/// Print the contents of a model, a file of Gaussians or a data set.
///
/// Files are also checked for faults and oddities, each with its effect on viewers: numbers that
/// are not finite, opacities and scales that are no logits and logarithms, quats that are not
/// normalised, order of columns and harmonics, missing normals, headers that break loaders.
///
/// For a scene, this includes the data that rendering colours skips because they do not depend on
/// it, and the savings: bytes read per Gaussian, channels blended per splat and pixel, texels of
/// light filtered. specula render --verify-omissions verifies that no bit of a picture changes.
///
/// For a data set, it also names what to improve: pictures without a camera, a camera that only
/// turned, blur, changes of exposure, sides that no camera sees.
#[derive(Args, Debug)]
#[command(
    after_help = "Examples:\n  specula info out/chair\n  specula info scene.ply --json\n  specula info chair.spz --strict\n  \
                  specula info data/chair"
)]
pub(crate) struct Info {
    /// Model folder, .ply, .spz, .splat or .glb file, or data set folder.
    #[arg(value_name = "PATH")]
    pub(crate) path: PathBuf,
    /// Fail if a file of Gaussians has a fault or an oddity.
    #[arg(long)]
    pub(crate) strict: bool,
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// List the available hardware: threads, SIMD level, GPUs and their limits, and the programs that
/// capture and videos use.
///
/// The adapter that --executor auto selects is marked, with the reason. Software drivers such as
/// llvmpipe are listed and can be selected by name, but auto prefers the CPU executor to them.
#[derive(Args, Debug)]
#[command(after_help = "Examples:\n  specula doctor\n  specula render out/chair --executor gpu:llvmpipe")]
pub(crate) struct Doctor {
    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// LPIPS network to test.
#[derive(Args, Debug)]
pub(crate) struct TryNetwork {
    /// ONNX file.
    pub(crate) network: PathBuf,
    /// Width and height of the test pictures.
    #[arg(long, num_args = 2)]
    pub(crate) size: Vec<u32>,
}
