//! What can be said on the command line.

#![expect(clippy::doc_markdown, reason = "comments are the help that is printed, as they stand")]

use crate::{
    background::{Backdrop, Background},
    failure::Failure,
    foreground::Foreground,
    machine::ExecutorChoice,
    orientation::UpChoice,
    preset::Preset,
    typed::{count, positive},
};
use clap::{
    Args, Parser, Subcommand, ValueEnum,
    builder::{PossibleValuesParser, TypedValueParser},
};
use core::net::{Ipv4Addr, SocketAddr};
use glam::Vec3;
use serde::{Serialize, Serializer};
use specula_core::{cutoffs::ProjectionModel, pack::Storage};
use specula_io::{
    budget::view_size,
    latlong::{Stand, UpAxis},
};
use specula_scene::Layer;
use std::{
    io::IsTerminal,
    net::ToSocketAddrs,
    path::{Path, PathBuf},
};

/// `-r -1`, INRIA's default: as they are, but at most 1600 pixels wide.
pub(crate) const AT_MOST_1600: u32 = 0;

/// Scenes of 3D Gaussians that carry a shading function: fitted to pictures, rendered, taken apart, relit.
///
/// Each Gaussian has a diffuse colour, a specular tint, a roughness and a normal; they share one light, a cube map
/// that is fitted along with them. So glossy things look right from everywhere, and another light can be put in.
#[derive(Debug, Parser)]
#[command(name = "specula", version, max_term_width = 110, after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// The command.
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Print results and errors alone.
    #[arg(long, short, global = true, help_heading = "General")]
    pub(crate) quiet: bool,
    /// Threads to use; all cores by default. Results do not depend on it.
    #[arg(long, global = true, value_name = "N", help_heading = "General", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
}

const EXAMPLES: &str = "\
Examples:
  specula demo                                    see everything, without any data
  specula train data/chair -m out/chair --eval    fit a scene, measure held-out views
  specula render out/chair --layers rgb,normal    pictures of the test views
  specula relight out/chair --env sunset.hdr      the same scene under another light
  specula compare out/chair out/plain             a table of their quality, size and time
  specula view out/chair                          look around in it, in a browser
  specula export out/chair -o chair.ply           for any viewer of Gaussians
  specula prefilter sunset.hdr -o sunset.ktx2     a light for other programs, filtered for every roughness
  specula info out/chair                          what is in it";

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Demo(Demo),
    Train(Box<Train>),
    Render(Render),
    Relight(Relight),
    Eval(Eval),
    Compare(Compare),
    View(View),
    Export(Export),
    Prefilter(Prefilter),
    Report(Report),
    Info(Info),
    Doctor(Doctor),
    /// Read a network for LPIPS and nothing else; eval does so in a process that may only take so much.
    #[command(hide = true)]
    TryNetwork(TryNetwork),
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

impl Command {
    /// Executor that was asked for, where there is a choice.
    pub(crate) fn executor(&self) -> Option<&ExecutorChoice> {
        match self {
            Self::Train(args) => Some(&args.executor),
            Self::Render(args) => Some(&args.look.showing.machine.executor),
            Self::Relight(args) => Some(&args.look.showing.machine.executor),
            Self::Eval(args) => Some(&args.machine.executor),
            Self::View(args) => Some(&args.showing.machine.executor),
            Self::Export(args) => Some(&args.showing.machine.executor),
            Self::Demo(_)
            | Self::Compare(_)
            | Self::Prefilter(_)
            | Self::Report(_)
            | Self::Info(_)
            | Self::Doctor(_)
            | Self::TryNetwork(_) => None,
        }
    }
}

