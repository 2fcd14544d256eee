//! Plain Gaussians of PlayCanvas's compressed PLY files, as SuperSplat and splat-transform write.
//!
//! Gaussians come in chunks of 256. The element `chunk` has the range of each chunk's positions,
//! log scales and, in newer files, colours; `vertex` has four 32-bit integers, the fractions of
//! these ranges (developer.playcanvas.com, "Compressed PLY format"):
//!
//! | integer | bits from the highest |
//! |---|---|
//! | packed_position, packed_scale | x 11, y 10, z 11 |
//! | packed_rotation | largest of (w, x, y, z) 2; the others, 10 each, from −√½ to √½ |
//! | packed_color | red, green, blue, opacity, 8 each |
//!
//! Without a range, colours are from 0 to 1: ½ + Y₀ f_dc. The element `sh` has the other harmonics,
//! in the order of INRIA's files, as bytes: 8 ((b + ½)/256 − ½), with 0 and 255 for the ends.

use crate::{
    Input,
    budget::{PLY_HEADER_MAX, SCENE},
    error::{Error, Result},
    gaussian_ply::GaussianFile,
    latlong::start_of,
    table::{read_header, size_of_scalar},
    within,
};
use core::f32::consts::SQRT_2;
use ply_rs_bw::ply::{ElementDef, Encoding, PropertyType, ScalarType};
use specula_core::{
    activation::logit,
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
    sh::Y0,
};
use std::{
    io::{BufReader, Read},
    path::Path,
};

/// Gaussians in a chunk.
const CHUNK: usize = 256;
/// Name that only this layout has, in each file.
const MARK: &[u8] = b"packed_position";
/// Range of harmonics.
const HARMONICS: f32 = 8.0;

/// Rows of an element.
struct Rows {
    element: ElementDef,
    row_len: usize,
    bytes: Vec<u8>,
}

impl Rows {
    /// Offset of a property of this type in a row, if it exists.
    fn offset(&self, name: &str, scalar: &ScalarType) -> Option<usize> {
        let mut offset = 0;
        for (known, property) in &self.element.properties {
            let PropertyType::Scalar(found) = &property.data_type else { return None };
            if known == name {
                return (found == scalar).then_some(offset);
            }
            offset += size_of_scalar(found);
        }
        None
    }

    fn word(&self, row: usize, offset: usize) -> [u8; 4] {
        let at = row * self.row_len + offset;
        core::array::from_fn(|k| self.bytes[at + k])
    }
}

/// Reads a compressed file; `None` for other PLY files.
///
/// # Errors
///
/// [`Error::Splats`] for a damaged file, [`Error::TooLarge`], [`Error::Read`].
pub(crate) fn read(path: &Path) -> Result<Option<GaussianFile>> {
    if !start_of(Input::file(path))?.starts_with(b"ply") {
        return Ok(None);
    }
    let mut start = Vec::new();
    within::open(path)?.take(PLY_HEADER_MAX).read_to_end(&mut start).map_err(Error::reading(path))?;
    let end = start.windows(10).position(|word| word == b"end_header").unwrap_or(0);
    if !start[..end].windows(MARK.len()).any(|word| word == MARK) {
        return Ok(None);
    }
    let broken = |cause: &str| Error::Splats { path: path.to_owned(), cause: cause.to_owned() };
    let file = within::open(path)?;
    let len = file.metadata().map_err(Error::reading(path))?.len();
    let mut reader = BufReader::new(file);
    let header = read_header(path, &mut reader)?;
    if header.encoding != Encoding::BinaryLittleEndian {
        return Err(broken("compressed files are binary, with the lowest byte first"));
    }
    let [mut chunks, mut vertices, mut harmonics] = [const { None }; 3];
    for element in header.elements.values() {
        let sizes = element.properties.values().map(|property| match &property.data_type {
            PropertyType::Scalar(scalar) => Some(size_of_scalar(scalar)),
            PropertyType::List(..) => None,
        });
        let row_len = sizes.sum::<Option<usize>>().ok_or_else(|| broken("it has lists"))?;
        let size = (element.count as u64).saturating_mul(row_len as u64);
        // Numbers of a scene take less than ten times the memory of their bytes.
        SCENE.ask(path, len, format_args!("its {} of {:?}", element.count, element.name), size.saturating_mul(10))?;
        let mut bytes = Vec::new();
        reader.by_ref().take(size).read_to_end(&mut bytes).map_err(Error::reading(path))?;
        if (bytes.len() as u64) < size {
            return Err(broken("it is cut short; copy it again"));
        }
        let rows = Some(Rows { element: element.clone(), row_len, bytes });
        match element.name.as_str() {
            "chunk" => chunks = rows,
            "vertex" => vertices = rows,
            "sh" => harmonics = rows,
            _ => {}
        }
    }
    let gaussians = chunks.zip(vertices).and_then(|(chunks, vertices)| decode(&chunks, &vertices, harmonics.as_ref()));
    let gaussians = gaussians.ok_or_else(|| broken("it lacks elements or properties of the layout"))?;
    if !gaussians.values.iter().all(|number| number.is_finite()) {
        return Err(broken("a range of its chunks is not finite"));
    }
    Ok(Some(GaussianFile { gaussians, comments: header.comments, notes: Vec::new(), are_materials: false }))
}

