//! Arguments of `specula make`.

use super::{capture::CaptureOptions, parse::finite};
use clap::Args;
use specula_scene::lamps::SunChoice;
use std::path::PathBuf;

/// Make a relit turntable of a video or of photographs: capture, train, eval, relight and export.
///
/// OUT receives the data set (data), the model (model), a turntable under each light, the scene as
/// a page for browsers (scene.html) and index.html, a page in one file. Each command line is
/// printed. After Ctrl-C the same command continues. With other lights, or with masks, it computes
/// only what depends on them.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula make walk.mov -o out/vase
  specula make photographs -o out/vase --quick
  specula make photographs -o out/vase --env studio.hdr --sun 30,45
  specula make photographs -o out/vase --masks silhouettes --best")]
pub(crate) struct Make {
    /// Videos, and folders of pictures; or a data set, whose cameras are kept.
    #[arg(value_name = "INPUT", required = true)]
    pub(crate) inputs: Vec<PathBuf>,
    /// Output folder.
    #[arg(long, short, value_name = "OUT")]
    pub(crate) output: PathBuf,
    /// A first look: 2000 iterations on pictures of about 400 pixels along an edge; --best then
    /// applies to the cameras only.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Environment map of each turntable, as relight --env.
    #[arg(long, value_name = "FILE|NAME", num_args = 1.., default_values = ["sunset", "forest"])]
    pub(crate) env: Vec<PathBuf>,
    /// Exposure of the maps in stops; 1 doubles them.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(crate) exposure: f32,
    /// Sun beside the maps, as relight --sun.
    #[arg(long, value_name = "AZ,EL[,STRENGTH[,ANGLE]][:RRGGBB]", allow_hyphen_values = true)]
    pub(crate) sun: Vec<SunChoice>,
    /// Add ground that catches the shadows; always done without masks.
    #[arg(long)]
    pub(crate) ground: bool,
    #[command(flatten)]
    pub(crate) capture: CaptureOptions,
}