/// Train a small reflective scene that comes with the program, and make pictures of all that can be done with it.
///
/// Plain Gaussian splatting (3dgs) and specula are trained for equally many steps with equal settings. A table of both
/// goes to stdout and to OUT/results.json; OUT/index.html shows the pictures.
#[derive(Args, Debug)]
#[command(after_help = "Example:\n  specula demo -o out/demo")]
pub(crate) struct Demo {
    /// Folder for everything that the demo makes.
    #[arg(long, short, value_name = "OUT", default_value = crate::demo::FOLDER)]
    pub(crate) output: PathBuf,
    /// Steps of each of the two trainings.
    #[arg(long, value_name = "N", default_value_t = crate::demo::ITERATIONS, value_parser = positive::<u32>)]
    pub(crate) iterations: u32,
}

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
    #[arg(long, short, alias = "source_path", value_name = "DATASET", conflicts_with = "dataset")]
    #[serde(skip)]
    pub(crate) source_path: Option<PathBuf>,
    /// Folder for the model; made if it does not exist.
    #[arg(long, short, aliases = ["model_path", "output"], short_alias = 'o', value_name = "MODEL")]
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
    #[arg(long, short, alias = "white_background")]
    pub(crate) white_background: bool,
    /// Save at these steps as well as at the end.
    #[arg(long, alias = "save_iterations", value_name = "N", num_args = 1.., value_delimiter = ',', value_parser = count::<u32>)]
    pub(crate) save_iterations: Vec<u32>,
    /// Measure at these steps as well as at the end, into results.json and timeline.json; needs --eval.
    #[arg(long, alias = "test_iterations", value_name = "N", num_args = 1.., value_delimiter = ',', requires = "eval", value_parser = count::<u32>)]
    pub(crate) test_iterations: Vec<u32>,
    /// A GPU if there is one (auto), the CPU, or the GPU with NAME in its name; specula doctor lists them.
    #[arg(long, value_name = "auto|cpu|gpu[:NAME]", default_value = "auto")]
    pub(crate) executor: ExecutorChoice,
    /// Look for the cheapest setting whose pictures are within E of exact ones (RMS, 1 is white), measure with it, each
    /// picture verified, and write its certificate into specula.json; docs/accuracy.md.
    #[arg(long, alias = "max_error", value_name = "E", value_parser = error_bound)]
    pub(crate) max_error: Option<f64>,
    /// Accepted for GaussianShader's command lines; the residual colour's harmonics are --sh-degree here.
    #[arg(long, alias = "brdf_dim", value_name = "N", hide = true, allow_negative_numbers = true, value_parser = clap::value_parser!(i32).range(-1..=3))]
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
    /// The folder of the data set.
    pub(crate) fn source(&self) -> Result<&Path, Failure> {
        let named = self.dataset.as_ref().or(self.source_path.as_ref());
        let no_name = || Failure::Input("no data set is named, nor in the file of settings; add its folder".into());
        named.map(PathBuf::as_path).ok_or_else(no_name)
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
    #[arg(long, aliases = ["test_every", "llffhold", "eval-split-every"], value_name = "N", default_value_t = specula_io::dataset::TEST_EVERY, value_parser = count::<u32>)]
    pub(crate) test_every: u32,
    /// The scene's up direction, where the cameras' is wrong: an axis such as z or -y, or a vector.
    #[arg(long, alias = "scene_up", value_name = "AXIS|X,Y,Z", allow_hyphen_values = true)]
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
    #[arg(long, value_name = "[HOST:]PORT", num_args = 0..=1, default_missing_value = crate::view::ADDRESS, value_parser = address)]
    pub(crate) view: Option<SocketAddr>,
    /// Password of the page; by default a random one where other machines can reach it, else none.
    #[arg(long, value_name = "WORD", requires = "view", value_parser = token)]
    pub(crate) token: Option<String>,
    /// When the page ends: with the training (done), or at Ctrl-C after it (ctrl-c). By default ctrl-c where standard output
    /// is a terminal, else done, so that no script waits.
    #[arg(long, alias = "view_until", value_name = "done|ctrl-c", requires = "view", hide_possible_values = true)]
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
    #[arg(long, alias = "checkpoint_every", value_name = "N", default_value_t = 1000, value_parser = count::<u32>)]
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
    #[arg(long, alias = "random_points", value_name = "N", conflicts_with = "points", value_parser = random_points)]
    pub(crate) random_points: Option<u32>,
    /// Add this many points behind those of the data set, for walls, tables and skies.
    #[arg(long, alias = "background_points", value_name = "N", default_value_t = 0, value_parser = background_points)]
    pub(crate) background_points: u32,
    /// Where Gaussians reflect the light: all; auto, within half the cameras' distance; another share of it; or the ball
    /// X,Y,Z,RADIUS.
    #[arg(long, value_name = "WHERE", default_value = "all", allow_hyphen_values = true)]
    pub(crate) foreground: Foreground,
    /// Share of the run with pictures of half their size, where a step costs less.
    #[arg(long, alias = "coarse_until", value_name = "0..1", value_parser = share)]
    pub(crate) coarse_until: Option<f32>,
    /// Degree of the spherical harmonics, 0 to 3; -1 for the profile's, as in GaussianShader's command lines.
    #[arg(long, alias = "sh_degree", value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(i8).range(-1..=3))]
    #[serde(skip_serializing_if = "is_of_profile")]
    pub(crate) sh_degree: Option<i8>,
    /// Look up the light for each Gaussian, as in the paper, or for each pixel (deferred).
    #[arg(long, alias = "light_per", value_enum)]
    pub(crate) light_per: Option<LightPer>,
    /// Texels along an edge of the light's faces: a power of two, at least 16 (official: 64).
    #[arg(long, alias = "light_resolution", alias = "brdf_env", value_name = "N", value_parser = count::<usize>)]
    pub(crate) light_resolution: Option<usize>,
}

