//! Gaussians as PLY files: the layout of 3D Gaussian splatting, and GaussianShader's with shading.
//!
//! Columns are found by name, in any order, type and encoding; they are written as little-endian
//! `f32` in INRIA's order. Values are raw, before activation.
//!
//! * 3D Gaussian splatting: x y z, nx ny nz (0, or normals), f_dc, f_rest (colour by colour,
//!   without f_dc), opacity, scale, rot
//! * GaussianShader: x y z, nx ny nz (Δn₁), nx2 ny2 nz2 (Δn₂), f_dc (diffuse), f_rest (coefficient
//!   by coefficient, with the first), opacity, scale, rot, roughness, specular
//! * physical materials: GaussianShader's, then albedo, metallic, ambient (linear)
//! * Mip-Splatting: any, then filter_3D, the deviation of each Gaussian's filter in space
//! * 2D Gaussian splatting: the first, without scale_2
//! * relightable, as mesh2splat and PBR-GS of other programs: x y z, nx ny nz (unit normals),
//!   f_dc = (γ(a) − ½) / Y₀ of the linear base colour a with the sRGB curve γ and Y₀ = 0.2821,
//!   metallicFactor and roughnessFactor or pm and pr (both in \[0, 1\]; perceptual roughness),
//!   opacity, scale, rot; read as a physical material
//!
//! * compressed: PlayCanvas's layout of integers in chunks, read only
//!
//! The layout follows from the columns; other columns are ignored and noted.

use crate::{
    affine::SCALE_MIN,
    compressed_ply,
    error::{Error, Result},
    kinds,
    splat::unit,
    table::{Columns, Table},
    whole_file,
};
use specula_core::{
    activation::logit,
    color::linear_from_srgb,
    covariance::rotation,
    normal::{AxisRule, axis},
    scene::{
        ALBEDO, AMBIENT, Appearance, DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, NORMAL_RESIDUAL_1,
        NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, TINT, len_of_values,
    },
    sh::Y0,
    shade::ShadingRules,
    vector::vec3,
};
use std::{
    io::{self, Write},
    path::Path,
};

/// Property of Mip-Splatting's files.
const FILTER: &str = "filter_3D";
/// Property of physical materials.
const METALNESS_NAME: &str = "metallic";
/// Properties that only GaussianShader's layout has.
const OF_SHADED: [&str; 6] = ["nx2", "ny2", "nz2", "specular0", "specular1", "specular2"];
/// Properties of metalness and roughness in relightable files; the first two pairs are written.
const SURFACE_NAMES: [[&str; 2]; 3] = [["metallicFactor", "roughnessFactor"], ["pm", "pr"], ["metallic", "roughness"]];
/// Properties of normals.
const NORMAL_NAMES: [&str; 3] = ["nx", "ny", "nz"];
/// Properties of the normals on the other side, in relightable files of ours.
const BACK_NAMES: [&str; 3] = ["nx_back", "ny_back", "nz_back"];
/// First column of normals, then of metalness and roughness, then of normals on the other side,
/// when a relightable file is read: after the planes of plain Gaussians of degree 0.
const NORMAL: usize = Layout::radiance(0).plane_count();
const SURFACE: usize = NORMAL + 3;
const BACK: usize = SURFACE + 2;
/// Cosine between a normal and the shortest axis above which the Gaussian is a thin sheet, and its
/// normal always faces the viewer.
const SHEET_COSINE: f32 = 0.99;
const RADIANCE_LAYOUT: &str = "the layout of 3D Gaussian splatting";
const SHADED_LAYOUT: &str = "GaussianShader's layout";
/// Thickness of a flat Gaussian, relative to its smaller axis.
const FLAT: f32 = 1e-3;
/// Number of Gaussians that cannot all be alike by chance.
const MANY: usize = 20;
/// Maximum number of names in a note.
const NAMES_MAX: usize = 8;

/// Gaussians of a PLY file, in the file's conventions.
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianFile {
    /// The Gaussians.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Comment lines of the header.
    pub comments: Vec<String>,
    /// Notes on parts of the file that are ignored or changed, one sentence each.
    pub notes: Vec<String>,
    /// Whether the file is relightable, so that its shading model is known.
    pub are_materials: bool,
}

