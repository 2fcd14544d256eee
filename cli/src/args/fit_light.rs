//! Arguments of `specula fit-light`.

use super::parse::{downscale, executor, positive};
use clap::Args;
use specula_scene::{ExecutorChoice, backdrop::BackgroundColor};
use std::path::PathBuf;

/// Default number of steps.
const STEPS: u32 = 900;

/// Find the light of photographs of a trained object, to show it, or others, under that light.
///
/// Geometry and materials of SCENE are held, and a light is fitted to the photographs of DATASET,
/// which have cameras in the world of the scene: those of the training, or others that were
/// estimated together with them. Three to five photographs from different sides are enough. The
/// light is written as a lat-long map with the scene's up at its upper edge, for relight --env.
///
/// With --fit N it is fitted to N photographs, and the others are measured under it. As they are
/// under a light that the training has not seen, this measures relighting on photographs.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula fit-light out/spheres data/evening -o evening.exr
  specula fit-light out/spheres data/spheres --lights-by days.txt --light dusk --fit 5 -o dusk.exr
  specula relight out/spheres --env evening.exr")]
pub(crate) struct FitLight {
    /// Model with physical materials: folder, .ply or .glb file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// Data set of the photographs.
    #[arg(value_name = "DATASET")]
    pub(crate) dataset: PathBuf,
    /// Lat-long map of the light.
    #[arg(long, short, value_name = "OUT.exr|OUT.hdr")]
    pub(crate) output: PathBuf,
    /// Number of photographs that the light is fitted to, evenly spaced; all by default.
    #[arg(long, value_name = "N", value_parser = positive::<usize>)]
    pub(crate) fit: Option<usize>,
    /// Table of the light of each photograph; see docs/datasets.md.
    #[arg(long, value_name = "FILE", requires = "light")]
    pub(crate) lights_by: Option<PathBuf>,
    /// Light of the table: photographs under others are left out.
    #[arg(long, value_name = "NAME", requires = "lights_by")]
    pub(crate) light: Option<String>,
    /// Downscale the photographs by this factor; by default as in training.
    #[arg(long, short, value_name = "1|2|4|8", value_parser = downscale)]
    pub(crate) resolution: Option<u32>,
    /// Steps of the fit.
    #[arg(long, value_name = "N", default_value_t = STEPS, value_parser = positive::<u32>)]
    pub(crate) iterations: u32,
    /// Background behind transparent photographs; by default that of the training.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<BackgroundColor>,
    /// Executor: a GPU if there is one (auto), the CPU, or the GPU with NAME in its name.
    #[arg(long, value_name = "auto|cpu|gpu[:NAME]", default_value = "auto", value_parser = executor)]
    pub(crate) executor: ExecutorChoice,
    /// Print the measures of each photograph as JSON.
    #[arg(long, requires = "fit")]
    pub(crate) json: bool,
}
