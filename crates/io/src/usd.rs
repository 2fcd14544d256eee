//! OpenUSD stages, `.usda` (text, with its textures beside it) and `.usdz` (an archive): Gaussians
//! by the schema `ParticleField3DGaussianSplat` of OpenUSD 26.03, or a mesh with textures.
//!
//! | prim | contents |
//! |---|---|
//! | `/Scene` | `Xform`, the default prim, with the placement of the scene |
//! | `/Scene/Gaussians` | positions, orientations (w, x, y, z), scales, opacities, harmonics |
//! | `/Scene/Light` | `DomeLight` with a lat-long OpenEXR texture of linear radiance |
//! | `/Scene/Mesh` | triangles, with normals and texture coordinates `st` at each vertex |
//! | `/Scene/Surface` | `UsdPreviewSurface` of the mesh, with its textures |
//!
//! Scales are linear, opacities from 0 to 1; orientations are w, x, y, z. Colours are
//! ½ + Σ Y_k c_k of the harmonics, Gaussian by Gaussian, and sRGB-encoded, which
//! `colorSpace:name` says. The schema has no materials, so these are primvars with names of our
//! choice: `normals`, and of physical materials `albedo` (linear), `roughness` (perceptual) and
//! `metallic`.
//!
//! The texture follows OpenEXR: +y at the upper edge, +z in the centre, x decreasing to the right.

use crate::{
    error::{Error, Result},
    gaussian_ply::SurfaceMaterial,
    glb::Placement,
    latlong::{self, LatLong, MapOrientation, UpAxis, ending},
    mesh::TexturedMesh,
    picture::to_png,
    splat::unit,
    whole_file,
};
use core::fmt::Display;
use glam::{DQuat, DVec3};
use specula_core::{
    activation::sigmoid,
    scene::{Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT},
};
use std::{
    io::{self, Cursor, Write},
    path::Path,
};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// Deviations from the mean that the extent contains.
const DEVIATIONS: f32 = 3.0;
/// Alignment of files in a `.usdz` archive, in bytes.
const ALIGNMENT: u16 = 64;
/// Colour space of the sRGB curve with Rec. 709's primaries.
const SRGB: &str = "srgb_rec709_scene";
/// Linear colour space with Rec. 709's primaries.
const LINEAR: &str = "lin_rec709_scene";
/// Textures of a mesh: base colour; roughness and metalness; normals.
const BASE_COLOR: &str = "base_color.png";
const SURFACE: &str = "roughness_metallic.png";
const NORMALS: &str = "normals.png";

/// Contents of a stage.
#[derive(Clone, Copy, Debug)]
pub struct Stage<'a> {
    /// Gaussians without shading attributes.
    pub gaussians: &'a Gaussians<Vec<f32>>,
    /// Unit normals, if they are known.
    pub normals: Option<&'a [[f32; 3]]>,
    /// Physical materials, if there are any.
    pub materials: Option<&'a [SurfaceMaterial]>,
    /// Light, in [`dome_orientation`].
    pub light: Option<&'a LatLong>,
    /// Transform of the scene.
    pub placement: Option<&'a Placement>,
    /// Up axis of the stage.
    pub up: UpAxis,
    /// Sentence on the origin of the contents.
    pub documentation: &'a str,
}

/// Orientation of a [`Stage`]'s light in the world of its Gaussians: that of OpenEXR, which dome
/// lights use.
pub fn dome_orientation() -> MapOrientation {
    MapOrientation::rotated(UpAxis::Y, DQuat::from_axis_angle(DVec3::Y, core::f64::consts::PI))
}

/// Writes Gaussians and their light, whose texture is `light.exr`: `.usdz` with its texture, or any
/// other extension as text, with the texture beside it as `NAME.light.exr`.
///
/// # Errors
///
/// [`Error::Write`] if a file cannot be written; [`Error::TooLong`] for an archive above 4 GiB.
pub fn write(path: &Path, stage: &Stage<'_>) -> Result<()> {
    const LIGHT: &str = "light.exr";
    let light = stage.light.map(|light| Ok((LIGHT, latlong::exr(path, light)?))).transpose()?;
    write_files(path, light.as_slice(), |out, prefix| {
        write_scene(out, stage.documentation, stage.up, stage.placement, |out| {
            write_gaussians(out, stage)?;
            if light.is_none() {
                return Ok(());
            }
            let file = asset(&format!("{prefix}{LIGHT}"));
            write!(out, "\n    def DomeLight \"Light\"\n    {{\n        asset inputs:texture:file = {file} (\n")?;
            write!(out, "            colorSpace = \"{LINEAR}\"\n        )\n")?;
            write!(out, "        token inputs:texture:format = \"latlong\"\n    }}\n")
        })
    })
}

