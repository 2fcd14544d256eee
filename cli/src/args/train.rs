//! Arguments of `specula train`. Arguments that shape the model are serialized into its
//! `config.toml`.

use super::{
    light_reference::LightReference,
    parse::{
        above_zero, address, count, downscale, error_bound, executor, input_space, light_follows, masks, positive,
        share, token, unknown_setting, weight, whole_above_zero,
    },
    preset::Preset,
    scene::ProfileName,
    view,
};
use clap::{Args, ValueEnum, builder::ArgPredicate};
use core::{convert::Infallible, net::SocketAddr};
use serde::{Serialize, Serializer};
use specula_io::dataset::{InputSpace, MaskUse};
use specula_scene::{
    ExecutorChoice, backdrop::BackgroundColor, following_light::LightFollows, foreground::Foreground,
    orientation::UpDirection,
};
use std::{
    io::IsTerminal,
    path::{Path, PathBuf},
};

/// Heading of settings of the model.
const MODEL: &str = "Model";
/// Headings of settings: options that only `--set help` lists.
pub(crate) const SETTINGS: [&str; 4] = [MODEL, "Losses", "Ablation", "Densification"];

/// Resolution of `-r -1`, INRIA's default: full size, but at most 1600 pixels wide.
pub(crate) const AT_MOST_1600: u32 = 0;
/// Resolution of `-r auto`: the smallest factor with at most [`LONGER_EDGE`] pixels along an edge.
pub(crate) const AT_MOST_1100: u32 = u32::MAX;
/// Pixels along the longer edge of `-r auto`: a quarter of a phone's photographs.
pub(crate) const LONGER_EDGE: u32 = 1100;

/// Train Gaussians and an environment light on pictures with known cameras.
///
/// DATASET is a folder with transforms_train.json (NeRF Synthetic, Shiny Blender), with sparse/0
/// and images (photographs with COLMAP cameras), or with transforms.json (nerfstudio, instant-ngp).
/// MODEL becomes a model folder in INRIA's layout, with the light beside the Gaussians. It is
/// locked while a training writes to it.
///
/// Ctrl-C saves a checkpoint and exits with code 130; --resume continues from it to the same model,
/// bit for bit. For data sets, photographs, masks and lenses see docs/guide.md and
/// docs/datasets.md.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(after_help = "\
Profiles:
  specula    deferred shading with the best measured quality; the default
  paper      the equations and weights of the GaussianShader paper
  official   the behaviour of the GaussianShader authors' code
  3dgs       plain Gaussian splatting with spherical harmonics
Presets:
  nerf-synthetic, shiny-blender, glossy-synthetic
                      white background, full size, 30000 iterations
  tanks-and-temples   photographs: black background, full size, 30000 iterations;
                      with --eval every 8th held out
  photos              photographs, quick: black background, -r auto, 5000 background points,
                      7000 iterations; with --eval every 8th held out
Examples:
  specula train data/chair -m out/chair --eval -r 2 --iterations 7k
  specula train data/garden -m out/garden --eval -r 4     # photographs with COLMAP cameras
  specula train data/toaster -m out/ablation --eval --profile paper --no-residual
  specula train -m out/chair --resume                     # continue after Ctrl-C or a crash
  specula train -m out/chair --resume --iterations 60k    # train longer
  specula train data/drums -m out/drums --config out/chair/config.toml
  specula train data/chair -m out/chair --views-per-step 4 --iterations 7500
  specula train --manifest scenes.toml                    # many scenes, one after another")]