/// Weights of the losses; those that are not given are the profile's.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Losses")]
pub(crate) struct Losses {
    /// Weight of 1 − SSIM; that of |C − C_gt| becomes one minus it.
    #[arg(long, alias = "lambda_dssim", value_name = "X", value_parser = weight)]
    pub(crate) lambda_dssim: Option<f32>,
    /// Weight of |C − C_gt|.
    #[arg(long, alias = "lambda_absolute", value_name = "X", value_parser = weight)]
    pub(crate) lambda_absolute: Option<f32>,
    /// Weight of (C − C_gt)².
    #[arg(long, alias = "lambda_squared", value_name = "X", value_parser = weight)]
    pub(crate) lambda_squared: Option<f32>,
    /// Weight of the difference between normals and those of the depth.
    #[arg(long, alias = "lambda_normal", alias = "lambda_predicted_normal", value_name = "X", value_parser = weight)]
    pub(crate) lambda_normal: Option<f32>,
    /// Weight of the loss that makes opacities 0 or 1.
    #[arg(long, alias = "lambda_sparse", alias = "lambda_zero_one", value_name = "X", value_parser = weight)]
    pub(crate) lambda_sparse: Option<f32>,
    /// Weight of the size of the normals' residuals.
    #[arg(long, alias = "lambda_reg", alias = "lambda_delta_reg", value_name = "X", value_parser = weight)]
    pub(crate) lambda_reg: Option<f32>,
    /// Weight of the difference between coverage and the pictures' alpha.
    #[arg(long, alias = "lambda_coverage", value_name = "X", value_parser = weight)]
    pub(crate) lambda_coverage: Option<f32>,
    /// Share of the run before the loss on normals begins.
    #[arg(long, alias = "normal_from", value_name = "0..1", value_parser = share)]
    pub(crate) normal_from: Option<f32>,
    /// Share of its weight that the loss on normals keeps at the end.
    #[arg(long, alias = "normal_last", value_name = "0..1", value_parser = share)]
    pub(crate) normal_last: Option<f32>,
    /// Share of the run before the residual colour is fitted.
    #[arg(long, alias = "residual_from", value_name = "0..1", value_parser = share)]
    pub(crate) residual_from: Option<f32>,
}

/// The paper's ablation.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Ablation")]
pub(crate) struct Ablate {
    /// Without the sparse loss.
    #[arg(long, alias = "no_sparse")]
    pub(crate) no_sparse: bool,
    /// Without the loss on normals.
    #[arg(long, alias = "no_normal")]
    pub(crate) no_normal: bool,
    /// Without the residual colour.
    #[arg(long, alias = "no_residual")]
    pub(crate) no_residual: bool,
    /// Without the shortest axis as normal: normals are free.
    #[arg(long, alias = "no_axis")]
    pub(crate) no_axis: bool,
}

/// Adding and removing Gaussians; the profile's settings where not given.
#[derive(Args, Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[command(next_help_heading = "Densification")]
pub(crate) struct Densify {
    /// First step after which Gaussians are added and removed.
    #[arg(long, alias = "densify_from_iter", value_name = "N", value_parser = count::<u32>)]
    pub(crate) densify_from_iter: Option<u32>,
    /// Step from which they no longer are.
    #[arg(long, alias = "densify_until_iter", value_name = "N", value_parser = count::<u32>)]
    pub(crate) densify_until_iter: Option<u32>,
    /// Steps between two densifications.
    #[arg(long, alias = "densification_interval", value_name = "N", value_parser = positive::<u32>)]
    pub(crate) densification_interval: Option<u32>,
    /// Steps between two resets of all opacities; 0 for none.
    #[arg(long, alias = "opacity_reset_interval", value_name = "N", value_parser = count::<u32>)]
    pub(crate) opacity_reset_interval: Option<u32>,
    /// Mean gradient on the screen from which a Gaussian is cloned or split.
    #[arg(long, alias = "densify_grad_threshold", value_name = "X", value_parser = weight)]
    pub(crate) densify_grad_threshold: Option<f32>,
    /// Size, as a share of the scene, above which it is split rather than cloned.
    #[arg(long, alias = "percent_dense", value_name = "X", value_parser = weight)]
    pub(crate) percent_dense: Option<f32>,
    /// Most Gaussians.
    #[arg(long, alias = "max_gaussians", alias = "max-splats", value_name = "N", value_parser = count::<usize>)]
    pub(crate) max_gaussians: Option<usize>,
}

/// Make pictures of a scene: its colours, or any of the layers that they are made of.
///
/// SCENE is the folder of a model, or any PLY file of Gaussians. Cameras are those of the model's test views, unless
/// --cameras or --turntable say otherwise. Without -o pictures go to MODEL/test/ours_N/renders/00000.png and so on,
/// with the true pictures in gt where the data set is still there; with -o to OUT/LAYER/00000.png.
///
/// Data that these pictures do not depend on is skipped, which changes no bit of them; specula info lists it.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula render out/chair
  specula render out/chair --layers rgb --verify-omissions
  specula render out/chair --layers rgb --max-error 0.01
  specula render out/chair --layers rgb --max-error 0.01 --no-verify
  specula render out/chair --layers rgb --projection ray
  specula render out/chair --layers all -o pictures
  specula render scene.ply --turntable 36 --size 640,480 -o turn
  specula render scene.ply --cameras cameras.json -o pictures")]
