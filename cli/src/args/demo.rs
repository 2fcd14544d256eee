//! Arguments of `specula demo`.

use super::parse::positive;
use clap::Args;
use std::path::PathBuf;

/// Default folder of the demo.
pub(crate) const FOLDER: &str = "out/demo";
/// Default steps of each of the demo's trainings.
pub(crate) const ITERATIONS: u32 = 1500;

/// Train a small reflective scene that ships with the program, and show every feature on it.
///
/// Plain Gaussian splatting (3dgs) and specula are trained for the same number of iterations with
/// the same settings. Their measures are printed as a table and written to OUT/results.json;
/// OUT/index.html shows the pictures, and OUT/ball.html the scene itself in a browser with WebGPU.
#[derive(Args, Debug)]
#[command(after_help = "Example:\n  specula demo -o out/demo")]
pub(crate) struct Demo {
    /// Output folder.
    #[arg(long, short, value_name = "OUT", default_value = FOLDER)]
    pub(crate) output: PathBuf,
    /// Iterations of each of the two trainings.
    #[arg(long, value_name = "N", default_value_t = ITERATIONS, value_parser = positive::<u32>)]
    pub(crate) iterations: u32,
}