/// Physical material of a Gaussian for other programs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceMaterial {
    /// Unit normal on the side that the shortest axis of the Gaussian points to.
    pub normal: [f32; 3],
    /// Unit normal on the other side.
    pub back: [f32; 3],
    /// Linear base colour, 0 to 1.
    pub albedo: [f32; 3],
    /// Metalness, 0 to 1.
    pub metalness: f32,
    /// Perceptual roughness, 0 to 1.
    pub roughness: f32,
}

/// A column of a file: its name and its source.
struct Column {
    name: String,
    holds: Holds,
}

/// Source of a column's numbers.
#[derive(Clone, Copy)]
enum Holds {
    /// A plane of the Gaussians.
    Plane(usize),
    /// Component of the normals of plain Gaussians, zero without normals.
    Normal(usize),
    /// Metalness (0) or roughness (1) of a relightable file.
    Surface(usize),
    /// Component of the normals on the other side.
    Back(usize),
}

/// Reads Gaussians in the layout of the columns. Infinite opacities and scales of minus infinity,
/// which converters write for opacities of 0 and 1 and scales of 0, become finite.
///
/// # Errors
///
/// An error of [`Error`] for files that cannot be read or parsed, exceed their memory budget, hold
/// no Gaussians, or numbers that are not finite.
pub fn read(path: &Path) -> Result<GaussianFile> {
    if let Some(file) = compressed_ply::read(path)? {
        return Ok(file);
    }
    let Contents { mut columns, layout, surface, has_backs, is_flat, comments, mut notes } = contents(path)?;
    let count = columns.count();
    notes.extend(note_infinities(path, replace_infinities(&mut columns, count, is_flat)));
    columns.refuse_non_finite(path)?;
    notes.extend(note_no_rotations(path, (0..count).filter(|row| columns.get(*row, QUAT) == [0.0; 4]).count()));
    notes.extend(note_lengths(path, &columns, count));
    if surface.is_some() {
        let gaussians = with_materials(&columns, count, has_backs);
        return Ok(GaussianFile { gaussians, comments, notes, are_materials: true });
    }
    let gaussians = Gaussians { count, layout, values: columns.values };
    Ok(GaussianFile { gaussians, comments, notes, are_materials: false })
}