/// Gaussians of the elements; `None` if one lacks a property, or does not fit the others.
fn decode(chunks: &Rows, vertices: &Rows, harmonics: Option<&Rows>) -> Option<Gaussians<Vec<f32>>> {
    let count = vertices.element.count;
    let rest = harmonics.map_or(0, |rows| rows.element.properties.len());
    let degree = (0..=3).find(|degree| 3 * (Layout::radiance(*degree).sh_count() - 1) == rest)?;
    let layout = Layout::radiance(degree);
    if count == 0
        || chunks.element.count < count.div_ceil(CHUNK)
        || harmonics.is_some_and(|rows| rows.element.count != count)
    {
        return None;
    }
    let places = |names: [&str; 3]| -> Option<[usize; 3]> {
        let [x, y, z] = names.map(|name| chunks.offset(name, &ScalarType::Float));
        Some([x?, y?, z?])
    };
    let means = [places(["min_x", "min_y", "min_z"])?, places(["max_x", "max_y", "max_z"])?];
    let scales = [
        places(["min_scale_x", "min_scale_y", "min_scale_z"])?,
        places(["max_scale_x", "max_scale_y", "max_scale_z"])?,
    ];
    let colors = places(["min_r", "min_g", "min_b"]).zip(places(["max_r", "max_g", "max_b"]));
    let [position, rotation, scale, color] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]
        .map(|name| vertices.offset(name, &ScalarType::UInt));
    let (position, rotation, scale, color) = (position?, rotation?, scale?, color?);

    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for index in 0..count {
        let integer = |offset: usize| u32::from_le_bytes(vertices.word(index, offset));
        let within = |[low, high]: [[usize; 3]; 2], shares: [f32; 3]| -> [f32; 3] {
            let number = |offset: usize| f32::from_le_bytes(chunks.word(index / CHUNK, offset));
            core::array::from_fn(|k| number(low[k]) * (1.0 - shares[k]) + number(high[k]) * shares[k])
        };
        gaussians.set(index, MEAN, within(means, shares_of_three(integer(position))));
        gaussians.set(index, LOG_SCALE, within(scales, shares_of_three(integer(scale))));
        gaussians.set(index, QUAT, quat(integer(rotation)));
        let [r, g, b, opacity] = integer(color).to_be_bytes().map(|byte| f32::from(byte) / 255.0);
        gaussians.set(index, OPACITY, [logit(opacity)]);
        let rgb = colors.map_or([r, g, b], |(low, high)| within([low, high], [r, g, b]));
        gaussians.set(index, layout.sh_start(), rgb.map(|channel| (channel - 0.5) / Y0));
        let Some(harmonics) = harmonics else { continue };
        let row = &harmonics.bytes[index * harmonics.row_len..][..rest];
        for (k, byte) in row.iter().enumerate() {
            let plane = layout.sh_start() + 3 * (k % (rest / 3) + 1) + k / (rest / 3);
            gaussians.set(index, plane, [harmonic(*byte)]);
        }
    }
    Some(gaussians)
}

/// Fractions of 11, 10 and 11 bits.
fn shares_of_three(integer: u32) -> [f32; 3] {
    [share(integer >> 21, 11), share(integer >> 11, 10), share(integer, 11)]
}

/// The lowest bits as a fraction of their largest number.
fn share(integer: u32, bits: u32) -> f32 {
    let largest = (1 << bits) - 1;
    (integer & largest) as f32 / largest as f32
}

/// Quat (w, x, y, z).
fn quat(integer: u32) -> [f32; 4] {
    let largest = (integer >> 30) as usize;
    let mut quat = [0.0; 4];
    for (place, k) in (0..4).filter(|k| *k != largest).enumerate() {
        quat[k] = (share(integer >> (10 * (2 - place)), 10) - 0.5) * SQRT_2;
    }
    quat[largest] = (1.0 - quat.iter().map(|q| q * q).sum::<f32>()).max(0.0).sqrt();
    quat
}

fn harmonic(byte: u8) -> f32 {
    let share = match byte {
        0 => 0.0,
        255 => 1.0,
        byte => (f32::from(byte) + 0.5) / 256.0,
    };
    HARMONICS * (share - 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a step of ten bits over the range of a component.
    const QUAT_STEP: f32 = SQRT_2 / 1023.0;

    #[test]
    fn quats_are_unit_quats_with_the_largest_component_restored() {
        // w = x = z = ½ and y = ½ as the largest: 2 is the index of y.
        let half = ((0.5 * core::f32::consts::FRAC_1_SQRT_2 + 0.5) * 1023.0_f32).round() as u32;
        let found = quat(2 << 30 | half << 20 | half << 10 | half);
        assert!(found.iter().all(|q| (q - 0.5).abs() < 3.0 * QUAT_STEP), "{found:?}");
        assert_eq!(shares_of_three(u32::MAX), [1.0; 3]);
        assert_eq!(shares_of_three(0x7ff), [0.0, 0.0, 1.0]);
        assert_eq!([harmonic(0), harmonic(255), harmonic(127) + harmonic(128)], [-4.0, 4.0, 0.0]);
    }
}