#[command(allow_negative_numbers = true)]
pub(crate) struct Train {
    /// Data set folder.
    #[arg(value_name = "DATASET", required_unless_present_any = ["source_path", "resume", "config", "manifest"])]
    #[serde(skip)]
    pub(crate) dataset: Option<PathBuf>,
    /// Data set folder, under the name of INRIA's option.
    #[arg(long, short, value_name = "DATASET", conflicts_with = "dataset")]
    #[serde(skip)]
    pub(crate) source_path: Option<PathBuf>,
    /// Model folder; created if it does not exist.
    #[arg(
        long,
        short,
        alias = "output",
        short_alias = 'o',
        value_name = "MODEL",
        default_value_if("manifest", ArgPredicate::IsPresent, ".")
    )]
    #[serde(skip)]
    pub(crate) model_path: PathBuf,
    /// Model and training settings.
    #[arg(long, value_enum, default_value_t = ProfileName::Specula)]
    pub(crate) profile: ProfileName,
    /// Number of iterations, such as 30000, 30k or 3e4; schedules stretch with it.
    #[arg(long, value_name = "N", default_value_t = 30_000, value_parser = positive::<u32>)]
    pub(crate) iterations: u32,
    /// As many of --iterations as take about M minutes here.
    #[arg(long, value_name = "M", value_parser = above_zero, conflicts_with_all = ["resume", "ranks"])]
    #[serde(skip)]
    pub(crate) minutes: Option<f64>,
    /// Views per iteration, with gradients at the same parameters, which several ranks can share;
    /// schedules adapt, so that 4 views take a quarter of the iterations. Some quality is lost; see
    /// docs/scaling.md.
    #[arg(long, value_name = "B", default_value_t = 1, value_parser = views_per_step)]
    #[serde(skip_serializing_if = "is_one")]
    pub(crate) views_per_step: u32,
    /// Split the training over N threads, with the same result; with --executor gpu each uses its
    /// own GPU. For several machines use MPI; see docs/scaling.md.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = ranks)]
    #[serde(skip)]
    pub(crate) ranks: u16,
    /// Keep at most this many GiB of decoded pictures and decode the others again before use; the
    /// model is the same. By default half of the free memory.
    #[arg(long, value_name = "GIB", value_parser = gibibytes)]
    #[serde(skip)]
    pub(crate) picture_memory: Option<f64>,
    /// Downscale pictures by this factor; auto: to at most 1100 pixels along an edge.
    #[arg(long, short, value_name = "1|2|4|8|auto", default_value = "1", value_parser = downscale_or_rule, allow_negative_numbers = true)]
    #[serde(serialize_with = "as_option_of_resolution")]
    pub(crate) resolution: u32,
    /// Hold out the test views, measure them at the end, and write results.json.
    #[arg(long)]
    pub(crate) eval: bool,
    /// Random seed.
    #[arg(long, value_name = "N", default_value_t = 0)]
    #[serde(serialize_with = "as_typed")]
    pub(crate) seed: u64,
    /// Background behind transparent pictures; by default white if any picture is transparent, else
    /// black.
    #[arg(long, value_name = "black|white|R,G,B", conflicts_with = "white_background")]
    pub(crate) background: Option<BackgroundColor>,
    /// Same as --background white.
    #[arg(long, short)]
    pub(crate) white_background: bool,
    /// Also save the model at these iterations.
    #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',', value_parser = count::<u32>)]
    pub(crate) save_iterations: Vec<u32>,
    /// Also measure at these iterations, into results.json and timeline.json; needs --eval.
    #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',', requires = "eval", value_parser = count::<u32>)]
    pub(crate) test_iterations: Vec<u32>,
    /// Executor: a GPU if there is one (auto), the CPU, or the GPU with NAME in its name; specula
    /// doctor lists them.
    #[arg(long, value_name = "auto|cpu|gpu[:NAME]", default_value = "auto", value_parser = executor)]
    pub(crate) executor: ExecutorChoice,
    /// Find the cheapest render settings whose pictures are within E of exact ones (RMS, where
    /// white is 1), measure with them, verifying each picture, and write the certificate to
    /// specula.json; see docs/accuracy.md.
    #[arg(long, value_name = "E", value_parser = error_bound)]
    pub(crate) max_error: Option<f64>,
    /// Accepted from GaussianShader's command lines and ignored; --sh-degree sets the harmonics of
    /// the residual colour.
    #[arg(long, value_name = "N", hide = true, allow_negative_numbers = true, value_parser = clap::value_parser!(i32).range(-1..=3))]
    #[serde(skip)]
    pub(crate) brdf_dim: Option<i32>,
    #[command(flatten)]
    #[serde(skip)]
    pub(crate) watch: Watch,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) resuming: ResumeOptions,
    #[command(flatten)]
    #[serde(skip)]
    pub(crate) many: Many,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) photographs: Photographs,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) start: Start,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) losses: Losses,
    /// Set a training setting: a weight, a schedule, densification. --set help lists them; each is
    /// an option of its own name as well.
    #[arg(long, value_name = "NAME=VALUE", help_heading = "Resuming and settings", value_parser = unknown_setting)]
    #[serde(skip)]
    pub(crate) set: Vec<Infallible>,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) ablation: Ablate,
    #[command(flatten)]
    #[serde(flatten)]
    pub(crate) densify: Densify,
}

