//! Arguments of `specula render` and `specula relight`.

use super::{
    parse::{error_bound, size},
    scene::{EnvOptions, Showing},
};
use crate::background::Backdrop;
use clap::{
    Args, ValueEnum,
    builder::{PossibleValuesParser, TypedValueParser},
};
use specula_scene::Layer;
use std::path::PathBuf;

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
    #[arg(long)]
    pub(crate) verify_omissions: bool,
    /// Render with the cheapest setting whose colours are within E of exact ones (RMS of sRGB, 1 is white), on the CPU. Each
    /// picture is compared with the most exact one, which is written where it is further off. docs/accuracy.md.
    #[arg(long, value_name = "E", value_parser = error_bound, conflicts_with_all = ["verify_omissions", "storage", "projection"])]
    pub(crate) max_error: Option<f64>,
    /// With --max-error, do not compare pictures with exact ones: as quick as the setting is, but a
    /// view that it was not chosen by may be further off than E.
    #[arg(long, requires = "max_error")]
    pub(crate) no_verify: bool,
}

/// Layer of pictures by its name.
pub(super) fn layer() -> impl TypedValueParser<Value = Layer> {
    let names = Layer::EACH.into_iter().chain([Layer::All]).map(Layer::name);
    PossibleValuesParser::new(names).try_map(|name| name.parse())
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
