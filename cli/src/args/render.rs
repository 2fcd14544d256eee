//! Arguments of `specula render` and `specula relight`.

use super::{
    lights::Lights,
    parse::{error_bound, size},
    scene::{EnvOptions, OwnLightOption, SceneOptions, ShadingOption},
};
use clap::{
    Args, ValueEnum,
    builder::{PossibleValuesParser, TypedValueParser},
};
use specula_scene::{
    Layer,
    backdrop::BackgroundChoice,
    camera_set::{CameraChoice, Split},
};
use std::path::PathBuf;

/// Render a scene: its colours, normals, depth and other layers.
///
/// SCENE is a model folder, or any .ply, .glb, .spz or .splat file. The cameras are those of the
/// test views of the model, unless --cameras or --turntable is given. Pictures are written to
/// MODEL/test/ours_N/renders/00000.png and so on, with the ground truth in gt if the data set is
/// available; with -o, to OUT/LAYER/00000.png.
///
/// Data that the selected layers do not depend on is skipped, which changes no bit of the pictures;
/// specula info lists it.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula render out/chair
  specula render out/chair --layers rgb --verify-omissions
  specula render out/chair --layers rgb --max-error 0.01
  specula render out/chair --layers rgb --max-error 0.01 --no-verify
  specula render out/chair --layers rgb --projection ray
  specula render out/chair --layers all -o pictures
  specula render out/chair --layers rgb,depth --exr -o numbers
  specula render scene.ply --turntable 36 --size 640,480 -o turn
  specula render scene.ply --cameras cameras.json -o pictures")]
pub(crate) struct Render {
    /// Model folder, .ply, .glb, .spz or .splat file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) views: ViewOptions,
    /// Output folder.
    #[arg(long, short, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Layers to render, separated by commas.
    #[arg(long, value_parser = layer(), value_delimiter = ',', default_values = DEFAULT_LAYERS.map(Layer::name))]
    pub(crate) layers: Vec<Layer>,
    /// Environment map that replaces the light of the scene: lat-long, .hdr or .exr (.png, .jpg and
    /// .webp have no radiance above white).
    #[arg(long, value_name = "FILE")]
    pub(crate) env: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) env_options: EnvOptions,
    #[command(flatten)]
    pub(crate) light: OwnLightOption,
    /// Render each view a second time with nothing skipped and print the largest difference. Exits
    /// with code 1 if it is not 0.
    #[arg(long)]
    pub(crate) verify_omissions: bool,
    /// Render on the CPU with the cheapest settings whose colours are within E of exact ones (RMS
    /// of sRGB, where white is 1), which are in the given --order. Each picture is compared with
    /// the most exact one, which is written instead if the error is larger; see docs/accuracy.md.
    #[arg(long, value_name = "E", value_parser = error_bound, conflicts_with_all = ["verify_omissions", "storage", "projection"])]
    pub(crate) max_error: Option<f64>,
    /// With --max-error, do not compare pictures with exact ones. This is faster, but views that
    /// did not select the settings may have errors above E.
    #[arg(long, requires = "max_error")]
    pub(crate) no_verify: bool,
}

/// Layers that `specula render` renders unless others are named.
pub(crate) const DEFAULT_LAYERS: [Layer; 4] = [Layer::Rgb, Layer::Normal, Layer::Depth, Layer::Alpha];

/// Parser of a layer's name.
pub(super) fn layer() -> impl TypedValueParser<Value = Layer> {
    let names = Layer::EACH.into_iter().chain([Layer::All]).map(Layer::name);
    PossibleValuesParser::new(names).try_map(|name| name.parse())
}

