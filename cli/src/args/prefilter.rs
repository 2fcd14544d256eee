//! Arguments of `specula prefilter`.

use super::{
    parse::{cube_resolution, finite},
    scene::Up,
};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

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
