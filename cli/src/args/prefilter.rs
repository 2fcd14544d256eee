//! Arguments of `specula prefilter`.

use super::{
    parse::{cube_resolution, finite},
    scene::Up,
};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Prefilter an environment map for every roughness, as a cube map for other programs.
///
/// ENV is a lat-long map of linear radiance, .hdr or .exr, or a model folder, whose light is used.
/// OUT.ktx2 is a half-float cube map with a mip level per roughness, ready for reflection look-ups.
/// OUT.exr is one file per level, OUT.level0.exr and so on, with the six faces in a column, for
/// programs without KTX 2.0. OUT.json describes the roughness of each level, the layout of the
/// faces and the scale of the values.
///
/// Faces are in the order +X -X +Y -Y +Z -Z, in the convention of graphics APIs. With --up y, the
/// convention of most engines, the light of a model, whose world is z-up, is rotated: (x, y, z)
/// becomes (x, z, -y).
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula prefilter sunset.hdr -o sunset.ktx2
  specula prefilter sunset.hdr -o sunset.ktx2 --resolution 128 --roughness filament --previews
  specula prefilter out/chair -o chair.ktx2
Schemes:
  specula    a mip chain from roughness 0 to 1, integrated over the light; the default
  paper      the levels of the authors' code (0.08 to 0.5, then 1), integrated over the light
  official   the same levels with the weights of the authors' code, for comparison
Light far from the centre of a lobe is integrated over blocks of texels, so levels approximate the
integral. Next to a sun of a single texel, 65 536 times as bright as the sky, the second level of a
chain from 64 texels on is off by up to 104 %, the third by 33 %, the fourth by 9 % and the last by
3 %, which is visible as blotches.")]
pub(crate) struct Prefilter {
    /// Lat-long map or model folder.
    #[arg(value_name = "ENV")]
    pub(crate) env: PathBuf,
    /// Output file; the extension selects the format.
    #[arg(long, short, value_name = "OUT.ktx2|OUT.exr")]
    pub(crate) output: PathBuf,
    /// Face resolution of the sharpest level, a power of two; by default 256, or that of the
    /// model's light.
    #[arg(long, value_name = "N", value_parser = cube_resolution)]
    pub(crate) resolution: Option<usize>,
    /// Number of levels, each half as wide as the one before; by default down to 4 texels, which
    /// measures best.
    #[arg(long, value_name = "N")]
    pub(crate) levels: Option<usize>,
    /// Roughness ρ of the levels: level / last = ρ (linear, as in glTF and Bevy; the default), or
    /// ρ (2 − ρ) (filament).
    #[arg(long, value_enum)]
    pub(crate) roughness: Option<MipName>,
    /// Levels and their weights; see below.
    #[arg(long, value_enum, default_value_t = SchemeName::Specula)]
    pub(crate) scheme: SchemeName,
    /// Up axis of the cube map.
    #[arg(long, value_enum, default_value_t = Up::Y)]
    pub(crate) up: Up,
    /// Exposure of the light in stops; 1 doubles it.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(crate) exposure: f32,
    /// Also write a lat-long preview of each level: OUT.level0.png and so on.
    #[arg(long)]
    pub(crate) previews: bool,
}

/// Levels of a prefiltered light and their weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SchemeName {
    /// Mip chain, integrated over the light.
    Specula,
    /// Levels of the authors' code, integrated over the light.
    Paper,
    /// Levels and weights of the authors' code.
    Official,
}

/// Roughness of the levels of a mip chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MipName {
    /// Linear in the level, as in glTF and Bevy.
    Linear,
    /// Filament's mapping.
    Filament,
}
