//! Coloured points as PLY files: initial points of a training.

use crate::{error::Result, named::Files, table::Table, whole_file};
use glam::DVec3;
use specula_core::sh::Y0;
use std::{
    io::Write,
    path::{Path, PathBuf},
};

const LAYOUT: &str = "a point cloud with x, y, z and, for colours, red, green, blue";
/// Default places of a data set's point cloud.
const PLACES: [&str; 3] = ["points3d.ply", "sparse/0/points3d.ply", "sparse/points3d.ply"];
/// Names of colours.
const COLORS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];
/// Names of the mean colours of Gaussians, as harmonics.
const HARMONICS: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
/// Resolution of positions, relative to the size of the cloud, above which it is noted.
const COARSE: f64 = 1e-4;
/// Colour of points without colours, as in 3D Gaussian splatting.
const GRAY: [f32; 3] = [0.5; 3];

/// Points with colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in the world of the data set, or relative to an origin ([`crate::origin`]).
    pub positions: Vec<[f64; 3]>,
    /// Colours from 0 to 1, sRGB as in photographs.
    pub colors: Vec<[f32; 3]>,
}

impl PointCloud {
    /// Points relative to an origin.
    #[must_use]
    pub(crate) fn relative_to(mut self, origin: [f64; 3]) -> Self {
        let origin = DVec3::from(origin);
        for position in &mut self.positions {
            *position = (DVec3::from(*position) - origin).to_array();
        }
        self
    }
}

/// Point cloud that lies in a data set.
pub(crate) fn find(files: &Files) -> Option<PathBuf> {
    PLACES.iter().find_map(|place| files.file(Path::new(place)))
}

/// Reads points by the names of their properties. Colours are divided by the largest number of
/// their type, or of bytes if fractions are above 2; missing ones are grey. Those of Gaussians are
/// the mean of their harmonics.
///
/// # Errors
///
/// An error of [`crate::Error`] for files that cannot be read or parsed, exceed their memory
/// budget, or hold numbers that are not finite.
pub fn read(path: &Path) -> Result<PointCloud> {
    read_noting(path, &mut Vec::new())
}

/// Reads points, and notes missing colours and coarse positions.
pub(crate) fn read_noting(path: &Path, notes: &mut Vec<String>) -> Result<PointCloud> {
    let table = Table::open(path)?;
    let count = table.count();
    let column = |name: &str| table.names().find(|known| known.eq_ignore_ascii_case(name)).map(str::to_owned);
    let colors = COLORS.into_iter().chain([HARMONICS]).find(|names| column(names[0]).is_some());
    let names: Vec<String> = ["x", "y", "z"]
        .iter()
        .chain(colors.iter().flatten())
        .map(|name| column(name).unwrap_or_else(|| (*name).to_owned()))
        .collect();
    let declared = colors.map_or(1.0, |_| table.full_scale(&names[3]));
    let is_single = table.is_single(&names[0]);
    let columns = table.read::<f64>(&names, LAYOUT)?;
    let stored = |row: usize| columns.get::<3>(row, 3).map(|channel| channel as f32);
    let colors = match colors {
        None => {
            notes.push(format!("{path:?} has no known colours (red, green, blue), so its points are grey"));
            vec![GRAY; count]
        }
        Some(HARMONICS) => (0..count).map(|row| stored(row).map(|dc| (0.5 + Y0 * dc).clamp(0.0, 1.0))).collect(),
        Some(_) => {
            let full_scale = full_scale(declared, (0..count).flat_map(stored).fold(0.0, f32::max));
            (0..count).map(|row| stored(row).map(|channel| channel / full_scale)).collect()
        }
    };
    let positions: Vec<[f64; 3]> = (0..count).map(|row| columns.get(row, 0)).collect();
    if let Some(step) = resolution(&positions).filter(|_| is_single) {
        notes.push(format!(
            "{path:?} has positions in steps of {step}, because 32-bit numbers far from 0 0 0 are coarse; write them \
             as double, or nearer"
        ));
    }
    Ok(PointCloud { positions, colors })
}

/// Step between neighbouring 32-bit numbers at points, if it is coarse relative to the size of the
/// cloud.
fn resolution(positions: &[[f64; 3]]) -> Option<f32> {
    let along = |axis: usize| positions.iter().map(move |position| position[axis]);
    let [mut most, mut size] = [0.0_f64; 2];
    for axis in 0..3 {
        let (low, high) = (along(axis).fold(f64::INFINITY, f64::min), along(axis).fold(f64::NEG_INFINITY, f64::max));
        (most, size) = (most.max(low.abs()).max(high.abs()), size.max(high - low));
    }
    let most = most as f32;
    let step = most.next_up() - most;
    (f64::from(step) > COARSE * size && size > 0.0).then_some(step)
}

/// Number that represents 1, given the maximum of the columns' type (1 for fractions) and the
/// largest number. Fractions may slightly exceed 1.
fn full_scale(declared: f32, most: f32) -> f32 {
    let is_fraction = declared == 1.0 && most <= 2.0;
    let least = if most <= f32::from(u8::MAX) { u8::MAX.into() } else { u16::MAX };
    if is_fraction { 1.0 } else { least.into() }
}

/// Writes points in the layout of 3D Gaussian splatting: floats for positions and (zero) normals,
/// bytes for colours.
///
/// # Errors
///
/// [`crate::Error::Write`] if the file cannot be written.
pub fn write(path: &Path, points: &PointCloud) -> Result<()> {
    assert_eq!(points.positions.len(), points.colors.len(), "every point needs a colour");
    whole_file::write(path, |out| {
        write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", points.positions.len())?;
        for name in ["x", "y", "z", "nx", "ny", "nz"] {
            writeln!(out, "property float {name}")?;
        }
        for name in ["red", "green", "blue"] {
            writeln!(out, "property uchar {name}")?;
        }
        writeln!(out, "end_header")?;
        for (position, color) in points.positions.iter().zip(&points.colors) {
            let [x, y, z] = position.map(|coordinate| coordinate as f32);
            out.write_all(bytemuck::bytes_of(&[x, y, z, 0.0, 0.0, 0.0].map(|number: f32| number.to_le_bytes())))?;
            out.write_all(&color.map(crate::picture::byte))?;
        }
        Ok(())
    })
}
