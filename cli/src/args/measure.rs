//! Arguments of the commands that measure: `specula eval`, `specula compare` and `specula report`.

use super::{
    parse::downscale,
    render::SplitName,
    scene::{AntialiasedOption, OwnLightOption, ProfileName, RendererOptions, ShadingOption},
};
use clap::{Args, ValueEnum};
use specula_scene::backdrop::BackgroundColor;
use std::path::PathBuf;

/// Measure a model on held-out views: PSNR, SSIM, FLIP, normals, materials and light.
///
/// PSNR, SSIM and FLIP are computed per 8-bit picture and averaged. The error of normals is the
/// mean angle in degrees over pixels whose true alpha exceeds one half, for data sets with normal
/// maps; the weighted one counts each pixel by the product of rendered and true opacity, as
/// Ref-NeRF does. For data sets with relit ground truth (relight/NAME.hdr and relight/NAME/),
/// relighting is measured too, without scaling, with the best scale per colour channel, and with
/// that of each view.
///
/// Models with materials are also measured against true materials (r_0_albedo.png and
/// r_0_material.png beside a test picture) and a true light (env.hdr in the data set's folder),
/// where there are any: albedo after the best scale per channel, roughness, metalness,
/// correlation and brightness of the light, and relighting with the scaled albedo.
///
/// Measures of the test views are written to MODEL/results.json and MODEL/per_view.json under
/// ours_N, or, with settings that differ from training, under a longer name such as ours_N_f16 or
/// ours_N_r4. MODEL/test/ours_N/index.html shows each view beside its ground truth and its error,
/// the worst first.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula eval out/chair
  specula eval out/chair --storage f16
  specula eval scene.ply -s data/chair --background white --json")]
pub(crate) struct Eval {
    /// Model folder, .ply, .glb, .spz or .splat file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// Data set folder; by default the one that the model was trained on.
    #[arg(long, short, value_name = "DATASET")]
    pub(crate) source_path: Option<PathBuf>,
    /// Views to measure.
    #[arg(long, value_enum, default_value_t = SplitName::Test)]
    pub(crate) split: SplitName,
    /// Downscale the pictures by this factor; by default as in training.
    #[arg(long, short, value_name = "1|2|4|8", value_parser = downscale)]
    pub(crate) resolution: Option<u32>,
    /// Background behind transparent pictures; by default that of the training.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<BackgroundColor>,
    /// Profile that the attributes are read with, if the scene names none or a wrong one.
    #[arg(long, value_enum)]
    pub(crate) profile: Option<ProfileName>,
    #[command(flatten)]
    pub(crate) antialiased: AntialiasedOption,
    #[command(flatten)]
    pub(crate) light: OwnLightOption,
    #[command(flatten)]
    pub(crate) shading: ShadingOption,
    #[command(flatten)]
    pub(crate) renderer: RendererOptions,
    /// Also measure PSNR after the affine colour map that best fits each ground-truth picture, as
    /// is done for models trained with --exposure. The map is fitted to the ground truth, so this
    /// does not measure a prediction.
    #[arg(long)]
    pub(crate) exposure: bool,
    /// Also measure LPIPS with this network, written by scripts/lpips-onnx.py; slow.
    #[arg(long, value_name = "FILE.onnx")]
    pub(crate) lpips: Option<PathBuf>,
    /// Folder for the page; by default MODEL/test/ours_N.
    #[arg(long, short, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Print the measures of each view as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Compare runs in a table: quality, number of Gaussians, training time and size.
///
/// The figures are read from the files that train and eval write to each RUN (results.json,
/// per_view.json, specula.json, config.toml, cameras.json). Nothing is computed; for a missing
/// measure, the command that produces it is printed. Runs of one scene are the rows of one table.
/// For several scenes there is one table per quantity, with a column per scene, and the mean of
/// rows that are complete. Rows are labelled by profile and by the settings that differ between
/// runs. Runs that differ only in their seed share a row: their mean ± the standard deviation. The
/// best value of a column is bold.
///
/// Runs of one scene that are not comparable (different iterations, data sets, resolutions or
/// numbers of training views; different test views, backgrounds or LPIPS networks) cause a warning,
/// columns for the training settings that differ, and no bold; so do runs that were trained without
/// --eval, on the views that they were measured on. Size is that of the Gaussians and the light.
/// Models of INRIA's and the GaussianShader authors' tools are supported as far as they
/// contain the same files.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula compare out/chair out/plain
  specula compare out/*-3dgs out/*-specula -o table.tex
  specula compare out/chair-* --format csv")]
pub(crate) struct Compare {
    /// Model folders.
    #[arg(value_name = "RUN", required = true)]
    pub(crate) runs: Vec<PathBuf>,
    /// Format of the table; by default that of the file extension, or Markdown.
    #[arg(long, value_enum)]
    pub(crate) format: Option<TableFormat>,
    /// Output file, instead of stdout.
    #[arg(long, short, value_name = "FILE.md|.csv|.tex")]
    pub(crate) output: Option<PathBuf>,
}

/// Format of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TableFormat {
    /// Markdown, the best values in bold.
    Markdown,
    /// Comma-separated values with all digits, for other programs.
    Csv,
    /// LaTeX tabular with the rules of booktabs, the best values in bold.
    Latex,
}

/// Measure the error of rendered pictures against exact ones, and the run time that it saves.
///
/// Settings are varied one at a time, with all others at their most exact, and then together:
/// storage, filter and resolution of the light, degree of the harmonics, alpha and transmittance
/// cutoffs, extent of splats, light per pixel or per Gaussian, channels. Pictures are compared with
/// the same pipeline in f64 without cutoffs. The cheapest settings for 30, 40, 50 and 60 dB are
/// printed as a table. OUT/report.jsonl contains all numbers, OUT/index.html plots and tables,
/// including scenes at the limits of valid input. All measurements run on the CPU.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula report                               # the demo's scene, in three minutes
  specula report out/chair -o out/chair-report --size 200")]
pub(crate) struct Report {
    /// Model folder, .ply, .glb, .spz or .splat file; by default the demo's scene, which is trained
    /// first unless the demo has been run.
    #[arg(value_name = "SCENE")]
    pub(crate) model: Option<PathBuf>,
    /// Output folder.
    #[arg(long, short, value_name = "OUT", default_value = "out/report")]
    pub(crate) output: PathBuf,
    /// Number of views, evenly spaced among the test views.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) views: u16,
    /// Maximum length of the longer edge of a picture, in pixels.
    #[arg(long, value_name = "PX", default_value_t = 160, value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub(crate) size: u32,
    /// Number of times that each setting is timed.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) repeats: u32,
    /// Skip the scenes at the limits of valid input, which do not depend on SCENE.
    #[arg(long)]
    pub(crate) no_stability: bool,
}