pub(crate) struct Render {
    /// Folder of a model, or a PLY file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) look: Look,
    /// Folder for the pictures.
    #[arg(long, short, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Layers to show, as a list with commas.
    #[arg(long, value_parser = layer(), value_delimiter = ',', default_value = "rgb,normal,depth,alpha")]
    pub(crate) layers: Vec<Layer>,
    /// Another light, instead of the scene's: a lat-long map, .hdr or .exr (.png, .jpg and .webp end at white).
    #[arg(long, value_name = "FILE")]
    pub(crate) env: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) env_options: EnvOptions,
    /// Render each view a second time with nothing skipped and print the largest difference, which is 0; else the exit
    /// code is 1.
    #[arg(long, alias = "verify_omissions")]
    pub(crate) verify_omissions: bool,
    /// Render with the cheapest setting whose colours are within E of exact ones (RMS of sRGB, 1 is white), on the CPU. Each
    /// picture is compared with the most exact one, which is written where it is further off. docs/accuracy.md.
    #[arg(long, alias = "max_error", value_name = "E", value_parser = error_bound, conflicts_with_all = ["verify_omissions", "storage", "projection"])]
    pub(crate) max_error: Option<f64>,
    /// With --max-error, do not compare pictures with exact ones: as quick as the setting is, but a
    /// view that it was not chosen by may be further off than E.
    #[arg(long, alias = "no_verify", requires = "max_error")]
    pub(crate) no_verify: bool,
}

/// Cameras and size of pictures.
#[derive(Args, Debug)]
pub(crate) struct Look {
    /// Cameras: a transforms.json, or the cameras.json of Gaussian-splatting tools.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["split", "turntable"])]
    pub(crate) cameras: Option<PathBuf>,
    /// Cameras of the model: those of test views, of training views, or all.
    #[arg(long, value_enum, conflicts_with = "turntable")]
    pub(crate) split: Option<Split>,
    /// N cameras in a circle around the scene, and an animation; to and fro where the model's cameras cover less than three
    /// quarters of the circle.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub(crate) turntable: Option<u32>,
    /// Width and height of the pictures; by default those of the cameras. Nothing is stretched: a picture of another
    /// shape shows more of the scene beside the view.
    #[arg(long, value_name = "W,H", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Behind the scene: a colour, or env, the light that it reflects; the training's background by default, else black.
    #[arg(long, value_name = "black|white|R,G,B|env")]
    pub(crate) background: Option<Backdrop>,
    #[command(flatten)]
    pub(crate) showing: Showing,
}

/// Reading and showing a scene.
#[derive(Args, Debug)]
pub(crate) struct Showing {
    /// Profile to read the attributes by, where the scene names none or a wrong one.
    #[arg(long, value_enum)]
    pub(crate) profile: Option<ProfileName>,
    /// The scene's up direction, instead of the model's: an axis such as z or -y, or a vector.
    #[arg(long, alias = "scene_up", value_name = "AXIS|X,Y,Z", allow_hyphen_values = true)]
    pub(crate) scene_up: Option<UpChoice>,
    #[command(flatten)]
    pub(crate) machine: MachineOptions,
}

/// The executor of renderings.
#[derive(Args, Clone, Debug)]
pub(crate) struct MachineOptions {
    /// A GPU if there is one (auto), the CPU, or the GPU with NAME in its name; specula doctor lists them.
    #[arg(long, value_name = "auto|cpu|gpu[:NAME]", default_value = "auto")]
    pub(crate) executor: ExecutorChoice,
    /// Numbers of Gaussians and light in memory: f16 takes about half of f32 (docs/performance.md).
    #[arg(long, value_enum, value_name = "f32|f16", default_value_t = StorageName::F32)]
    pub(crate) storage: StorageName,
    /// ProjectionModel of Gaussians: affine as in training, exact (ray, tangent; on the CPU), or exact where affine is off by
    /// more than ALPHA (docs/accuracy.md).
    #[arg(long, value_name = "affine|tangent|ray|ALPHA", default_value = "affine", value_parser = projection)]
    pub(crate) projection: ProjectionModel,
}

impl MachineOptions {
    /// An executor with its numbers in full.
    pub(crate) fn in_full(executor: &ExecutorChoice) -> Self {
        Self { executor: executor.clone(), storage: StorageName::F32, projection: ProjectionModel::Affine }
    }
    /// How it stores numbers.
    pub(crate) fn storage(&self) -> Storage {
        match self.storage {
            StorageName::F32 => Storage::F32,
            StorageName::F16 => Storage::F16,
        }
    }
}

