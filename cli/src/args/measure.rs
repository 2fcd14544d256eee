//! Arguments of the commands that measure: `specula eval`, `specula compare` and `specula report`.

use super::{
    parse::downscale,
    render::Split,
    scene::{MachineOptions, ProfileName},
};
use crate::background::Background;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Measure a model on held-out views: PSNR, SSIM, FLIP, and the normals' error where true normals are known.
///
/// PSNR, SSIM and FLIP are those of 8-bit pictures, image by image, then the mean. The normals' error is the mean angle
/// in degrees over pixels whose true alpha exceeds one half. Where the data set has lights and true pictures under them
/// (relight/NAME.hdr and relight/NAME/), relightings are measured too, as they are and with the best factor for each of
/// red, green and blue.
///
/// Measures of the test views are written to MODEL/results.json and MODEL/per_view.json under ours_N, or, with other
/// settings than in training, under a longer name such as ours_N_f16 or ours_N_r4. MODEL/test/ours_N/index.html shows every
/// view beside its truth and its error, the worst first.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula eval out/chair
  specula eval out/chair --storage f16
  specula eval scene.ply -s data/chair --background white --json")]
pub(crate) struct Eval {
    /// Folder of a model, or a PLY file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// Folder of the data set; the one that the model was trained on by default.
    #[arg(long, short, value_name = "DATASET")]
    pub(crate) source_path: Option<PathBuf>,
    /// Views to measure.
    #[arg(long, value_enum, default_value_t = Split::Test)]
    pub(crate) split: Split,
    /// Make pictures 1, 2, 4 or 8 times smaller; as in training by default.
    #[arg(long, short, value_name = "1|2|4|8", value_parser = downscale)]
    pub(crate) resolution: Option<u32>,
    /// Background of transparent pictures; the training's by default.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<Background>,
    /// Profile to read the attributes by, where the scene names none or a wrong one.
    #[arg(long, value_enum)]
    pub(crate) profile: Option<ProfileName>,
    #[command(flatten)]
    pub(crate) machine: MachineOptions,
    /// Measure PSNR once more after the affine map of colours that fits each true picture best, as always for models trained
    /// with --exposure. It is fitted to the truth, so no measure of a prediction.
    #[arg(long)]
    pub(crate) exposure: bool,
    /// Measure LPIPS too, by the network in this file, which scripts/lpips-onnx.py writes; slow.
    #[arg(long, value_name = "FILE.onnx")]
    pub(crate) lpips: Option<PathBuf>,
    /// Folder for the page; MODEL/test/ours_N by default.
    #[arg(long, short, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Print the measures as JSON, view by view.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Print a table of runs, as papers have them: quality, Gaussians, training time, size.
///
/// It reads what training and eval wrote into each RUN (results.json, per_view.json, specula.json, config.toml,
/// cameras.json) and computes nothing; for a measure that a run lacks it names the command. Runs of one scene are rows of one
/// table. Of several scenes there is a table for each quantity, with a column for each scene and their mean
/// where a row has all of them. Rows are called by their profile, and by the settings in which runs differ. The best of
/// a column is bold.
///
/// Unequal runs of one scene (other iterations, data sets, resolutions, numbers of training views; other test views,
/// backgrounds, networks for LPIPS) get a warning, columns for what differs in training, and no bold. Size is that of the
/// Gaussians and the light. Models of INRIA's and the authors' tools are read as far as they hold the same.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula compare out/chair out/plain
  specula compare out/*-3dgs out/*-specula -o table.tex
  specula compare out/* --format csv")]
pub(crate) struct Compare {
    /// Folders of models.
    #[arg(value_name = "RUN", required = true)]
    pub(crate) runs: Vec<PathBuf>,
    /// Format of the table; by default that of the file's ending, or Markdown.
    #[arg(long, value_enum)]
    pub(crate) format: Option<TableFormat>,
    /// File for the table, instead of stdout.
    #[arg(long, short, value_name = "FILE.md|.csv|.tex")]
    pub(crate) output: Option<PathBuf>,
}

/// How a table is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TableFormat {
    /// For people, the best in bold.
    Markdown,
    /// Numbers in full, for other programs.
    Csv,
    /// A tabular that needs no package, the best in bold.
    Latex,
}

/// Measure how far pictures of a scene are from exact ones, and what that saves: error against run time.
///
/// Every knob is turned alone, all others at their most exact, and then all together: storage, the light's filter and
/// resolution, harmonics, least alpha, least transmittance, extent of splats, light per pixel or Gaussian, channels. Pictures
/// are compared with the same pipeline in f64 with nothing cut off. The cheapest settings for 30, 40, 50 and 60 dB go to
/// stdout as a table; OUT/report.jsonl has every number, OUT/index.html plots and tables, with how scenes at the edges of
/// what is valid fare. Everything runs on the processor.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula report                                 of the demo's scene, in three minutes
  specula report out/chair -o out/chair-report --size 200")]
pub(crate) struct Report {
    /// Folder of a model, or a PLY file; the demo's scene by default, which is trained first if the demo has not been run.
    #[arg(value_name = "SCENE")]
    pub(crate) model: Option<PathBuf>,
    /// Folder for the report.
    #[arg(long, short, value_name = "OUT", default_value = "out/report")]
    pub(crate) output: PathBuf,
    /// Views, evenly spread over the test views.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) views: u16,
    /// Pixels along the longer edge of a picture, at most.
    #[arg(long, value_name = "PX", default_value_t = 160, value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub(crate) size: u32,
    /// How often each setting is timed.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) repeats: u32,
    /// Skip the scenes at the limits of valid input, which are the same for every scene.
    #[arg(long)]
    pub(crate) no_stability: bool,
}