/// Columns of a file as they are, and their meaning.
struct Contents {
    columns: Columns,
    layout: Layout,
    /// Properties of metalness and roughness of a relightable file.
    surface: Option<[&'static str; 2]>,
    /// Whether a relightable file has normals on the other side.
    has_backs: bool,
    /// Whether scales have two axes.
    is_flat: bool,
    comments: Vec<String>,
    notes: Vec<String>,
}

fn contents(path: &Path) -> Result<Contents> {
    let mut table = Table::open(path)?;
    let comments = core::mem::take(&mut table.comments);
    if !["f_dc_0", "opacity", "scale_0", "rot_0"].iter().any(|name| table.has(name)) && table.has("x") {
        return Err(kinds::points_or_mesh(path, table.has_faces));
    }
    let surface = surface_names(&table);
    let layout = if surface.is_some() { Layout::radiance(0) } else { layout_of(path, &table)? };
    let mut names = names_by_plane(layout);
    let mut notes = Vec::from_iter(note_left_out(path, &table, layout, surface.is_some()));
    let has_backs = surface.is_some() && BACK_NAMES.iter().all(|name| table.has(name));
    if let Some(surface) = surface {
        let backs = BACK_NAMES.into_iter().filter(|_| has_backs);
        names.extend(NORMAL_NAMES.into_iter().chain(surface).chain(backs).map(str::to_owned));
    }
    let is_flat = table.has("scale_1") && !table.has("scale_2");
    if is_flat {
        // Plane of the same length; its numbers are replaced.
        names[LOG_SCALE + 2] = "scale_1".to_owned();
        notes.push(format!("{path:?} has two scales, as in 2D Gaussian splatting; its Gaussians are rendered flat"));
    }
    let columns = table.read_any(&names, name_of(layout))?;
    Ok(Contents { columns, layout, surface, has_backs, is_flat, comments, notes })
}

/// Numbers of a file as they are, for [`crate::lint`].
pub(crate) struct Numbers {
    /// Gaussians, some of whose numbers may not be finite.
    pub(crate) gaussians: Gaussians<Vec<f32>>,
    /// Whether the file is compressed.
    pub(crate) is_compressed: bool,
    /// Whether the file is relightable.
    pub(crate) is_relightable: bool,
    /// Whether any normal is not zero.
    pub(crate) has_normals: bool,
}

/// Reads a file without replacing or refusing numbers.
pub(crate) fn numbers(path: &Path) -> Result<Numbers> {
    if let Some(GaussianFile { gaussians, .. }) = compressed_ply::read(path)? {
        return Ok(Numbers { gaussians, is_compressed: true, is_relightable: false, has_normals: false });
    }
    let Contents { columns, layout, surface, has_backs, .. } = contents(path)?;
    let (count, is_relightable) = (columns.count(), surface.is_some());
    let table = Table::open(path)?;
    let names = NORMAL_NAMES.map(str::to_owned);
    let has_normals = names.iter().all(|name| table.has(name))
        && table.read_any::<f32>(&names, name_of(layout))?.values.iter().any(|number| *number != 0.0);
    let gaussians = match is_relightable {
        true => with_materials(&columns, count, has_backs),
        false => Gaussians { count, layout, values: columns.values },
    };
    Ok(Numbers { gaussians, is_compressed: false, is_relightable, has_normals })
}

/// Properties of metalness and roughness, if a file is relightable.
fn surface_names(table: &Table) -> Option<[&'static str; 2]> {
    let has_normals = NORMAL_NAMES.iter().all(|name| table.has(name));
    let is_shaded = OF_SHADED.iter().any(|name| table.has(name));
    let found = SURFACE_NAMES.into_iter().find(|names| names.iter().all(|name| table.has(name)));
    found.filter(|_| has_normals && !is_shaded)
}

/// Physical materials from the columns of a relightable file, in the convention of files. Their
/// view-dependent colour, for pictures without a light, is the base colour.
fn with_materials(columns: &Columns, count: usize, has_backs: bool) -> Gaussians<Vec<f32>> {
    let (layout, plain) = (Layout::shaded(None).physical(), Layout::radiance(0));
    let first = layout.sh_end();
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for row in 0..count {
        // Means, log scales, quats and opacities have the same planes in every layout.
        gaussians.set(row, MEAN, columns.get::<DIFFUSE>(row, MEAN));
        let encoded = columns.get::<3>(row, plain.sh_start()).map(|number| 0.5 + Y0 * number);
        let albedo = encoded.map(|channel| logit(linear_from_srgb(channel.clamp(0.0, 1.0))));
        let [metalness, roughness] = columns.get(row, SURFACE).map(logit);
        gaussians.set(row, DIFFUSE, albedo.map(|logit| logit + ShadingRules::OFFICIAL.diffuse_shift()));
        gaussians.set(row, TINT, [logit(0.0); 3]);
        gaussians.set(row, ROUGHNESS, [roughness]);
        let back = has_backs.then(|| columns.get(row, BACK));
        let [first_residual, second_residual] = residuals(&gaussians, row, columns.get(row, NORMAL), back);
        gaussians.set(row, NORMAL_RESIDUAL_1, first_residual);
        gaussians.set(row, NORMAL_RESIDUAL_2, second_residual);
        gaussians.set(row, first + ALBEDO, albedo);
        gaussians.set(row, first + METALNESS, [metalness]);
        gaussians.set(row, first + AMBIENT, [1.0; 3]);
    }
    gaussians
}

/// Residuals, in the convention of files, with which a Gaussian has this normal, and `back` seen
/// from the side that its shortest axis points away from. Without `back`, a normal along the axis
/// is that of a thin sheet, which faces the viewer on either side; any other normal stays. Without
/// a normal the residuals are zero, which leaves the axis.
fn residuals(gaussians: &Gaussians<Vec<f32>>, row: usize, normal: [f32; 3], back: Option<[f32; 3]>) -> [[f32; 3]; 2] {
    let [x, y, z] = gaussians.get(row, LOG_SCALE);
    let axis = axis(AxisRule::Shortest, &rotation(gaussians.get(row, QUAT)), vec3(x, y, z)).to_array();
    if normal == [0.0; 3] {
        return [[0.0; 3]; 2];
    }
    let along: f32 = axis.iter().zip(normal).map(|(a, n)| a * n).sum();
    let [front, back] = match back {
        Some(back) => [normal, back],
        None if along > SHEET_COSINE => [normal, normal.map(|x| -x)],
        None if along < -SHEET_COSINE => [normal.map(|x| -x), normal],
        None => [normal; 2],
    };
    [core::array::from_fn(|k| front[k] - axis[k]), core::array::from_fn(|k| back[k] + axis[k])]
}

/// Note on columns that are not part of the layout.
fn note_left_out(path: &Path, table: &Table, layout: Layout, is_relightable: bool) -> Option<String> {
    let known = if is_relightable { relightable_columns() } else { columns(layout) };
    let is_read = |name: &str| {
        known.iter().any(|column| column.name == name)
            || (is_relightable && SURFACE_NAMES.as_flattened().contains(&name))
    };
    let left_out: Vec<&str> = table.names().filter(|name| !is_read(name)).collect();
    let names = left_out.iter().take(NAMES_MAX).copied().collect::<Vec<_>>().join(", ");
    let more = match left_out.len().saturating_sub(NAMES_MAX) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let layout = if is_relightable { "the relightable layout" } else { name_of(layout) };
    (!left_out.is_empty()).then(|| format!("{path:?} is read in {layout}; its columns {names}{more} are ignored"))
}

/// Replaces infinite numbers that have a meaning. Returns the numbers of such opacities and scales.
fn replace_infinities(columns: &mut Columns, count: usize, is_flat: bool) -> [usize; 2] {
    let mut replaced = [0; 2];
    for row in 0..count {
        let [opacity]: [f32; 1] = columns.get(row, OPACITY);
        if opacity.is_infinite() {
            columns.set(row, OPACITY, [logit(if opacity > 0.0 { 1.0 } else { 0.0 })]);
            replaced[0] += 1;
        }
        let mut log_scales: [f32; 3] = columns.get(row, LOG_SCALE);
        if is_flat {
            log_scales[2] = f32::NEG_INFINITY;
        }
        if log_scales.contains(&f32::NEG_INFINITY) {
            columns.set(row, LOG_SCALE, thin(log_scales));
            replaced[1] += usize::from(!is_flat);
        }
    }
    replaced
}

/// Finite logarithms of scales, some of which may be zero.
pub(crate) fn thin(log_scales: [f32; 3]) -> [f32; 3] {
    let finite = log_scales.into_iter().filter(|log_scale| *log_scale != f32::NEG_INFINITY);
    let smallest = finite.fold(f32::INFINITY, f32::min);
    let thin = if smallest == f32::INFINITY { (SCALE_MIN as f32).ln() } else { smallest + FLAT.ln() };
    log_scales.map(|log_scale| if log_scale == f32::NEG_INFINITY { thin } else { log_scale })
}

fn note_infinities(path: &Path, [opacities, scales]: [usize; 2]) -> Option<String> {
    (opacities + scales > 0).then(|| {
        format!(
            "{path:?} has {opacities} infinite opacities, read as 0 or 1, and {scales} Gaussians with scales of 0, \
             rendered flat"
        )
    })
}

/// Note on quaternions of length 0.
pub(crate) fn note_no_rotations(path: &Path, count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!(
            "{path:?} has {count} Gaussians with the rotation 0 0 0 0, probably unused rows; they are rendered \
             unrotated"
        )
    })
}