/// Reading a file of light.
#[derive(Args, Debug)]
pub(crate) struct EnvOptions {
    /// Direction of the file's upper edge: the scene's up, Blender's z, or y as in GaussianShader's files.
    #[arg(long, alias = "env_up", value_enum, default_value_t = EnvUp::Scene)]
    pub(crate) env_up: EnvUp,
    /// Brightness of the light, in stops: 1 doubles it.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(crate) exposure: f32,
}

/// Put a scene under another light.
///
/// The light is a lat-long map of linear radiance, .hdr or .exr; .png, .jpg and .webp are read too, with a warning, because
/// nothing in them is brighter than white. NaN, infinite and negative numbers are replaced, and counted. Pictures go to MODEL/relight/ENV/ours_N/renders, or to OUT/rgb, with a preview of the light beside them.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula relight out/spheres --env sunset.hdr
  specula relight out/spheres --env sunset.hdr --background env
  specula relight out/spheres --env sunset.hdr --exposure 1 --turntable 36 -o turn
  specula relight out/spheres --env forest.hdr --truth data/spheres/relight/forest")]
pub(crate) struct Relight {
    /// Folder of a model, or a PLY file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// The new light.
    #[arg(long, value_name = "FILE")]
    pub(crate) env: PathBuf,
    #[command(flatten)]
    pub(crate) env_options: EnvOptions,
    #[command(flatten)]
    pub(crate) look: Look,
    /// Folder for the pictures.
    #[arg(long, short, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// True pictures under the new light, named as the views, to measure against.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) truth: Option<PathBuf>,
    /// Print the measures as JSON.
    #[arg(long, requires = "truth")]
    pub(crate) json: bool,
}

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
    #[arg(long, short, alias = "source_path", value_name = "DATASET")]
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

/// Look around in a scene, in a browser.
///
/// Serves a page at an address that goes to stdout, until Ctrl-C. Pictures are rendered here and sent as they are asked
/// for: open it on a phone or over a slow link, and they become smaller while one moves. Drag to turn, scroll or pinch
/// to come closer, press ? for all keys. Layers are chosen with 1 to 0; a lat-long map of light (.hdr, .exr) can be dropped
/// onto the page, and dragged to be turned; the camera can be sent along a path, whose frames come as a ZIP file.
///
/// Only this machine can open the page, unless --listen names an address that others reach. Then whoever opens it needs
/// a token, which is part of the address that is printed. Nothing is encrypted: over a network that is not trusted, use
/// ssh -L 7008:localhost:7008 instead.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula view out/chair
  specula view out/spheres --env sunset.hdr forest.hdr
  specula view scene.ply --background white
  specula view out/chair --listen 0.0.0.0:7008      for a phone in the same network
  specula train data/chair -m out/chair --view      a scene while it is trained")]
pub(crate) struct View {
    /// Folder of a model, or a PLY file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// Address of the page; port 0 takes any that is free.
    #[arg(long, value_name = "[HOST:]PORT", default_value = crate::view::ADDRESS, value_parser = address)]
    pub(crate) listen: SocketAddr,
    /// Password of the page; by default a random one where other machines can reach it, else none.
    #[arg(long, value_name = "WORD", value_parser = token)]
    pub(crate) token: Option<String>,
    /// Lights to choose from, beside the scene's: lat-long maps, .hdr or .exr.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub(crate) env: Vec<PathBuf>,
    /// Direction of these files' upper edges: the scene's up, or an axis of the world.
    #[arg(long, alias = "env_up", value_enum, default_value_t = EnvUp::Scene)]
    pub(crate) env_up: EnvUp,
    /// Behind the scene; the training's background by default, else black.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<Background>,
    #[command(flatten)]
    pub(crate) showing: Showing,
}

/// Write a scene for other programs: Gaussians, its light, or a mesh.
///
/// The ending of each FILE says what it becomes. Gaussians: .ply, INRIA's layout, which any viewer of Gaussians opens;
/// .splat, 32 bytes each, a colour that is the same from everywhere; .spz, compressed; .glb, glTF with
/// KHR_gaussian_splatting, and what shading needs beside it. Light: .hdr or .exr, lat-long; .ktx2, filtered for every
/// roughness, as specula prefilter writes it. Mesh: .obj, or .ply with --mesh, fused from rendered depths.
///
/// Other programs know no shading function. So colours of shaded Gaussians are baked into spherical harmonics, which
/// look the same but for sharp reflections, and cannot be relit: --bake sh, the default, because the diffuse colour
/// alone, --bake diffuse, lacks all reflections. The directions that count are those from which the cameras of
/// the training see a Gaussian. How far pictures of what was written are from specula's own is printed, in dB.
///
/// Places and directions are those of the data set's world; nothing is turned or scaled, unless --upright asks for it.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula export out/chair -o chair.ply
  specula export out/chair -o chair.splat chair.spz chair.glb
  specula export out/chair --env sunset.hdr -o sunset.ply         under another light
  specula export out/chair -o light.exr light.ktx2
  specula export out/garden -o garden.splat --upright             photographs, put upright
  specula export out/chair -o chair.obj --voxels 384")]
