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
//!
//! The layout follows from the columns; other columns are ignored and noted.

use crate::{
    affine::SCALE_MIN,
    error::{Error, Result},
    kinds,
    table::{Columns, Table},
    whole_file,
};
use specula_core::{
    activation::logit,
    scene::{
        ALBEDO, AMBIENT, Appearance, DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, NORMAL_RESIDUAL_1,
        NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, TINT,
    },
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
}

/// Reads Gaussians in the layout of the columns. Infinite opacities and scales of minus infinity,
/// which converters write for opacities of 0 and 1 and scales of 0, become finite.
///
/// # Errors
///
/// An error of [`Error`] for files that cannot be read or parsed, exceed their memory budget, hold
/// no Gaussians, or numbers that are not finite.
pub fn read(path: &Path) -> Result<GaussianFile> {
    let mut table = Table::open(path)?;
    let comments = core::mem::take(&mut table.comments);
    if !["f_dc_0", "opacity", "scale_0", "rot_0"].iter().any(|name| table.has(name)) && table.has("x") {
        return Err(kinds::points_or_mesh(path, table.has_faces));
    }
    let layout = layout_of(path, &table)?;
    let count = table.count();
    let mut names = names_by_plane(layout);
    let mut notes = Vec::from_iter(note_left_out(path, &table, layout));
    let is_flat = table.has("scale_1") && !table.has("scale_2");
    if is_flat {
        // Plane of the same length; its numbers are replaced.
        names[LOG_SCALE + 2] = "scale_1".to_owned();
        notes.push(format!("{path:?} has two scales, as in 2D Gaussian splatting; its Gaussians are rendered flat"));
    }
    let mut columns = table.read_any(&names, name_of(layout))?;
    notes.extend(note_infinities(path, replace_infinities(&mut columns, count, is_flat)));
    columns.refuse_non_finite(path)?;
    notes.extend(note_no_rotations(path, (0..count).filter(|row| columns.get(*row, QUAT) == [0.0; 4]).count()));
    notes.extend(note_lengths(path, &columns, count));
    Ok(GaussianFile { gaussians: Gaussians { count, layout, values: columns.values }, comments, notes })
}

/// Note on columns that are not part of the layout.
fn note_left_out(path: &Path, table: &Table, layout: Layout) -> Option<String> {
    let known = columns(layout);
    let left_out: Vec<&str> = table.names().filter(|name| known.iter().all(|column| column.name != *name)).collect();
    let names = left_out.iter().take(NAMES_MAX).copied().collect::<Vec<_>>().join(", ");
    let more = match left_out.len().saturating_sub(NAMES_MAX) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let layout = name_of(layout);
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
fn thin(log_scales: [f32; 3]) -> [f32; 3] {
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
        write_rows(out, gaussians, normals, &columns)
    })
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
    normals: Option<&[[f32; 3]]>,
    columns: &[Column],
) -> io::Result<()> {
    let mut row = Vec::with_capacity(4 * columns.len());
    for gaussian in 0..gaussians.count {
        row.clear();
        for column in columns {
            let number = match column.holds {
                Holds::Plane(plane) => gaussians.values[gaussians.index_of(gaussian, plane)],
                Holds::Normal(k) => normals.map_or(0.0, |normals| normals[gaussian][k]),
            };
            row.extend(number.to_le_bytes());
        }
        out.write_all(&row)?;
    }
    Ok(())
}