/// Note on scales and opacities that look activated: scales above 0 and opacities from 0 to 1.
fn note_lengths(path: &Path, columns: &Columns, count: usize) -> Option<String> {
    let are_lengths = |row: usize| columns.get::<3>(row, LOG_SCALE).iter().all(|scale| *scale > 0.0);
    let is_share = |row: usize| (0.0..=1.0).contains(&columns.get::<1>(row, OPACITY)[0]);
    (count >= MANY && (0..count).all(|row| are_lengths(row) && is_share(row))).then(|| {
        format!(
            "{path:?} has only scales above 0 and opacities from 0 to 1, which are read as logarithms and logits; if \
             they are activated, write logarithms and logits instead"
        )
    })
}

/// Writes Gaussians in the layout of their appearance. Comments must be single lines.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write(path: &Path, gaussians: &Gaussians<Vec<f32>>, comments: &[String]) -> Result<()> {
    write_with_normals(path, gaussians, None, comments)
}

/// Writes Gaussians, with normals if the layout has columns for them.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write_with_normals(
    path: &Path,
    gaussians: &Gaussians<Vec<f32>>,
    normals: Option<&[[f32; 3]]>,
    comments: &[String],
) -> Result<()> {
    assert!(normals.is_none_or(|normals| normals.len() == gaussians.count), "each Gaussian has a normal");
    let columns = columns(gaussians.layout);
    whole_file::write(path, |out| {
        write_header(out, gaussians.count, &columns, comments)?;
        write_rows(out, gaussians, &columns, |gaussian, holds| match (holds, normals) {
            (Holds::Normal(k), Some(normals)) => normals[gaussian][k],
            _ => 0.0,
        })
    })
}