pub(crate) struct Export {
    /// Folder of a model, or a PLY file.
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Files to write; the ending is the format: .ply, .splat, .spz, .glb, .hdr, .exr, .ktx2, .obj.
    #[arg(long, short, value_name = "FILE", num_args = 1.., required = true)]
    pub(crate) output: Vec<PathBuf>,
    /// Colours of a shaded scene in other programs.
    #[arg(long, value_enum, default_value_t = BakeName::Sh)]
    pub(crate) bake: BakeName,
    /// Degree of the spherical harmonics, 0 to 3; 3 by default, or that of a plain scene.
    #[arg(long, alias = "sh_degree", value_name = "N", value_parser = clap::value_parser!(u8).range(0..=3))]
    pub(crate) sh_degree: Option<u8>,
    /// Omit Gaussians whose opacity is below this; below 1/255, the default, they are invisible.
    #[arg(long, alias = "min_opacity", value_name = "0..1", default_value_t = specula_core::cutoffs::ALPHA_MIN, value_parser = share)]
    pub(crate) min_opacity: f32,
    /// Another light, instead of the scene's: a lat-long map, .hdr or .exr (.png, .jpg and .webp end at white).
    #[arg(long, value_name = "FILE")]
    pub(crate) env: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) env_options: EnvOptions,
    /// Write a mesh where the ending, .ply, could be either.
    #[arg(long)]
    pub(crate) mesh: bool,
    /// Voxels of a mesh along the longest edge of its volume.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u16).range(8..=1024))]
    pub(crate) voxels: u16,
    /// Up axis of files of light: that of the scene's world, or y, as engines have it.
    #[arg(long, value_enum, default_value_t = Up::Z)]
    pub(crate) up: Up,
    /// Put the scene upright: up along the format's up axis (-y in .ply and .splat, +y in .spz, .glb and meshes, --up in
    /// light), its middle at the origin, its cameras at a median distance of 4, the first of them in front.
    #[arg(long)]
    pub(crate) upright: bool,
    /// Skip rendering and printing the error of the written files.
    #[arg(long, alias = "no_error")]
    pub(crate) no_error: bool,
    /// Behind the scene where pictures are compared; the training's background by default, else black.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<Background>,
    #[command(flatten)]
    pub(crate) showing: Showing,
}

/// What becomes of a shading function where none is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BakeName {
    /// Its colours, as spherical harmonics.
    Sh,
    /// Its diffuse colour alone.
    Diffuse,
}

/// Filter a light for every roughness, and write it as a cube map that other programs load.
///
/// ENV is a lat-long map of linear radiance, .hdr or .exr, or the folder of a model, whose light is taken. OUT.ktx2
/// becomes a cube map of halves with a mip level for each roughness, as engines look reflections up; OUT.exr becomes a
/// file for each level, OUT.level0.exr and so on, six faces in a column, for programs that read no KTX 2.0. OUT.json
/// says which level has which roughness, how faces lie, and what to multiply by.
///
/// Faces are +X -X +Y -Y +Z -Z, as graphics interfaces look them up. With --up y, as engines have it, +y is above, and
/// the light of a model, whose world has z above, is turned: (x, y, z) becomes (x, z, -y).
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula prefilter sunset.hdr -o sunset.ktx2
  specula prefilter sunset.hdr -o sunset.ktx2 --resolution 128 --roughness filament --previews
  specula prefilter out/chair -o chair.ktx2
Schemes:
  specula    a mip chain from a mirror to roughness 1, from the light's integral; the default
  paper      the levels of the authors' code (0.08 to 0.5, then 1), from the light's integral
  official   those levels with the weights of the authors' code, to compare with
