//! Arguments of `specula demo`.

use super::parse::positive;
use clap::Args;
use std::path::PathBuf;

/// Default folder of the demo.
pub(crate) const FOLDER: &str = "out/demo";
/// Default steps of each of the demo's trainings.
pub(crate) const ITERATIONS: u32 = 1500;

/// Train a small reflective scene that comes with the program, and make pictures of all that can be done with it.
///
/// Plain Gaussian splatting (3dgs) and specula are trained for equally many steps with equal settings. A table of both
/// goes to stdout and to OUT/results.json; OUT/index.html shows the pictures.
#[derive(Args, Debug)]
#[command(after_help = "Example:\n  specula demo -o out/demo")]
pub(crate) struct Demo {
    /// Folder for everything that the demo makes.
    #[arg(long, short, value_name = "OUT", default_value = FOLDER)]
    pub(crate) output: PathBuf,
    /// Steps of each of the two trainings.
    #[arg(long, value_name = "N", default_value_t = ITERATIONS, value_parser = positive::<u32>)]
    pub(crate) iterations: u32,
}