/// Writes a mesh with its textures `base_color.png`, `roughness_metallic.png` and `normals.png`, as
/// [`write()`] does; the stage has y up. Without materials its base colour is emitted.
///
/// # Errors
///
/// Those of [`write()`].
pub fn write_mesh(path: &Path, mesh: &TexturedMesh, placement: &Placement, documentation: &str) -> Result<()> {
    let pictures =
        [(BASE_COLOR, Some(&mesh.base_color)), (SURFACE, mesh.surface.as_ref()), (NORMALS, mesh.normal_map.as_ref())];
    let textures: Vec<(&str, Vec<u8>)> =
        pictures.into_iter().filter_map(|(name, picture)| Some((name, to_png(picture?)))).collect();
    write_files(path, &textures, |out, prefix| {
        write_scene(out, documentation, UpAxis::Y, Some(placement), |out| {
            write_triangles(out, mesh)?;
            write_surface(out, mesh, prefix)
        })
    })
}

/// Writes the text of a stage and its textures: into an archive for `.usdz`, else as text with the
/// textures beside it. `text` is given the prefix of their names.
fn write_files(
    path: &Path,
    textures: &[(&str, Vec<u8>)],
    text: impl Fn(&mut dyn Write, &str) -> io::Result<()>,
) -> Result<()> {
    if ending(path).as_deref() != Some("usdz") {
        let prefix = format!("{}.", path.file_stem().unwrap_or_default().to_string_lossy());
        let beside = |(name, bytes): &(&str, Vec<u8>)| {
            whole_file::write_bytes(&path.with_file_name(format!("{prefix}{name}")), bytes)
        };
        textures.iter().try_for_each(beside)?;
        return whole_file::write(path, |out| text(out, &prefix));
    }
    let write_error = |cause: io::Error| Error::Write { path: path.to_owned(), cause };
    let mut scene = Vec::new();
    text(&mut scene, "").map_err(write_error)?;
    let len = scene.len() + textures.iter().map(|(_, bytes)| bytes.len()).sum::<usize>();
    if len > u32::MAX as usize {
        return Err(Error::TooLong { path: path.to_owned(), len });
    }
    let files = core::iter::once(("scene.usda", &scene[..])).chain(textures.iter().map(|(name, b)| (*name, &b[..])));
    let bytes = archive(files).map_err(|cause| write_error(io::Error::other(cause)))?;
    whole_file::write_bytes(path, &bytes)
}

/// Archive without compression, whose files are aligned.
fn archive<'a>(files: impl Iterator<Item = (&'a str, &'a [u8])>) -> zip::result::ZipResult<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored).with_alignment(ALIGNMENT);
    for (name, bytes) in files {
        zip.start_file(name, options)?;
        zip.write_all(bytes)?;
    }
    Ok(zip.finish()?.into_inner())
}

/// Writes a stage whose default prim has some `contents`.
fn write_scene(
    out: &mut dyn Write,
    documentation: &str,
    up: UpAxis,
    placement: Option<&Placement>,
    contents: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let up = if up == UpAxis::Y { "Y" } else { "Z" };
    let documentation: String = documentation.chars().filter(|c| !c.is_control() && !matches!(c, '"' | '\\')).collect();
    write!(out, "#usda 1.0\n(\n    defaultPrim = \"Scene\"\n    doc = \"{documentation}\"\n")?;
    write!(out, "    metersPerUnit = 1\n    upAxis = \"{up}\"\n)\n\n")?;
    write!(out, "def Xform \"Scene\" (\n    kind = \"component\"\n)\n{{\n")?;
    if let Some(Placement { rotation: [x, y, z, w], translation, scale }) = placement {
        writeln!(out, "    double3 xformOp:translate = {}", tuple(translation.iter()))?;
        writeln!(out, "    quatd xformOp:orient = {}", tuple([w, x, y, z].into_iter()))?;
        writeln!(out, "    double3 xformOp:scale = {}", tuple([scale; 3].into_iter()))?;
        out.write_all(b"    uniform token[] xformOpOrder = ")?;
        out.write_all(b"[\"xformOp:translate\", \"xformOp:orient\", \"xformOp:scale\"]\n")?;
    }
    contents(out)?;
    writeln!(out, "}}")
}

