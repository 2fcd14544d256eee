//! Arguments of `specula train`. Those that shape the model are serialized into its `config.toml`.

use super::{
    parse::{address, count, downscale, error_bound, executor, positive, share, token, weight},
    preset::Preset,
    scene::ProfileName,
    view,
};
use crate::{background::Background, foreground::Foreground, orientation::UpChoice};
use clap::{Args, ValueEnum};
use core::net::SocketAddr;
use serde::{Serialize, Serializer};
use specula_scene::ExecutorChoice;
use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
};

/// `-r -1`, INRIA's default: as they are, but at most 1600 pixels wide.
pub(crate) const AT_MOST_1600: u32 = 0;

/// Fit Gaussians and a light to pictures with known cameras.
///
/// DATASET is a folder with transforms_train.json (NeRF Synthetic, Shiny Blender), with sparse/0 and images (photographs
/// and COLMAP's cameras), or with transforms.json (nerfstudio, instant-ngp). MODEL becomes a folder that tools for Gaussian
/// splatting know, with the light beside the Gaussians; one training at a time writes to it.
///
/// Ctrl-C saves and exits with code 130; --resume goes on to the same model, bit for bit. Photographs, masks, lenses and
/// starts are explained in README.md and docs/guide.md.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(after_help = "\
Profiles:
  specula    the default: light looked up pixel by pixel, best measured quality
  paper      the paper's equations and weights
  official   the behaviour of the authors' code
  3dgs       plain Gaussian splatting, spherical harmonics alone
Presets:
  nerf-synthetic, shiny-blender, glossy-synthetic
                      white background, full size, 30000 iterations
  tanks-and-temples   photographs: black background, full size, every 8th held out,
                      30000 iterations
  photos              photographs, soon: black background, -r 4, every 8th held out,
                      5000 background points, 7000 iterations
Examples:
  specula train data/chair -m out/chair --eval -r 2 --iterations 7k
  specula train data/garden -m out/garden --eval -r 4       photographs, with COLMAP's cameras
  specula train data/toaster -m out/ablation --eval --profile paper --no-residual
  specula train -m out/chair --resume                       go on after Ctrl-C or a crash
  specula train -m out/chair --resume --iterations 60k      go on for longer
  specula train data/drums -m out/drums --config out/chair/config.toml")]