Light far from a lobe's middle is taken in pieces that stand for many texels, so levels are close to the integral and
not equal to it. Beside a sun of a single texel, 65 536 times as bright as the sky, the second level of a chain from 64
texels on is up to 104 per cent off, the third 33, the fourth 9 and the last 3, which shows as blotches.")]
pub(crate) struct Prefilter {
    /// A lat-long map, or the folder of a model.
    #[arg(value_name = "ENV")]
    pub(crate) env: PathBuf,
    /// The cube map; its ending says what is written.
    #[arg(long, short, value_name = "OUT.ktx2|OUT.exr")]
    pub(crate) output: PathBuf,
    /// Texels along an edge of the sharpest level, a power of two; 256 by default, or that of the model's light.
    #[arg(long, value_name = "N", value_parser = cube_resolution)]
    pub(crate) resolution: Option<usize>,
    /// Levels, each half as wide as the one before; by default down to 4 texels, which measures best.
    #[arg(long, value_name = "N")]
    pub(crate) levels: Option<usize>,
    /// Roughness ρ of the levels: level / last = ρ, as in glTF and Bevy, the default; or ρ (2 − ρ), as in Filament.
    #[arg(long, value_enum)]
    pub(crate) roughness: Option<MipName>,
    /// Levels and weights.
    #[arg(long, value_enum, default_value_t = SchemeName::Specula)]
    pub(crate) scheme: SchemeName,
    /// Up axis of the cube.
    #[arg(long, value_enum, default_value_t = Up::Y)]
    pub(crate) up: Up,
    /// Brightness of the light, in stops: 1 doubles it.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(crate) exposure: f32,
    /// A picture of each level beside it, lat-long: OUT.level0.png and so on.
    #[arg(long)]
    pub(crate) previews: bool,
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
    #[arg(long, alias = "no_stability")]
    pub(crate) no_stability: bool,
}

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

/// Kinds of training, and of reading what was trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ProfileName {
    /// Whatever measures best.
    Specula,
    /// The paper to the letter.
    Paper,
    /// What the authors' code does.
    Official,
    /// Plain Gaussian splatting.
    #[value(name = "3dgs")]
    #[serde(rename = "3dgs")]
    Plain,
}

impl ProfileName {
    /// The name, as typed.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Specula => "specula",
            Self::Paper => "paper",
            Self::Official => "official",
            Self::Plain => "3dgs",
        }
    }
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

/// Which views of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Split {
    /// Training views.
    Train,
    /// Held-out views.
    Test,
    /// All of them.
    All,
}

impl Split {
    /// The name, as typed.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Test => "test",
            Self::All => "all",
        }
    }
}

impl Split {
    /// Whether test views belong to it.
    pub(crate) fn has_test(self) -> bool {
        self != Self::Train
    }
    /// Whether training views belong to it.
    pub(crate) fn has_train(self) -> bool {
        self != Self::Test
    }
}

/// How numbers are stored where a scene is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum StorageName {
    /// In full.
    F32,
    /// As halves, two to a word.
    F16,
}

/// Levels of a light and their weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SchemeName {
    /// A mip chain, from the light's integral.
    Specula,
    /// The authors' levels, from the light's integral.
    Paper,
    /// The authors' levels and weights.
    Official,
}

/// Which roughness the levels of a mip chain have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MipName {
    /// As in glTF and Bevy.
    Linear,
    /// As in Filament.
    Filament,
}

/// Which axis a file of light has above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    /// That of GaussianShader and nvdiffrec.
    Y,
    /// Blender's.
    Z,
}

impl Up {
    /// What a file with this has above.
    pub(crate) fn axis(self) -> UpAxis {
        match self {
            Self::Y => UpAxis::Y,
            Self::Z => UpAxis::Z,
        }
    }

    /// How a file with this above stands in a world.
    pub(crate) fn stand(self) -> Stand {
        self.axis().into()
    }
}

/// What a file of light has above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EnvUp {
    /// What is above in the scene.
    Scene,
    /// The axis of GaussianShader and nvdiffrec.
    Y,
    /// Blender's axis.
    Z,
}

impl EnvUp {
    /// How the file stands in a scene that has this above.
    pub(crate) fn stand(self, above: Vec3) -> Stand {
        match self {
            Self::Scene => Stand::above(above.as_dvec3().to_array()),
            Self::Y => Up::Y.stand(),
            Self::Z => Up::Z.stand(),
        }
    }
}

/// Whether nothing is asked for but the profile's own.
fn is_of_profile(degree: &Option<i8>) -> bool {
    degree.is_none_or(|degree| degree < 0)
}

/// Layer of pictures by its name.
fn layer() -> impl TypedValueParser<Value = Layer> {
    let names = Layer::EACH.into_iter().chain([Layer::All]).map(Layer::name);
    PossibleValuesParser::new(names).try_map(|name| name.parse())
}

/// A count of random points.
fn random_points(text: &str) -> Result<u32, String> {
    positive(text).and_then(few)
}

/// A count of points behind others.
fn background_points(text: &str) -> Result<u32, String> {
    count(text).and_then(few)
}

/// Not more points than any training begins with: drawing more takes minutes, and no machine trains them.
fn few(number: u32) -> Result<u32, String> {
    const MOST: u32 = 20_000_000;
    if number <= MOST { Ok(number) } else { Err(format!("use {MOST} points at most")) }
}

/// A number as it is typed: TOML's are shorter.
fn as_typed<S: Serializer>(number: &u64, out: S) -> Result<S::Ok, S::Error> {
    match i64::try_from(*number) {
        Ok(number) => out.serialize_i64(number),
        Err(_) => out.collect_str(number),
    }
}