fn write_gaussians(out: &mut dyn Write, stage: &Stage<'_>) -> io::Result<()> {
    let Stage { gaussians, normals, materials, .. } = *stage;
    let all = || 0..gaussians.count;
    let layout = gaussians.layout;
    let scales = |gaussian: usize| gaussians.get::<3>(gaussian, LOG_SCALE).map(f32::exp);
    writeln!(out, "    def ParticleField3DGaussianSplat \"Gaussians\" (")?;
    write!(out, "        prepend apiSchemas = [\"ColorSpaceAPI\"]\n    )\n    {{\n")?;
    writeln!(out, "        uniform token colorSpace:name = \"{SRGB}\"")?;
    let size = |gaussian: usize| DEVIATIONS * scales(gaussian).into_iter().fold(0.0, f32::max);
    let extent = extent(all().map(|gaussian| (gaussians.get(gaussian, MEAN), size(gaussian))));
    array(out, "float3[] extent", extent.into_iter(), "")?;
    array(out, "point3f[] positions", all().map(|gaussian| gaussians.get::<3>(gaussian, MEAN)), "")?;
    array(out, "quatf[] orientations", all().map(|gaussian| unit(gaussians.get::<4>(gaussian, QUAT))), "")?;
    array(out, "float3[] scales", all().map(scales), "")?;
    let opacities = all().map(|gaussian| gaussians.get::<1>(gaussian, OPACITY).map(sigmoid));
    array(out, "float[] opacities", opacities, "")?;
    let degree = layout.sh_degree.unwrap_or(0);
    writeln!(out, "        uniform int radiance:sphericalHarmonicsDegree = {degree}")?;
    let harmonics = all().flat_map(|gaussian| {
        (0..layout.sh_count()).map(move |k| gaussians.get::<3>(gaussian, layout.sh_start() + 3 * k))
    });
    array(out, "float3[] radiance:sphericalHarmonicsCoefficients", harmonics, "")?;
    writeln!(out, "        uniform token projectionModeHint = \"perspective\"")?;
    writeln!(out, "        uniform token sortingModeHint = \"zDepth\"")?;
    let of_each = "interpolation = \"vertex\"";
    if let Some(normals) = normals {
        array(out, "normal3f[] primvars:normals", normals.iter().copied(), of_each)?;
    }
    if let Some(materials) = materials {
        let linear = format!("colorSpace = \"{LINEAR}\"\n            {of_each}");
        array(out, "color3f[] primvars:albedo", materials.iter().map(|material| material.albedo), &linear)?;
        array(out, "float[] primvars:roughness", materials.iter().map(|material| [material.roughness]), of_each)?;
        array(out, "float[] primvars:metallic", materials.iter().map(|material| [material.metalness]), of_each)?;
    }
    writeln!(out, "    }}")
}

/// Corners of the box around spheres, by their centres and radii.
fn extent(spheres: impl Iterator<Item = ([f32; 3], f32)>) -> [[f32; 3]; 2] {
    let mut extent = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for (centre, radius) in spheres {
        for (k, x) in centre.into_iter().enumerate() {
            extent[0][k] = extent[0][k].min(x - radius);
            extent[1][k] = extent[1][k].max(x + radius);
        }
    }
    extent
}

fn write_triangles(out: &mut dyn Write, mesh: &TexturedMesh) -> io::Result<()> {
    const OF_VERTICES: &str = "interpolation = \"vertex\"";
    writeln!(out, "    def Mesh \"Mesh\" (\n        prepend apiSchemas = [\"MaterialBindingAPI\"]\n    )\n    {{")?;
    writeln!(out, "        rel material:binding = </Scene/Surface>")?;
    writeln!(out, "        uniform token subdivisionScheme = \"none\"")?;
    array(out, "float3[] extent", extent(mesh.positions.iter().map(|place| (*place, 0.0))).into_iter(), "")?;
    array(out, "int[] faceVertexCounts", mesh.triangles.iter().map(|_| [3]), "")?;
    array(out, "int[] faceVertexIndices", mesh.triangles.as_flattened().iter().map(|index| [*index]), "")?;
    array(out, "point3f[] points", mesh.positions.iter().copied(), "")?;
    array(out, "normal3f[] normals", mesh.normals.iter().copied(), OF_VERTICES)?;
    // From the lower left corner.
    array(out, "texCoord2f[] primvars:st", mesh.uvs.iter().map(|[u, v]| [*u, 1.0 - v]), OF_VERTICES)?;
    writeln!(out, "    }}")
}