pub(crate) struct Train {
    /// Folder of the data set.
    #[arg(value_name = "DATASET", required_unless_present_any = ["source_path", "resume", "config"])]
    #[serde(skip)]
    pub(crate) dataset: Option<PathBuf>,
    /// The same, as other tools name it.
    #[arg(long, short, value_name = "DATASET", conflicts_with = "dataset")]
    #[serde(skip)]
    pub(crate) source_path: Option<PathBuf>,
    /// Folder for the model; made if it does not exist.
    #[arg(long, short, alias = "output", short_alias = 'o', value_name = "MODEL")]
    #[serde(skip)]
    pub(crate) model_path: PathBuf,
    /// Kind of training.
    #[arg(long, value_enum, default_value_t = ProfileName::Specula)]
    pub(crate) profile: ProfileName,
    /// Steps, such as 30000, 30k or 3e4; schedules stretch along.
    #[arg(long, value_name = "N", default_value_t = 30_000, value_parser = positive::<u32>)]
    pub(crate) iterations: u32,
    /// Make pictures 1, 2, 4 or 8 times smaller.
    #[arg(long, short, value_name = "1|2|4|8", default_value = "1", value_parser = downscale_or_rule, allow_negative_numbers = true)]
    pub(crate) resolution: u32,
    /// Hold out the test views, measure them at the end, write results.json.
    #[arg(long)]
    pub(crate) eval: bool,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    #[serde(serialize_with = "as_typed")]
    pub(crate) seed: u64,
    /// Background of transparent pictures; by default white if there are any, else black.
    #[arg(long, value_name = "black|white|R,G,B", conflicts_with = "white_background")]
    pub(crate) background: Option<Background>,
    /// The same as --background white.
    #[arg(long, short)]
    pub(crate) white_background: bool,
    /// Save at these steps as well as at the end.
    #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',', value_parser = count::<u32>)]
    pub(crate) save_iterations: Vec<u32>,
    /// Measure at these steps as well as at the end, into results.json and timeline.json; needs --eval.
    #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',', requires = "eval", value_parser = count::<u32>)]
    pub(crate) test_iterations: Vec<u32>,
    /// A GPU if there is one (auto), the CPU, or the GPU with NAME in its name; specula doctor lists them.
    #[arg(long, value_name = "auto|cpu|gpu[:NAME]", default_value = "auto", value_parser = executor)]
    pub(crate) executor: ExecutorChoice,
    /// Look for the cheapest setting whose pictures are within E of exact ones (RMS, 1 is white), measure with it, each
    /// picture verified, and write its certificate into specula.json; docs/accuracy.md.
    #[arg(long, value_name = "E", value_parser = error_bound)]
    pub(crate) max_error: Option<f64>,
    /// Accepted for GaussianShader's command lines; the residual colour's harmonics are --sh-degree here.
    #[arg(long, value_name = "N", hide = true, allow_negative_numbers = true, value_parser = clap::value_parser!(i32).range(-1..=3))]
    #[serde(skip)]
    pub(crate) brdf_dim: Option<i32>,
    #[command(flatten)]
    #[serde(skip)]
    pub(crate) watch: Watch,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) again: Again,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) photographs: Photographs,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) start: Start,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) losses: Losses,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) ablation: Ablate,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) densify: Densify,
}

impl Train {
    /// Folder of the data set, from either argument; `None` if only a file of settings could name it and does not.
    pub(crate) fn source(&self) -> Option<&Path> {
        self.dataset.as_deref().or(self.source_path.as_deref())
    }
}

/// Reading of data sets that are one list of photographs.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Photographs")]
pub(crate) struct Photographs {
    /// Folder of the images within DATASET.
    #[arg(long, short, value_name = "FOLDER", default_value = specula_io::dataset::IMAGES)]
    pub(crate) images: String,
    /// With --eval, hold out every Nth photograph by name, from the first; 0 for none.
    #[arg(long, aliases = ["llffhold", "eval-split-every"], value_name = "N", default_value_t = specula_io::dataset::TEST_EVERY, value_parser = count::<u32>)]
    pub(crate) test_every: u32,
    /// The scene's up direction, where the cameras' is wrong: an axis such as z or -y, or a vector.
    #[arg(long, value_name = "AXIS|X,Y,Z", allow_hyphen_values = true)]
    pub(crate) scene_up: Option<UpChoice>,
    /// Learn each photograph's exposure, an affine map of its colours, into MODEL/exposure.json.
    #[arg(long)]
    pub(crate) exposure: bool,
}

/// Watching a training.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Watching")]
pub(crate) struct Watch {
    /// Serve a page that shows the training and can pause it; the result does not depend on it.
    #[arg(long, value_name = "[HOST:]PORT", num_args = 0..=1, default_missing_value = view::ADDRESS, value_parser = address)]
    pub(crate) view: Option<SocketAddr>,
    /// Password of the page; by default a random one where other machines can reach it, else none.
    #[arg(long, value_name = "WORD", requires = "view", value_parser = token)]
    pub(crate) token: Option<String>,
    /// When the page ends: with the training (done), or at Ctrl-C after it (ctrl-c). By default ctrl-c where standard output
    /// is a terminal, else done, so that no script waits.
    #[arg(long, value_name = "done|ctrl-c", requires = "view", hide_possible_values = true)]
    pub(crate) view_until: Option<ViewUntil>,
}

/// The end of a page that shows a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ViewUntil {
    /// That of the training.
    Done,
    /// Ctrl-C.
    CtrlC,
}