impl Train {
    /// Data set folder from either argument; `None` if neither is given.
    pub(crate) fn source(&self) -> Option<&Path> {
        self.dataset.as_deref().or(self.source_path.as_deref())
    }
}

/// Data sets of photographs.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Photographs")]
pub(crate) struct Photographs {
    /// Folder of the photographs within DATASET.
    #[arg(long, short, value_name = "FOLDER", default_value = specula_io::dataset::IMAGES)]
    pub(crate) images: String,
    /// With --eval, hold out every Nth photograph in the order of their names, starting with the
    /// first; 0 for none.
    #[arg(long, aliases = ["llffhold", "eval-split-every"], value_name = "N", default_value_t = specula_io::dataset::TEST_EVERY, value_parser = count::<u32>)]
    pub(crate) test_every: u32,
    /// Pixels that masks hide are not counted (ignore) or empty (cut); auto: cut if masks hide most
    /// of the pictures.
    #[arg(long, value_name = "USE", default_value = MaskUse::Auto.name(), value_parser = masks)]
    pub(crate) masks: MaskUse,
    /// Colour space of the pictures: srgb, linear or acescg; auto: what the files say, linear for
    /// OpenEXR.
    #[arg(long, value_name = "SPACE", default_value = InputSpace::Auto.name(), value_parser = input_space)]
    #[serde(skip_serializing_if = "is_default")]
    pub(crate) input_space: InputSpace,
    /// Up direction, if the one estimated from the cameras is wrong: an axis such as -y, or a
    /// vector.
    #[arg(long, value_name = "AXIS|X,Y,Z", allow_hyphen_values = true)]
    pub(crate) scene_up: Option<UpDirection>,
    /// Learn an affine colour map of each photograph, into exposure.json.
    #[arg(long)]
    pub(crate) exposure: bool,
}

/// True for the default, which is not written to `config.toml`.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn as_name<S: Serializer>(follows: &LightFollows, out: S) -> Result<S::Ok, S::Error> {
    out.serialize_str(follows.name())
}

/// Page that shows a training.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Watching")]
pub(crate) struct Watch {
    /// Serve a page that shows the training and can pause it; results do not depend on it.
    #[arg(long, value_name = "[HOST:]PORT", num_args = 0..=1, default_missing_value = view::ADDRESS, value_parser = address)]
    pub(crate) view: Option<SocketAddr>,
    /// Access token; generated when listening beyond loopback.
    #[arg(long, value_name = "WORD", requires = "view", value_parser = token)]
    pub(crate) token: Option<String>,
    /// Serve the page until the training ends (done), or until Ctrl-C (ctrl-c); by default ctrl-c
    /// if stdout is a terminal.
    #[arg(long, value_name = "done|ctrl-c", requires = "view", hide_possible_values = true)]
    pub(crate) view_until: Option<ViewUntil>,
}

/// End of a page that shows a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ViewUntil {
    /// End of the training.
    Done,
    /// Ctrl-C after the training.
    CtrlC,
}

impl ViewUntil {
    /// Default: Ctrl-C if stdout is a terminal.
    pub(crate) fn default_of_stdout() -> Self {
        if std::io::stdout().is_terminal() { Self::CtrlC } else { Self::Done }
    }
}

/// Resuming, and settings from files.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Resuming and settings")]
pub(crate) struct ResumeOptions {
    /// Continue from the checkpoint in MODEL, with the settings of MODEL/config.toml.
    #[arg(long)]
    #[serde(skip)]
    pub(crate) resume: bool,
    /// Replace the training in MODEL: its models, results, checkpoint and pictures are deleted.
    #[arg(long, conflicts_with = "resume")]
    #[serde(skip)]
    pub(crate) overwrite: bool,
    /// Write to MODEL even if it is locked by another training; network file systems may report
    /// stale locks.
    #[arg(long)]
    #[serde(skip)]
    pub(crate) ignore_lock: bool,
    /// File with values for options that are not given, such as the config.toml of another model.
    #[arg(long, value_name = "FILE.toml")]
    #[serde(skip)]
    pub(crate) config: Option<PathBuf>,
    /// Settings for a kind of data set, listed below; other options prevail.
    #[arg(long, value_enum, conflicts_with = "resume", hide_possible_values = true)]
    #[serde(skip)]
    pub(crate) preset: Option<Preset>,
    /// Write MODEL/checkpoint.safetensors every N iterations; 0 for only on Ctrl-C and at the end.
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = count::<u32>)]
    pub(crate) checkpoint_every: u32,
}

