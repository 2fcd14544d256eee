//! Gaussians as OpenUSD stages, `.usda` (text) and `.usdz` (an archive with the texture of the
//! light): the schema `ParticleField3DGaussianSplat` of OpenUSD 26.03.
//!
//! | prim | contents |
//! |---|---|
//! | `/Scene` | `Xform`, the default prim, with the placement of the scene |
//! | `/Scene/Gaussians` | positions, orientations (w, x, y, z), scales, opacities, harmonics |
//! | `/Scene/Light` | `DomeLight` with a lat-long OpenEXR texture of linear radiance |
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
    fs,
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

/// Writes a stage: `.usdz` with its texture, or any other extension as text, with the texture
/// beside it as `NAME.light.exr`.
///
/// # Errors
///
/// [`Error::Write`] if a file cannot be written; [`Error::TooLong`] for an archive above 4 GiB.
pub fn write(path: &Path, stage: &Stage<'_>) -> Result<()> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let texture = format!("{name}.light.exr");
    if ending(path).as_deref() != Some("usdz") {
        if let Some(light) = stage.light {
            latlong::write(&path.with_file_name(&texture), light)?;
        }
        return whole_file::write(path, |out| write_text(out, stage, &texture));
    }
    let write_error = |cause: io::Error| Error::Write { path: path.to_owned(), cause };
    let mut text = Vec::new();
    write_text(&mut text, stage, "light.exr").map_err(write_error)?;
    let mut files = vec![("scene.usda", text)];
    if let Some(light) = stage.light {
        let folder = tempfile::tempdir().map_err(write_error)?;
        let file = folder.path().join("light.exr");
        latlong::write(&file, light)?;
        files.push(("light.exr", fs::read(&file).map_err(write_error)?));
    }
    let len = files.iter().map(|(_, bytes)| bytes.len()).sum();
    if len > u32::MAX as usize {
        return Err(Error::TooLong { path: path.to_owned(), len });
    }
    let bytes = archive(&files).map_err(|cause| write_error(io::Error::other(cause)))?;
    whole_file::write_bytes(path, &bytes)
}

/// Archive without compression, whose files are aligned.
fn archive(files: &[(&str, Vec<u8>)]) -> zip::result::ZipResult<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored).with_alignment(ALIGNMENT);
    for (name, bytes) in files {
        zip.start_file(*name, options)?;
        zip.write_all(bytes)?;
    }
    Ok(zip.finish()?.into_inner())
}

fn write_text(out: &mut impl Write, stage: &Stage<'_>, texture: &str) -> io::Result<()> {
    let up = if stage.up == UpAxis::Y { "Y" } else { "Z" };
    let documentation: String =
        stage.documentation.chars().filter(|c| !c.is_control() && !matches!(c, '"' | '\\')).collect();
    write!(out, "#usda 1.0\n(\n    defaultPrim = \"Scene\"\n    doc = \"{documentation}\"\n")?;
    write!(out, "    metersPerUnit = 1\n    upAxis = \"{up}\"\n)\n\n")?;
    write!(out, "def Xform \"Scene\" (\n    kind = \"component\"\n)\n{{\n")?;
    if let Some(Placement { rotation: [x, y, z, w], translation, scale }) = stage.placement {
        writeln!(out, "    double3 xformOp:translate = {}", tuple(translation.iter()))?;
        writeln!(out, "    quatd xformOp:orient = {}", tuple([w, x, y, z].into_iter()))?;
        writeln!(out, "    double3 xformOp:scale = {}", tuple([scale; 3].into_iter()))?;
        out.write_all(b"    uniform token[] xformOpOrder = ")?;
        out.write_all(b"[\"xformOp:translate\", \"xformOp:orient\", \"xformOp:scale\"]\n")?;
    }
    write_gaussians(out, stage)?;
    if stage.light.is_some() {
        write!(out, "\n    def DomeLight \"Light\"\n    {{\n")?;
        write!(
            out,
            "        asset inputs:texture:file = @./{texture}@ (\n            colorSpace = \"{LINEAR}\"\n        )\n"
        )?;
        write!(out, "        token inputs:texture:format = \"latlong\"\n    }}\n")?;
    }
    writeln!(out, "}}")
}

fn write_gaussians(out: &mut impl Write, stage: &Stage<'_>) -> io::Result<()> {
    let Stage { gaussians, normals, materials, .. } = *stage;
    let all = || 0..gaussians.count;
    let layout = gaussians.layout;
    let scales = |gaussian: usize| gaussians.get::<3>(gaussian, LOG_SCALE).map(f32::exp);
    writeln!(out, "    def ParticleField3DGaussianSplat \"Gaussians\" (")?;
    write!(out, "        prepend apiSchemas = [\"ColorSpaceAPI\"]\n    )\n    {{\n")?;
    writeln!(out, "        uniform token colorSpace:name = \"{SRGB}\"")?;
    let mut extent = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for gaussian in all() {
        let size = scales(gaussian).into_iter().fold(0.0, f32::max);
        for (k, x) in gaussians.get::<3>(gaussian, MEAN).into_iter().enumerate() {
            extent[0][k] = extent[0][k].min(x - DEVIATIONS * size);
            extent[1][k] = extent[1][k].max(x + DEVIATIONS * size);
        }
    }
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

/// Writes an attribute with an array of numbers or tuples, and its metadata, if there is any.
fn array<const N: usize>(
    out: &mut impl Write,
    attribute: &str,
    numbers: impl Iterator<Item = [f32; N]>,
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
        let bytes = archive(&files).unwrap();
        for (_, contents) in files {
            let start = bytes.windows(contents.len()).position(|window| window == contents);
            assert_eq!(start.map(|start| start % usize::from(ALIGNMENT)), Some(0));
        }
    }
}