impl ViewUntil {
    /// As somebody who looks at the output of the program expects it.
    pub(crate) fn usual() -> Self {
        if std::io::stdout().is_terminal() { Self::CtrlC } else { Self::Done }
    }
}

/// Resuming a training, or following another.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Resuming and settings")]
pub(crate) struct Again {
    /// Go on from the checkpoint in MODEL, with the settings of MODEL/config.toml.
    #[arg(long)]
    #[serde(skip)]
    pub(crate) resume: bool,
    /// Replace the training that MODEL holds: its models, results, checkpoint and pictures are removed.
    #[arg(long, conflicts_with = "resume")]
    #[serde(skip)]
    pub(crate) overwrite: bool,
    /// Write to MODEL even if another training has it locked, as network file systems may say wrongly.
    #[arg(long)]
    #[serde(skip)]
    pub(crate) ignore_lock: bool,
    /// Take options that are not given from this file, such as another model's config.toml.
    #[arg(long, value_name = "FILE.toml")]
    #[serde(skip)]
    pub(crate) config: Option<PathBuf>,
    /// Settings for a kind of data set, where neither typed nor in --config; listed by --help.
    #[arg(long, value_enum, conflicts_with = "resume", hide_possible_values = true)]
    #[serde(skip)]
    pub(crate) preset: Option<Preset>,
    /// Write MODEL/checkpoint.safetensors every N steps; 0: only on Ctrl-C and at the end.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = count::<u32>)]
    pub(crate) checkpoint_every: u32,
}

/// The start of a training.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Start")]
pub(crate) struct Start {
    /// Points to start from, instead of those of the data set.
    #[arg(long, value_name = "FILE.ply")]
    pub(crate) points: Option<PathBuf>,
    /// Start from this many random points, even if there is a point cloud; 20000 if there is none.
    #[arg(long, value_name = "N", conflicts_with = "points", value_parser = random_points)]
    pub(crate) random_points: Option<u32>,
    /// Add this many points behind those of the data set, for walls, tables and skies.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = background_points)]
    pub(crate) background_points: u32,
    /// Where Gaussians reflect the light: all; auto, within half the cameras' distance; another share of it; or the ball
    /// X,Y,Z,RADIUS.
    #[arg(long, value_name = "WHERE", default_value = "all", allow_hyphen_values = true)]
    pub(crate) foreground: Foreground,
    /// Share of the run with pictures of half their size, where a step costs less.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) coarse_until: Option<f32>,
    /// Degree of the spherical harmonics, 0 to 3; -1 for the profile's, as in GaussianShader's command lines.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(i8).range(-1..=3))]
    #[serde(skip_serializing_if = "is_of_profile")]
    pub(crate) sh_degree: Option<i8>,
    /// Look up the light for each Gaussian, as in the paper, or for each pixel (deferred).
    #[arg(long, value_enum)]
    pub(crate) light_per: Option<LightPer>,
    /// Texels along an edge of the light's faces: a power of two, at least 16 (official: 64).
    #[arg(long, alias = "brdf-env", value_name = "N", value_parser = count::<usize>)]
    pub(crate) light_resolution: Option<usize>,
}

/// Who looks the light up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum LightPer {
    /// Each Gaussian; colours are blended.
    Gaussian,
    /// Each pixel; what surfaces are is blended.
    Pixel,
}