/// Writes a relightable file: plain Gaussians of degree 0, whose colours are sRGB-encoded albedos,
/// and their materials. Quats are normalised. It has no comments, which some loaders reject.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn write_relightable(path: &Path, gaussians: &Gaussians<Vec<f32>>, materials: &[SurfaceMaterial]) -> Result<()> {
    assert_eq!(gaussians.layout, Layout::radiance(0), "base colours do not depend on the view");
    assert_eq!(materials.len(), gaussians.count, "each Gaussian has a material");
    let mut gaussians = gaussians.clone();
    (0..gaussians.count).for_each(|index| gaussians.set(index, QUAT, unit(gaussians.get(index, QUAT))));
    let columns = relightable_columns();
    whole_file::write(path, |out| {
        write_header(out, gaussians.count, &columns, &[])?;
        write_rows(out, &gaussians, &columns, |gaussian, holds| match (holds, &materials[gaussian]) {
            (Holds::Normal(k), material) => material.normal[k],
            (Holds::Surface(0), material) => material.metalness,
            (Holds::Back(k), material) => material.back[k],
            (_, material) => material.roughness,
        })
    })
}

/// Columns of a relightable file, in mesh2splat's order, then those of PBR-GS, then ours.
fn relightable_columns() -> Vec<Column> {
    let mut columns = radiance_columns(Layout::radiance(0));
    let shape = columns.iter().position(|column| column.name == "opacity").expect("opacity is written");
    let [first, second, _] =
        SURFACE_NAMES.map(|names| [0, 1].map(|k| Column { name: names[k].to_owned(), holds: Holds::Surface(k) }));
    columns.splice(shape..shape, first);
    columns.extend(second);
    columns.extend((0..3).map(|k| Column { name: BACK_NAMES[k].to_owned(), holds: Holds::Back(k) }));
    columns
}

fn layout_of(path: &Path, table: &Table) -> Result<Layout> {
    let count = table.names().filter(|name| name.starts_with("f_rest_")).count();
    let appearance = if is_shaded(table, count) { Appearance::Shaded } else { Appearance::Radiance };
    let (sh_degree, allowed) = match appearance {
        Appearance::Radiance => (degree_of(count + 3).map(Some), "0, 9, 24 or 45"),
        Appearance::Shaded if count == 0 => (Some(None), ""),
        Appearance::Shaded => (degree_of(count).map(Some), "0, 3, 12, 27 or 48"),
    };
    let layout = Layout { appearance, sh_degree: sh_degree.flatten(), ..Layout::radiance(0) };
    let is_physical = layout.is_shaded() && names_by_plane(layout.physical()).iter().all(|name| table.has(name));
    let layout = if is_physical { layout.physical() } else { layout };
    let layout = if table.has(FILTER) { layout.antialiased() } else { layout };
    match sh_degree {
        Some(_) => Ok(layout),
        None => Err(Error::HarmonicsCount { path: path.to_owned(), count, layout: name_of(layout), allowed }),
    }
}

/// True if a file has GaussianShader's layout, or a part of it without harmonics to render.
fn is_shaded(table: &Table, rest_count: usize) -> bool {
    let shaded_columns = OF_SHADED.iter().filter(|name| table.has(name)).count();
    let has_harmonics = rest_count > 0 && degree_of(rest_count + 3).is_some();
    (shaded_columns == OF_SHADED.len() && table.has("roughness")) || (shaded_columns > 0 && !has_harmonics)
}

/// Degree of spherical harmonics with `numbers` coefficients in three colours.
fn degree_of(numbers: usize) -> Option<u8> {
    (0..=3).find(|degree| 3 * Layout::radiance(*degree).sh_count() == numbers)
}

fn name_of(layout: Layout) -> &'static str {
    if layout.is_shaded() { SHADED_LAYOUT } else { RADIANCE_LAYOUT }
}