/// Trainings of a manifest.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Many scenes")]
pub(crate) struct Many {
    /// Train every scene that a file lists, one after another, with options of its own; see
    /// docs/many-scenes.md. Finished trainings are kept, interrupted ones continue.
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["dataset", "source_path", "model_path", "resume", "config", "view"])]
    pub(crate) manifest: Option<PathBuf>,
    /// Train only the K-th of the manifest, such as a task of a Slurm array.
    #[arg(long, value_name = "K", requires = "manifest", value_parser = positive::<usize>)]
    pub(crate) task: Option<usize>,
    /// Print the command of each training of the manifest; do not train.
    #[arg(long, requires = "manifest")]
    pub(crate) list: bool,
}

/// Initial state of a training.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Start")]
pub(crate) struct Start {
    /// Initial points, instead of those of the data set.
    #[arg(long, value_name = "FILE.ply")]
    pub(crate) points: Option<PathBuf>,
    /// Start from N random points instead of a point cloud; 20000 if the data set has no points.
    #[arg(long, value_name = "N", conflicts_with = "points", value_parser = random_points)]
    pub(crate) random_points: Option<u32>,
    /// Add N random points behind those of the data set, for walls, tables and skies.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = background_points)]
    pub(crate) background_points: u32,
    /// Region in which Gaussians reflect the light: all; auto, within half the distance of the
    /// cameras; another fraction of that distance; or the ball X,Y,Z,RADIUS.
    #[arg(long, value_name = "WHERE", default_value = "all", allow_hyphen_values = true)]
    pub(crate) foreground: Foreground,
    /// Fraction of the run that trains on pictures of half the size, where an iteration costs less.
    #[arg(long, help_heading = MODEL, value_name = "0..1", value_parser = share)]
    pub(crate) coarse_until: Option<f32>,
    /// Fraction of the run after which all learning rates decay to zero, which averages out the
    /// noise of views; 1 for never [default: 0.7 for specula, 1 for others].
    #[arg(long, help_heading = MODEL, value_name = "0..1", value_parser = share)]
    pub(crate) cool_from: Option<f32>,
    /// Degree of the spherical harmonics, 0 to 3; -1, from GaussianShader's command lines, for that
    /// of the profile.
    #[arg(long, help_heading = MODEL, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(i8).range(-1..=3))]
    #[serde(skip_serializing_if = "is_of_profile")]
    pub(crate) sh_degree: Option<i8>,
    /// Train anti-aliased, as Mip-Splatting does: pictures at other sizes keep their brightness and
    /// show no needles. Other programs need the same filter.
    #[arg(long)]
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub(crate) antialias: bool,
    /// Look up the light per Gaussian, as in the paper, or per pixel (deferred).
    #[arg(long, help_heading = MODEL, value_enum)]
    pub(crate) light_per: Option<LightPer>,
    /// Light from the texels of a cube map, or from a small network over directions (mlp), as in
    /// the paper's ablation.
    #[arg(long, help_heading = MODEL, value_enum, default_value_t = LightKind::Cube)]
    #[serde(skip_serializing_if = "LightKind::is_cube")]
    pub(crate) light: LightKind,
    /// Reflections of the distant light (far), or also of the scene's own surface where reflected
    /// rays hit it (near), as on a toaster or between chess pieces; needs --light-per pixel
    /// [default: far].
    #[arg(long, value_enum)]
    pub(crate) reflections: Option<Reflections>,
    /// Also fit physical materials, for other lights [default: of objects cut out by alpha].
    #[arg(long)]
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub(crate) relightable: bool,
    /// Do not fit materials of objects; saves a third of the time.
    #[arg(long, conflicts_with = "relightable")]
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub(crate) no_materials: bool,
    /// Known light, which makes materials absolute: a lat-long map of linear radiance (.hdr, .exr)
    /// with the scene's up at its upper edge; or only its mean, one number or R,G,B.
    #[arg(long, value_name = "FILE|MEAN|R,G,B")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) light_reference: Option<LightReference>,
    /// Frame of the light: scene, turntable or camera; see docs/datasets.md.
    #[arg(long, value_name = "WHAT", default_value = LightFollows::Scene.name(), value_parser = light_follows)]
    #[serde(serialize_with = "as_name", skip_serializing_if = "is_default")]
    pub(crate) light_follows: LightFollows,
    /// Table of each picture's light and of turns of the object, or folders; see docs/datasets.md.
    #[arg(long, value_name = "FILE|folders", conflicts_with = "light_follows")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) lights_by: Option<PathBuf>,
    /// Resolution of the cube map's faces: a power of two, at least 16 (official: 64); at most 128
    /// with --light mlp.
    #[arg(long, help_heading = MODEL, alias = "brdf-env", value_name = "N", value_parser = count::<usize>)]
    pub(crate) light_resolution: Option<usize>,
}