/// Weights of the losses; those that are not given are the profile's.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Losses")]
pub(crate) struct Losses {
    /// Weight of 1 − SSIM; that of |C − C_gt| becomes one minus it.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_dssim: Option<f32>,
    /// Weight of |C − C_gt|.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_absolute: Option<f32>,
    /// Weight of (C − C_gt)².
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_squared: Option<f32>,
    /// Weight of the difference between normals and those of the depth.
    #[arg(long, alias = "lambda-predicted-normal", value_name = "X", value_parser = weight)]
    pub(crate) lambda_normal: Option<f32>,
    /// Weight of the loss that makes opacities 0 or 1.
    #[arg(long, alias = "lambda-zero-one", value_name = "X", value_parser = weight)]
    pub(crate) lambda_sparse: Option<f32>,
    /// Weight of the size of the normals' residuals.
    #[arg(long, alias = "lambda-delta-reg", value_name = "X", value_parser = weight)]
    pub(crate) lambda_reg: Option<f32>,
    /// Weight of the difference between coverage and the pictures' alpha.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_coverage: Option<f32>,
    /// Share of the run before the loss on normals begins.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) normal_from: Option<f32>,
    /// Share of its weight that the loss on normals keeps at the end.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) normal_last: Option<f32>,
    /// Share of the run before the residual colour is fitted.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) residual_from: Option<f32>,
}

/// The paper's ablation.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Ablation")]
pub(crate) struct Ablate {
    /// Without the sparse loss.
    #[arg(long)]
    pub(crate) no_sparse: bool,
    /// Without the loss on normals.
    #[arg(long)]
    pub(crate) no_normal: bool,
    /// Without the residual colour.
    #[arg(long)]
    pub(crate) no_residual: bool,
    /// Without the shortest axis as normal: normals are free.
    #[arg(long)]
    pub(crate) no_axis: bool,
}

/// Adding and removing Gaussians; the profile's settings where not given.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Densification")]
pub(crate) struct Densify {
    /// First step after which Gaussians are added and removed.
    #[arg(long, value_name = "N", value_parser = count::<u32>)]
    pub(crate) densify_from_iter: Option<u32>,
    /// Step from which they no longer are.
    #[arg(long, value_name = "N", value_parser = count::<u32>)]
    pub(crate) densify_until_iter: Option<u32>,
    /// Steps between two densifications.
    #[arg(long, value_name = "N", value_parser = positive::<u32>)]
    pub(crate) densification_interval: Option<u32>,
    /// Steps between two resets of all opacities; 0 for none.
    #[arg(long, value_name = "N", value_parser = count::<u32>)]
    pub(crate) opacity_reset_interval: Option<u32>,
    /// Mean gradient on the screen from which a Gaussian is cloned or split.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) densify_grad_threshold: Option<f32>,
    /// Size, as a share of the scene, above which it is split rather than cloned.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) percent_dense: Option<f32>,
    /// Most Gaussians.
    #[arg(long, alias = "max-splats", value_name = "N", value_parser = count::<usize>)]
    pub(crate) max_gaussians: Option<usize>,
}

/// Whether nothing is asked for but the profile's own.
pub(super) fn is_of_profile(degree: &Option<i8>) -> bool {
    degree.is_none_or(|degree| degree < 0)
}

/// A number as it is typed: TOML's are shorter.
pub(super) fn as_typed<S: Serializer>(number: &u64, out: S) -> Result<S::Ok, S::Error> {
    match i64::try_from(*number) {
        Ok(number) => out.serialize_i64(number),
        Err(_) => out.collect_str(number),
    }
}

/// A count of random points.
pub(super) fn random_points(text: &str) -> Result<u32, String> {
    positive(text).and_then(few)
}

/// A count of points behind others.
pub(super) fn background_points(text: &str) -> Result<u32, String> {
    count(text).and_then(few)
}

/// Not more points than any training begins with: drawing more takes minutes, and no machine trains them.
pub(super) fn few(number: u32) -> Result<u32, String> {
    const MOST: u32 = 20_000_000;
    if number <= MOST { Ok(number) } else { Err(format!("use {MOST} points at most")) }
}

/// Of a training: with the authors' rule as well, for which 0 stands until a picture was seen.
pub(super) fn downscale_or_rule(text: &str) -> Result<u32, String> {
    if text == "-1" { Ok(AT_MOST_1600) } else { downscale(text) }
}