/// Render a scene under another light: an environment map, suns and lamps.
///
/// An environment map is a lat-long map of linear radiance, .hdr or .exr. Files in .png, .jpg and
/// .webp are accepted with a warning, since they have no radiance above white. NaN, infinite and
/// negative values are replaced and counted. Suns and lamps cast shadows; they shine on models with
/// materials. Pictures are written to MODEL/relight/ENV/ours_N/renders or to OUT/rgb, with a
/// preview of the environment beside them.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula relight out/spheres --env sunset
  specula relight out/spheres --env studio.exr --background env
  specula relight out/spheres --env sunset.hdr --exposure 1 --turntable 36 -o turn
  specula relight out/spheres --sun 30,45
  specula relight out/spheres --env sunset.hdr --exposure -2 --sun 30,20,4,2:ffcc99
  specula relight out/spheres --lamp 1,0,2,5,0.2 --lamp -2,1,1,3:88aaff
  specula relight out/spheres --sun 30,45,3,4 --ground --background white
  specula relight out/spheres --sun 30,45,3,4 --ground --background transparent
  specula relight out/spheres --sun 30,45 --ground --crop auto
  specula relight out/spheres --env sunset.hdr --layers rgb,irradiance,visibility
  specula relight out/spheres --lights evening.toml --turn-light 48 -o evening
  specula relight out/spheres --env forest.hdr --truth data/spheres/relight/forest")]
pub(crate) struct Relight {
    /// Model folder, .ply, .glb, .spz or .splat file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    #[command(flatten)]
    pub(crate) lights: Lights,
    #[command(flatten)]
    pub(crate) env_options: EnvOptions,
    #[command(flatten)]
    pub(crate) views: ViewOptions,
    /// Output folder.
    #[arg(long, short, value_name = "OUT")]
    pub(crate) output: Option<PathBuf>,
    /// Layers to render, separated by commas.
    #[arg(long, value_parser = layer(), value_delimiter = ',', default_value = "rgb")]
    pub(crate) layers: Vec<Layer>,
    /// Folder of ground-truth pictures under the new light, named as the views, to compare with.
    #[arg(long, value_name = "FOLDER", conflicts_with = "upright")]
    pub(crate) truth: Option<PathBuf>,
    /// Print measures as JSON.
    #[arg(long, requires = "truth")]
    pub(crate) json: bool,
}

/// Cameras, size, background and files of pictures.
#[derive(Args, Clone, Debug)]
pub(crate) struct ViewOptions {
    /// Camera file: transforms.json, or cameras.json in INRIA's format.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["split", "turntable"])]
    pub(crate) cameras: Option<PathBuf>,
    /// Views of the model to render.
    #[arg(long, value_enum, conflicts_with = "turntable")]
    pub(crate) split: Option<SplitName>,
    /// Render N cameras on a circle around the scene, and an animation; back and forth if the
    /// cameras of the model cover less than three quarters of the circle.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=3600))]
    pub(crate) turntable: Option<u32>,
    /// Width and height of the pictures; by default those of the cameras. Another aspect ratio
    /// shows more of the scene and does not stretch it.
    #[arg(long, value_name = "W,H", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Rotate pictures by 90° or 180° if the scene lies on its side, as in many photographs from
    /// phones.
    #[arg(long)]
    pub(crate) upright: bool,
    /// Background of the colours: black, white or R,G,B; env for the environment light; or
    /// transparent for alpha. By default that of the training, else black.
    #[arg(long, value_name = "black|white|R,G,B|env|transparent")]
    pub(crate) background: Option<BackgroundChoice>,
    /// Also write the numbers of each layer, as 32-bit floats in OpenEXR: depth in units of the
    /// scene, normals, colours in linear light with alpha, without background and ground.
    #[arg(long)]
    pub(crate) exr: bool,
    #[command(flatten)]
    pub(crate) shading: ShadingOption,
    #[command(flatten)]
    pub(crate) scene_options: SceneOptions,
}

/// Views of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SplitName {
    /// Training views.
    Train,
    /// Held-out views.
    Test,
    /// All of them.
    All,
}

impl From<SplitName> for Split {
    fn from(name: SplitName) -> Self {
        match name {
            SplitName::Train => Self::Train,
            SplitName::Test => Self::Test,
            SplitName::All => Self::All,
        }
    }
}

impl From<&ViewOptions> for CameraChoice {
    fn from(options: &ViewOptions) -> Self {
        Self {
            file: options.cameras.clone(),
            split: options.split.map(Into::into),
            turntable: options.turntable,
            size: options.size,
            is_upright: options.upright,
            up: options.scene_options.scene_up.map(Into::into),
        }
    }
}