fn downscale(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        "4" => Ok(4),
        "8" => Ok(8),
        _ => Err("use 1, 2, 4 or 8".into()),
    }
}

/// Of a training: with the authors' rule as well, for which 0 stands until a picture was seen.
fn downscale_or_rule(text: &str) -> Result<u32, String> {
    if text == "-1" { Ok(AT_MOST_1600) } else { downscale(text) }
}

fn finite(text: &str) -> Result<f32, String> {
    let number: f32 = text.parse().map_err(|_| "use a number".to_owned())?;
    if number.is_finite() { Ok(number) } else { Err("use a finite number".into()) }
}

/// A port of this machine, or a host and a port.
fn address(text: &str) -> Result<SocketAddr, String> {
    let here = || text.parse().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port))).ok();
    let named = || text.to_socket_addrs().ok().and_then(|mut addresses| addresses.next());
    here().or_else(named).ok_or_else(|| "use a port, or a host and a port, such as 7008 or 0.0.0.0:7008".to_owned())
}

/// A word that an address and a header can hold.
fn token(text: &str) -> Result<String, String> {
    const LEAST: usize = 8;
    let is_fine = text.len() >= LEAST && text.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if is_fine { Ok(text.to_owned()) } else { Err(format!("use {LEAST} letters and digits or more")) }
}

fn weight(text: &str) -> Result<f32, String> {
    let number = finite(text)?;
    if number >= 0.0 { Ok(number) } else { Err("use a number that is not negative".into()) }
}

fn projection(text: &str) -> Result<ProjectionModel, String> {
    match text {
        "affine" => Ok(ProjectionModel::Affine),
        "tangent" => Ok(ProjectionModel::Tangent),
        "ray" => Ok(ProjectionModel::Ray),
        alpha => share(alpha)
            .map(ProjectionModel::Within)
            .map_err(|_| "use affine, tangent, ray, or the alpha from 0 to 1 that affine may be off by".to_owned()),
    }
}

fn above_zero(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "use a number".to_owned())?;
    if number > 0.0 && number.is_finite() { Ok(number) } else { Err("use a number above zero".into()) }
}

fn error_bound(text: &str) -> Result<f64, String> {
    let number = above_zero(text)?;
    if number < 1.0 { Ok(number) } else { Err("use a number below 1, which is white; 5/255 is 0.02".into()) }
}

fn share(text: &str) -> Result<f32, String> {
    let number = finite(text)?;
    if (0.0..=1.0).contains(&number) { Ok(number) } else { Err("use a number from 0 to 1".into()) }
}

fn cube_resolution(text: &str) -> Result<usize, String> {
    const LARGEST: usize = 2048;
    let is_fine = |size: &usize| (16..=LARGEST).contains(size) && size.is_power_of_two();
    text.parse().ok().filter(is_fine).ok_or_else(|| format!("use a power of two from 16 to {LARGEST}"))
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let number = |part: &str| part.trim().parse().ok();
    let both = text.split_once([',', 'x']).and_then(|(width, height)| Some([number(width)?, number(height)?]));
    view_size(both.ok_or("use two numbers, such as 640,480")?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn counts_are_typed_as_people_write_them_and_points_have_a_limit() {
        let words = "specula train data -m out --iterations 7k --save-iterations 1e3,2_000 --random-points 20k";
        let Command::Train(train) = Arguments::try_parse_from(words.split(' ')).unwrap().command else {
            panic!("train")
        };
        assert_eq!((train.iterations, train.save_iterations), (7000, vec![1000, 2000]));
        assert_eq!(train.start.random_points, Some(20_000));
        for wrong in ["--random-points 500000000", "--iterations 0", "--iterations many", "--background-points 1e9"] {
            let words = format!("specula train data -m out {wrong}");
            assert!(Arguments::try_parse_from(words.split(' ')).is_err(), "{wrong} was taken");
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn the_fields_names_are_understood() {
        let words =
            "specula train -s data -m out --lambda_zero_one 0.001 --densify_grad_threshold 0.0004 --sh_degree 2";
        let authors = "specula train -s data -m out --eval -w -r -1 --brdf_dim 0 --sh_degree -1 --brdf_env 512";
        let Command::Train(train) = Arguments::try_parse_from(authors.split(' ')).unwrap().command else {
            panic!("train")
        };
        assert_eq!((train.resolution, train.brdf_dim, train.start.sh_degree), (AT_MOST_1600, Some(0), Some(-1)));
        assert_eq!(train.start.light_resolution, Some(512));
        let eval = "specula eval out -r -1";
        assert!(Arguments::try_parse_from(eval.split(' ')).is_err(), "a model has one size already");
        let Command::Train(train) = Arguments::try_parse_from(words.split(' ')).unwrap().command else {
            panic!("train")
        };
        assert_eq!((train.losses.lambda_sparse, train.start.sh_degree), (Some(0.001), Some(2)));
    }
}