fn names_by_plane(layout: Layout) -> Vec<String> {
    let mut names = vec![String::new(); layout.plane_count()];
    for column in columns(layout) {
        if let Holds::Plane(plane) = column.holds {
            names[plane] = column.name;
        }
    }
    names
}

/// Columns of a layout in the order of the file.
fn columns(layout: Layout) -> Vec<Column> {
    let mut columns = if layout.is_shaded() { shaded_columns(layout) } else { radiance_columns(layout) };
    if let Some(first) = layout.physical_planes() {
        number_planes(&mut columns, "albedo_", 0..3, |c| first + ALBEDO + c);
        name_planes(&mut columns, [METALNESS_NAME], first + METALNESS);
        number_planes(&mut columns, "ambient_", 0..3, |c| first + AMBIENT + c);
    }
    if let Some(plane) = layout.filter_plane() {
        name_planes(&mut columns, [FILTER], plane);
    }
    columns
}

fn radiance_columns(layout: Layout) -> Vec<Column> {
    let mut columns = Vec::new();
    name_planes(&mut columns, ["x", "y", "z"], MEAN);
    columns
        .extend((0..).zip(["nx", "ny", "nz"]).map(|(k, name)| Column { name: name.into(), holds: Holds::Normal(k) }));
    number_planes(&mut columns, "f_dc_", 0..3, |c| layout.sh_start() + c);
    let rest = layout.sh_count() - 1;
    number_planes(&mut columns, "f_rest_", 0..3 * rest, |i| layout.sh_start() + 3 * (i % rest + 1) + i / rest);
    push_shape(&mut columns);
    columns
}

fn shaded_columns(layout: Layout) -> Vec<Column> {
    let mut columns = Vec::new();
    name_planes(&mut columns, ["x", "y", "z"], MEAN);
    name_planes(&mut columns, ["nx", "ny", "nz"], NORMAL_RESIDUAL_1);
    name_planes(&mut columns, ["nx2", "ny2", "nz2"], NORMAL_RESIDUAL_2);
    number_planes(&mut columns, "f_dc_", 0..3, |c| DIFFUSE + c);
    number_planes(&mut columns, "f_rest_", 0..3 * layout.sh_count(), |i| layout.sh_start() + i);
    push_shape(&mut columns);
    name_planes(&mut columns, ["roughness"], ROUGHNESS);
    number_planes(&mut columns, "specular", 0..3, |c| TINT + c);
    columns
}

fn push_shape(columns: &mut Vec<Column>) {
    name_planes(columns, ["opacity"], OPACITY);
    number_planes(columns, "scale_", 0..3, |axis| LOG_SCALE + axis);
    number_planes(columns, "rot_", 0..4, |k| QUAT + k);
}

fn name_planes<const N: usize>(columns: &mut Vec<Column>, names: [&str; N], first: usize) {
    columns.extend((first..).zip(names).map(|(plane, name)| Column { name: name.into(), holds: Holds::Plane(plane) }));
}

fn number_planes(
    columns: &mut Vec<Column>,
    prefix: &str,
    numbers: core::ops::Range<usize>,
    plane: impl Fn(usize) -> usize,
) {
    columns.extend(numbers.map(|i| Column { name: format!("{prefix}{i}"), holds: Holds::Plane(plane(i)) }));
}

fn write_header(out: &mut impl Write, count: usize, columns: &[Column], comments: &[String]) -> io::Result<()> {
    write!(out, "ply\nformat binary_little_endian 1.0\n")?;
    for comment in comments {
        writeln!(out, "comment {}", comment.replace(['\r', '\n'], " "))?;
    }
    writeln!(out, "element vertex {count}")?;
    for column in columns {
        writeln!(out, "property float {}", column.name)?;
    }
    writeln!(out, "end_header")
}

fn write_rows(
    out: &mut impl Write,
    gaussians: &Gaussians<Vec<f32>>,
    columns: &[Column],
    other: impl Fn(usize, Holds) -> f32,
) -> io::Result<()> {
    let mut row = Vec::with_capacity(4 * columns.len());
    for gaussian in 0..gaussians.count {
        row.clear();
        for column in columns {
            let number = match column.holds {
                Holds::Plane(plane) => gaussians.values[gaussians.index_of(gaussian, plane)],
                holds => other(gaussian, holds),
            };
            row.extend(number.to_le_bytes());
        }
        out.write_all(&row)?;
    }
    Ok(())
}