fn write_surface(out: &mut dyn Write, mesh: &TexturedMesh, prefix: &str) -> io::Result<()> {
    let input = |name: &str, from: &str| format!("{name}.connect = </Scene/Surface/{from}>");
    let mut lines = match &mesh.surface {
        Some(_) => vec![
            input("color3f inputs:diffuseColor", "BaseColor.outputs:rgb"),
            input("float inputs:roughness", "RoughnessMetallic.outputs:g"),
            input("float inputs:metallic", "RoughnessMetallic.outputs:b"),
        ],
        None => vec![
            "color3f inputs:diffuseColor = (0, 0, 0)".to_owned(),
            "color3f inputs:specularColor = (0, 0, 0)".to_owned(),
            "int inputs:useSpecularWorkflow = 1".to_owned(),
            input("color3f inputs:emissiveColor", "BaseColor.outputs:rgb"),
        ],
    };
    lines.extend(mesh.normal_map.is_some().then(|| input("normal3f inputs:normal", "Normals.outputs:rgb")));
    lines.push("token outputs:surface".to_owned());
    write!(out, "\n    def Material \"Surface\"\n    {{\n")?;
    write!(out, "        token outputs:surface.connect = </Scene/Surface/Preview.outputs:surface>\n\n")?;
    shader(out, "Preview", "UsdPreviewSurface", &lines)?;
    shader(
        out,
        "Coordinates",
        "UsdPrimvarReader_float2",
        &["string inputs:varname = \"st\"", "float2 outputs:result"],
    )?;
    let file = |name: &str| format!("{prefix}{name}");
    texture(out, "BaseColor", &file(BASE_COLOR), "sRGB", &["float3 outputs:rgb"])?;
    if mesh.surface.is_some() {
        texture(out, "RoughnessMetallic", &file(SURFACE), "raw", &["float outputs:g", "float outputs:b"])?;
    }
    if mesh.normal_map.is_some() {
        let lines =
            ["float4 inputs:bias = (-1, -1, -1, 0)", "float4 inputs:scale = (2, 2, 2, 1)", "float3 outputs:rgb"];
        texture(out, "Normals", &file(NORMALS), "raw", &lines)?;
    }
    writeln!(out, "    }}")
}

/// Path of a file beside the stage, in a form that may have @ in it.
fn asset(file: &str) -> String {
    if file.contains('@') { format!("@@@./{}@@@", file.replace("@@@", r"\@@@")) } else { format!("@./{file}@") }
}

/// Writes the reader of a texture, with further lines.
fn texture(out: &mut dyn Write, name: &str, file: &str, space: &str, lines: &[&str]) -> io::Result<()> {
    let (file, space) =
        (format!("asset inputs:file = {}", asset(file)), format!("token inputs:sourceColorSpace = \"{space}\""));
    let common = [
        &file,
        &space,
        "float2 inputs:st.connect = </Scene/Surface/Coordinates.outputs:result>",
        "token inputs:wrapS = \"clamp\"",
        "token inputs:wrapT = \"clamp\"",
    ];
    shader(out, name, "UsdUVTexture", &[&common, lines].concat())
}

/// Writes a shader with the lines of its inputs and outputs.
fn shader(out: &mut dyn Write, name: &str, id: &str, lines: &[impl Display]) -> io::Result<()> {
    write!(out, "        def Shader \"{name}\"\n        {{\n            uniform token info:id = \"{id}\"\n")?;
    lines.iter().try_for_each(|line| writeln!(out, "            {line}"))?;
    writeln!(out, "        }}")
}

/// Writes an attribute with an array of numbers or tuples, and its metadata, if there is any.
fn array<const N: usize>(
    out: &mut dyn Write,
    attribute: &str,
    numbers: impl Iterator<Item = [impl Display; N]>,
    metadata: &str,
) -> io::Result<()> {
    write!(out, "        {attribute} = [")?;
    for (index, numbers) in numbers.enumerate() {
        let text = if N == 1 { numbers[0].to_string() } else { tuple(numbers.iter()) };
        write!(out, "{}{text}", if index > 0 { ", " } else { "" })?;
    }
    match metadata {
        "" => writeln!(out, "]"),
        metadata => write!(out, "] (\n            {metadata}\n        )\n"),
    }
}

fn tuple(numbers: impl Iterator<Item = impl Display>) -> String {
    let numbers: Vec<String> = numbers.map(|number| number.to_string()).collect();
    format!("({})", numbers.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_with_delimiters_have_longer_ones() {
        let paths = ["a b.light.exr", "a@2x.light.exr", "a@@@.exr"].map(asset);
        assert_eq!(paths, ["@./a b.light.exr@", "@@@./a@2x.light.exr@@@", r"@@@./a\@@@.exr@@@"]);
    }

    #[test]
    fn the_light_follows_openexr() {
        let close = |a: [f64; 3], b: [f64; 3]| DVec3::from(a).distance(DVec3::from(b)) < 1e-12;
        for (uv, direction) in
            [([0.5, 0.5], [0.0, 0.0, 1.0]), ([0.25, 0.5], [1.0, 0.0, 0.0]), ([0.3, 0.0], [0.0, 1.0, 0.0])]
        {
            assert!(close(dome_orientation().direction(uv), direction), "{uv:?}");
        }
    }

    #[test]
    fn files_of_an_archive_are_aligned_and_not_compressed() {
        let files = [("scene.usda", vec![b'a'; 1000]), ("light.exr", vec![b'b'; 77])];
        let bytes = archive(files.iter().map(|(name, bytes)| (*name, &bytes[..]))).unwrap();
        for (_, contents) in files {
            let start = bytes.windows(contents.len()).position(|window| window == contents);
            assert_eq!(start.map(|start| start % usize::from(ALIGNMENT)), Some(0));
        }
    }
}