/// Representation of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum LightKind {
    /// Texels of a cube map.
    Cube,
    /// Network over directions.
    Mlp,
}

impl LightKind {
    /// True for the default, which is not written to `config.toml`.
    fn is_cube(&self) -> bool {
        *self == Self::Cube
    }
}

/// Scene that reflected rays see.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Reflections {
    /// Distant light.
    Far,
    /// Surface of the scene, then the distant light.
    Near,
}

/// Meaning of white in a true picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum WhitePixels {
    /// White, or anything brighter.
    Overexposed,
    /// Exactly white.
    Exact,
}

/// Sample of a light look-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum LightPer {
    /// Per Gaussian; shaded colours are blended.
    Gaussian,
    /// Per pixel; surface attributes are blended.
    Pixel,
}

/// Weights of the losses; those of the profile by default.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Losses")]
pub(crate) struct Losses {
    /// Weight of 1 − SSIM; that of |C − C_gt| becomes one minus it.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) lambda_dssim: Option<f32>,
    /// Weight of |C − C_gt|.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_absolute: Option<f32>,
    /// Weight of (C − C_gt)².
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_squared: Option<f32>,
    /// Weight of the difference between normals and the normals of the depth map; specula: 0.1, of
    /// objects cut out by alpha 0.2.
    #[arg(long, alias = "lambda-predicted-normal", value_name = "X", value_parser = weight)]
    pub(crate) lambda_normal: Option<f32>,
    /// Weight of smooth normals of mirrors; specula: 0, of objects 80.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_smooth: Option<f32>,
    /// Weight of the sparsity loss, which drives opacities to 0 or 1.
    #[arg(long, alias = "lambda-zero-one", value_name = "X", value_parser = weight)]
    pub(crate) lambda_sparse: Option<f32>,
    /// Weight of the magnitude of normal residuals.
    #[arg(long, alias = "lambda-delta-reg", value_name = "X", value_parser = weight)]
    pub(crate) lambda_reg: Option<f32>,
    /// Weight of the difference between rendered coverage and the alpha of the pictures.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_coverage: Option<f32>,
    /// Meaning of white: overexposed or exact; see docs/training.md.
    #[arg(long, hide_possible_values = true, value_name = "WHITE")]
    pub(crate) white_pixels: Option<WhitePixels>,
    /// Weight of the difference between metalness and the share of metal that view-dependent
    /// colours suggest, with --relightable; 0.1 helps scenes of mirrors [default: 0].
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) lambda_metal: Option<f32>,
    /// Fraction of the run after which the normal loss starts.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) normal_from: Option<f32>,
    /// Fraction of its weight that the normal loss keeps at the end.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) normal_last: Option<f32>,
    /// Fraction of the run after which normals may differ from those of the geometry [default: 0].
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) normal_residuals_from: Option<f32>,
    /// Fraction of the run after which the residual colour is trained.
    #[arg(long, value_name = "0..1", value_parser = share)]
    pub(crate) residual_from: Option<f32>,
}

/// Ablation of the paper.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Ablation")]
pub(crate) struct Ablate {
    /// Disable the sparsity loss.
    #[arg(long)]
    pub(crate) no_sparse: bool,
    /// Disable the normal loss.
    #[arg(long)]
    pub(crate) no_normal: bool,
    /// Disable the residual colour.
    #[arg(long)]
    pub(crate) no_residual: bool,
    /// Train free normals instead of deriving them from the shortest axes.
    #[arg(long)]
    pub(crate) no_axis: bool,
}

