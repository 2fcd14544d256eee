//! Arguments of `specula relight`: environment, suns and lamps.

use super::parse::{degrees, finite, shadow_rays};
use clap::Args;
use core::str::FromStr;
use specula_core::lamps::RAYS;
use specula_scene::lamps::{SphereChoice, SunChoice};
use std::{convert::Infallible, path::PathBuf};

/// Light that replaces that of the training.
#[derive(Args, Debug)]
pub(crate) struct Lights {
    /// Environment map: a lat-long file, .hdr or .exr; or sunset, forest or workshop, which the
    /// program contains. Without one, or with none, only suns and lamps shine.
    #[arg(long, value_name = "FILE|NAME|none")]
    pub(crate) env: Option<EnvChoice>,
    #[command(flatten)]
    pub(crate) lamps: LampOptions,
    /// Turn the environment and all suns about the scene's up direction, counterclockwise as seen
    /// from above.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true, value_parser = degrees)]
    pub(crate) turn: f32,
    /// Render the first camera N times while the environment and all suns turn once in a circle,
    /// and an animation.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=3600), conflicts_with_all = ["turntable", "truth"])]
    pub(crate) turn_light: Option<u32>,
    /// Shadow rays of a pixel to each sun and lamp that is wider than a point; more make soft
    /// shadows smoother.
    #[arg(long, value_name = "N", default_value_t = RAYS, value_parser = shadow_rays)]
    pub(crate) shadow_rays: usize,
    /// Add a plane that catches the scene's shadows, in the colour of the background, or black with
    /// alpha if that is transparent. HEIGHT is along the scene's up direction, by default that of
    /// its lowest point.
    #[arg(long, value_name = "HEIGHT", num_args = 0..=1, allow_negative_numbers = true, value_parser = finite, conflicts_with = "truth")]
    pub(crate) ground: Option<Option<f32>>,
}

/// Suns, lamps, and a file of lights.
#[derive(Args, Debug, Default)]
pub(crate) struct LampOptions {
    /// Sun at an azimuth and an elevation in degrees, such as 30,45; may be repeated. Azimuths
    /// count from the centre of an environment map, counterclockwise as seen from above. STRENGTH
    /// is the irradiance of a surface that faces the sun (3 by default; a white one is white at
    /// 3.14), ANGLE the sun's diameter in degrees (0.53 by default; more makes softer shadows),
    /// RRGGBB its colour in sRGB.
    #[arg(long, value_name = "AZ,EL[,STRENGTH[,ANGLE]][:RRGGBB]", allow_hyphen_values = true)]
    pub(crate) sun: Vec<SunChoice>,
    /// Lamp at a point of the scene's world, such as 1,0,2,5; may be repeated. STRENGTH is the
    /// irradiance at a distance of 1, falling with the square of the distance; RADIUS, in units of
    /// the scene, makes shadows soft (0 by default).
    #[arg(long, value_name = "X,Y,Z,STRENGTH[,RADIUS][:RRGGBB]", allow_hyphen_values = true)]
    pub(crate) lamp: Vec<SphereChoice>,
    /// File of lights, in TOML: env (a path from the file's folder), env-up, exposure, turn, and
    /// lists of text, sun and lamp, as these options. Options of the command line are added, and
    /// --env and --env-up replace those of the file.
    #[arg(long, value_name = "FILE")]
    pub(crate) lights: Option<PathBuf>,
}

/// First lights of a page.
#[derive(Args, Debug, Default)]
pub(crate) struct FirstLights {
    #[command(flatten)]
    pub(crate) lamps: LampOptions,
    /// The page starts with ground that catches the scene's shadows.
    #[arg(long)]
    pub(crate) ground: bool,
}

/// Requested environment map.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum EnvChoice {
    /// Map from a file.
    File(PathBuf),
    /// No light: all zeros.
    None,
}

impl FromStr for EnvChoice {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(if text == "none" { Self::None } else { Self::File(text.into()) })
    }
}
