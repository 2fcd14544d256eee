//! Arguments of `specula export`.

use super::{
    parse::share,
    scene::{EnvOptions, Showing, Up},
};
use crate::background::Background;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

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
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=3))]
    pub(crate) sh_degree: Option<u8>,
    /// Omit Gaussians whose opacity is below this; below 1/255, the default, they are invisible.
    #[arg(long, value_name = "0..1", default_value_t = specula_core::cutoffs::ALPHA_MIN, value_parser = share)]
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
    #[arg(long)]
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