/// Densification and pruning; settings of the profile by default.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Densification")]
pub(crate) struct Densify {
    /// Iteration after which densification starts.
    #[arg(long, value_name = "N", value_parser = count::<u32>)]
    pub(crate) densify_from_iter: Option<u32>,
    /// Iteration at which densification stops.
    #[arg(long, value_name = "N", value_parser = count::<u32>)]
    pub(crate) densify_until_iter: Option<u32>,
    /// Iterations between densifications.
    #[arg(long, value_name = "N", value_parser = positive::<u32>)]
    pub(crate) densification_interval: Option<u32>,
    /// Iterations between opacity resets; 0 for none.
    #[arg(long, value_name = "N", value_parser = count::<u32>)]
    pub(crate) opacity_reset_interval: Option<u32>,
    /// Mean screen-space gradient from which a Gaussian is cloned or split.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) densify_grad_threshold: Option<f32>,
    /// Size, as a fraction of the scene extent, above which a Gaussian is split rather than cloned;
    /// 0.01, with specula of objects cut out by alpha 0.004.
    #[arg(long, value_name = "X", value_parser = weight)]
    pub(crate) percent_dense: Option<f32>,
    /// Maximum number of Gaussians [default: 1000000].
    #[arg(long, help_heading = "Start", alias = "max-splats", value_name = "N", value_parser = whole_above_zero)]
    pub(crate) max_gaussians: Option<usize>,
}

/// True for the degree of the profile, which is not written to `config.toml`.
pub(super) fn is_of_profile(degree: &Option<i8>) -> bool {
    degree.is_none_or(|degree| degree < 0)
}

/// Serializes a seed, as text if it exceeds the 63 bits of TOML's integers.
pub(super) fn as_typed<S: Serializer>(number: &u64, out: S) -> Result<S::Ok, S::Error> {
    match i64::try_from(*number) {
        Ok(number) => out.serialize_i64(number),
        Err(_) => out.collect_str(number),
    }
}

/// True for single views, which are not written to `config.toml`.
fn is_one(views: &u32) -> bool {
    *views == 1
}

/// Number of views per step: more views need more memory than they save time.
pub(super) fn views_per_step(text: &str) -> Result<u32, String> {
    const MOST: u32 = 1024;
    let views = positive(text)?;
    if views <= MOST { Ok(views) } else { Err(format!("use at most {MOST} views per step")) }
}

/// Number of ranks that are threads.
pub(super) fn ranks(text: &str) -> Result<u16, String> {
    const MOST: u16 = 64;
    let count = positive(text)?;
    if count <= MOST { Ok(count) } else { Err(format!("use at most {MOST} ranks")) }
}

/// Memory in GiB; fractions are valid.
pub(super) fn gibibytes(text: &str) -> Result<f64, String> {
    let size: f64 = text.parse().map_err(|_| "give a number of GiB, such as 4 or 0.5".to_owned())?;
    if size.is_finite() && size >= 0.0 { Ok(size) } else { Err("give a number of GiB that is not negative".into()) }
}

/// Number of random points, at least one.
pub(super) fn random_points(text: &str) -> Result<u32, String> {
    positive(text).and_then(few)
}

/// Number of background points.
pub(super) fn background_points(text: &str) -> Result<u32, String> {
    count(text).and_then(few)
}

/// Limit on the number of points: more take minutes to draw, and no machine can train them.
pub(super) fn few(number: u32) -> Result<u32, String> {
    const MOST: u32 = 20_000_000;
    if number <= MOST { Ok(number) } else { Err(format!("use at most {MOST} points")) }
}

/// Serializes a downscaling as on the command line.
fn as_option_of_resolution<S: Serializer>(factor: &u32, serializer: S) -> Result<S::Ok, S::Error> {
    match *factor {
        AT_MOST_1600 => serializer.serialize_i32(-1),
        AT_MOST_1100 => serializer.serialize_str("auto"),
        factor => serializer.serialize_u32(factor),
    }
}

/// Downscaling of a training: a factor, -1 for [`AT_MOST_1600`] or auto for [`AT_MOST_1100`], which
/// become factors once a picture is read.
pub(super) fn downscale_or_rule(text: &str) -> Result<u32, String> {
    match text {
        "-1" => Ok(AT_MOST_1600),
        "auto" => Ok(AT_MOST_1100),
        _ => downscale(text).map_err(|error| format!("{error}, or auto")),
    }
}
