//! Coloured points as PLY files: initial points of a training.

use crate::{error::Result, table::Table, whole_file};
use std::{io::Write, path::Path};

const LAYOUT: &str = "a point cloud with x, y, z and, for colours, red, green, blue";
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
    pub(crate) fn relative_to(mut self, [x, y, z]: [f64; 3]) -> Self {
        self.positions.iter_mut().for_each(|position| *position = [position[0] - x, position[1] - y, position[2] - z]);
        self
    }
}

/// Reads points by the names of their properties. Colours in bytes are divided by 255, missing ones
/// are grey.
///
/// # Errors
///
/// An error of [`crate::Error`] for files that cannot be read or parsed, exceed their memory
/// budget, or hold numbers that are not finite.
pub fn read(path: &Path) -> Result<PointCloud> {
    let table = Table::open(path)?;
    let count = table.count();
    let mut names = ["x", "y", "z"].map(str::to_owned).to_vec();
    let full_scale = table.full_scale("red");
    if table.has("red") {
        names.extend(["red", "green", "blue"].map(str::to_owned));
    }

    let columns = table.read(&names, LAYOUT)?;
    let color = |row| if names.len() > 3 { columns.get(row, 3).map(|channel: f32| channel / full_scale) } else { GRAY };
    Ok(PointCloud {
        positions: (0..count).map(|row| columns.get(row, 0).map(f64::from)).collect(),
        colors: (0..count).map(color).collect(),
    })
}

/// Writes points in the layout of 3D Gaussian splatting: floats for positions and (zero) normals,
/// bytes for colours.
///
/// # Errors
///
/// [`crate::Error::Write`], where the file cannot be written.
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
