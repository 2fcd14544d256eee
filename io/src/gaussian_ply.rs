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

use crate::{
    error::{Error, Result},
    table::Table,
    whole_file,
};
use specula_core::scene::{
    ALBEDO, AMBIENT, Appearance, DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, NORMAL_RESIDUAL_1,
    NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, TINT,
};
use std::{
    io::{self, Write},
    path::Path,
};

/// Property of Mip-Splatting's files.
const FILTER: &str = "filter_3D";
/// Property of physical materials.
const METALNESS_NAME: &str = "metallic";
const RADIANCE_LAYOUT: &str = "the layout of 3D Gaussian splatting";
const SHADED_LAYOUT: &str = "GaussianShader's layout (it has \"roughness\")";

/// Gaussians of a PLY file, in the file's conventions.
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianFile {
    /// The Gaussians.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Comment lines of the header.
    pub comments: Vec<String>,
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
    /// Component of the normals beside plain Gaussians, zero without normals.
    Normal(usize),
}

/// Reads Gaussians of either layout; the property `roughness` identifies GaussianShader's, and
/// `filter_3D` both filters of Mip-Splatting.
///
/// # Errors
///
/// An error of [`Error`] for files that cannot be read or parsed, exceed their memory budget, or
/// hold numbers that are not finite.
pub fn read(path: &Path) -> Result<GaussianFile> {
    let mut table = Table::open(path)?;
    let comments = core::mem::take(&mut table.comments);
    let layout = layout_of(path, &table)?;
    let count = table.count();

    let values = table.read(&names_by_plane(layout), name_of(layout))?.values;
    Ok(GaussianFile { gaussians: Gaussians { count, layout, values }, comments })
}

/// Writes Gaussians in the layout of their appearance. Comments must be single lines.
///
/// # Errors
///
/// [`Error::Write`], where the file cannot be written.
pub fn write(path: &Path, gaussians: &Gaussians<Vec<f32>>, comments: &[String]) -> Result<()> {
    write_with_normals(path, gaussians, None, comments)
}

/// Writes Gaussians, with normals where the layout has columns for them.
///
/// # Errors
///
/// [`Error::Write`], where the file cannot be written.
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
    let appearance = if table.has("roughness") { Appearance::Shaded } else { Appearance::Radiance };
    let count = table.names().filter(|name| name.starts_with("f_rest_")).count();
    let (sh_degree, allowed) = match appearance {
        Appearance::Radiance => (degree_of(count + 3).map(Some), "0, 9, 24 or 45"),
        Appearance::Shaded if count == 0 => (Some(None), ""),
        Appearance::Shaded => (degree_of(count).map(Some), "0, 3, 12, 27 or 48"),
    };
    let layout = Layout { appearance, sh_degree: sh_degree.flatten(), ..Layout::radiance(0) };
    let layout = if table.has(METALNESS_NAME) { layout.physical() } else { layout };
    let layout = if table.has(FILTER) { layout.antialiased() } else { layout };
    match sh_degree {
        Some(_) => Ok(layout),
        None => Err(Error::HarmonicsCount { path: path.to_owned(), count, layout: name_of(layout), allowed }),
    }
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
