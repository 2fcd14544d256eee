//! Arguments of `specula export`.

use super::{
    lights::FirstLights,
    parse::{share, texture_size, triangles},
    scene::{EnvOptions, OwnLightOption, SceneOptions, Up},
};
use clap::{Args, ValueEnum};
use specula_scene::backdrop::BackgroundColor;
use std::path::PathBuf;

/// Export a scene for other programs: Gaussians, light or mesh.
///
/// The extension of each FILE selects its format. Gaussians: .ply in INRIA's layout, which viewers
/// of Gaussians open; .splat with 32 bytes per Gaussian and a view-independent colour; .spz,
/// compressed; .glb, glTF with KHR_gaussian_splatting and an extension with the shading attributes;
/// .usda and .usdz, OpenUSD with materials as primvars and the light as a dome.
/// Light: .hdr or .exr, lat-long; .ktx2, prefiltered as by specula prefilter, and described in a
/// .json of the same name. Mesh: .obj, or .ply with --mesh, fused from rendered depth maps; .glb,
/// .usda and .usdz with --mesh, a smoother mesh of fewer triangles with textures of a model's
/// physical materials and normals, for engines, path tracers and phones; a .glb has --sun, --lamp
/// and --lights as its lights. Page: .html, one file with the scene and a renderer that any browser
/// with WebGPU runs, where it can be relit; or a folder for a web server, whose name ends in a
/// slash. A page starts under --env, with --sun, --lamp and --lights, on --ground.
///
/// Other programs do not implement the shading function. With --bake sh, the default, the colours
/// of shaded Gaussians are baked into spherical harmonics, fitted to the directions from which the
/// training cameras see each Gaussian. They match except for sharp reflections, but cannot be
/// relit. --bake diffuse exports only the diffuse colour, without reflections. --bake materials
/// exports the physical materials of a model of train --relightable for programs that relight: the
/// albedo as colour and, in .ply and .glb, normals, metalness and roughness. The error of the
/// exported files is measured against pictures by specula and printed in dB.
///
/// Positions and directions are those of the data set's world, unless --upright is given; in .glb,
/// .usda and .usdz a node turns them upright.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula export out/chair -o chair.ply
  specula export out/chair -o chair.splat chair.spz chair.glb chair.usdz
  specula export out/chair --env sunset.hdr -o sunset.ply       # under another light
  specula export out/spheres --bake materials -o spheres.ply    # to relight elsewhere
  specula export out/chair -o light.exr light.ktx2
  specula export out/garden -o garden.splat --upright           # photographs, upright
  specula export out/chair -o chair.obj --voxels 384
  specula export out/spheres -o spheres.glb spheres.usdz --mesh # for engines and phones
  specula export out/spheres -o blender.glb sunset.hdr --mesh --env sunset --sun 30,45
  specula export out/spheres -o spheres.html --env sunset --sun 30,45 --ground
  specula export out/chair -o chair.html --page-env sunset.hdr studio.exr
  specula export out/chair -o site/                             # for a web server")]
pub(crate) struct Export {
    /// Model folder, .ply, .glb, .spz or .splat file.
    #[arg(value_name = "MODEL")]
    pub(crate) model: PathBuf,
    /// Output files; the format is that of the extension: .ply, .splat, .spz, .glb, .usda, .usdz,
    /// .hdr, .exr, .ktx2, .obj, .html; a folder, with a slash at the end, holds a page for a web
    /// server.
    #[arg(long, short, value_name = "FILE", num_args = 1.., required = true)]
    pub(crate) output: Vec<PathBuf>,
    /// Colours of a shaded scene in other programs: spherical harmonics, the diffuse colour, or
    /// the albedo with materials.
    #[arg(long, value_enum, default_value_t = BakeName::Sh)]
    pub(crate) bake: BakeName,
    /// Degree of the spherical harmonics, 0 to 3; by default 3, or that of an unshaded scene.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=3))]
    pub(crate) sh_degree: Option<u8>,
    /// Omit Gaussians whose opacity is below this; Gaussians below the default, 1/255, are
    /// invisible.
    #[arg(long, value_name = "0..1", default_value_t = specula_core::cutoffs::ALPHA_MIN, value_parser = share)]
    pub(crate) min_opacity: f32,
    /// Environment map that replaces the light of the scene: lat-long, .hdr or .exr (.png, .jpg and
    /// .webp have no radiance above white); or sunset, forest or workshop, which the program
    /// contains. A page starts under it, and still offers the light of the scene.
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) env: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) env_options: EnvOptions,
    /// Environment maps that a page offers in addition to the scene's light and that of --env.
    #[arg(long, value_name = "FILE|NAME", num_args = 1..)]
    pub(crate) page_env: Vec<PathBuf>,
    /// A page starts with these suns and lamps under the map of --env, else that of --lights;
    /// without a map they are its only light, as with relight.
    #[command(flatten)]
    pub(crate) first: FirstLights,
    /// Store the numbers of a page in full, in five times the space, instead of rounded.
    #[arg(long)]
    pub(crate) page_exact: bool,
    /// Write .ply files as meshes, .glb, .usda and .usdz files as meshes with textures.
    #[arg(long)]
    pub(crate) mesh: bool,
    /// Largest number of triangles of a mesh, smoothed by the scene's normals, such as 20k; by
    /// default 50000 with textures, else all, as fused.
    #[arg(long, value_name = "N", value_parser = triangles)]
    pub(crate) triangles: Option<usize>,
    /// Rows and columns of the textures of a mesh; by default 2048.
    #[arg(long, value_name = "N", value_parser = texture_size)]
    pub(crate) texture: Option<u32>,
    /// Voxels along the longest edge of the volume that a mesh is fused in.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u16).range(8..=1024))]
    pub(crate) voxels: u16,
    /// Up axis of exported lights: z, that of the scene's world, or y, that of most engines.
    #[arg(long, value_enum, default_value_t = Up::Z)]
    pub(crate) up: Up,
    /// Align the scene: up direction along the up axis of the format (-y in .ply and .splat, +y in
    /// .spz, .glb, .usda and meshes, --up in lights), its centre at the origin, its cameras at a
    /// median distance of 4, the first one in front.
    #[arg(long)]
    pub(crate) upright: bool,
    /// Skip measuring the error of the exported files.
    #[arg(long)]
    pub(crate) no_error: bool,
    /// Background of the pictures that are compared; by default that of the training, else black.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<BackgroundColor>,
    #[command(flatten)]
    pub(crate) light: OwnLightOption,
    #[command(flatten)]
    pub(crate) scene_options: SceneOptions,
}

/// Substitute for the shading function in formats without one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BakeName {
    /// Shaded colours, as spherical harmonics.
    Sh,
    /// Diffuse colour.
    Diffuse,
    /// Albedo, metalness and roughness.
    Materials,
}
