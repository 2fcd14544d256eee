//! Plain Gaussians as `.spz`, Niantic's compressed format, version 3.
//!
//! A gzip stream of a header of 16 bytes and one array for each attribute
//! (github.com/nianticlabs/spz, README):
//!
//! | array | numbers |
//! |---|---|
//! | means | 24-bit fixed point, as many bits behind the point as the header says |
//! | opacities | bytes, 255 σ(opacity) |
//! | colours | bytes, 255 (0.15 f_dc + ½) |
//! | scales | bytes, 16 (ln s + 10) |
//! | rotations | 32 bits: index of the largest of (x, y, z, w); the others, 10 bits each, ± √½ |
//! | harmonics | bytes, 128 + 128 f_rest, colours innermost |
//!
//! Positions are in the scene's own world; the format defines no other.

use crate::{
    error::Result,
    splat::{byte, unit},
    whole_file,
};
use core::f32::consts::FRAC_1_SQRT_2;
use flate2::{Compression, write::GzEncoder};
use specula_core::{
    activation::{logit, sigmoid},
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
};
use std::{io::Write, path::Path};

const MAGIC: u32 = 0x5053_474e;
const VERSION: u32 = 3;
/// Factor of colours, which leaves headroom beyond the displayable range.
const COLOR_SCALE: f32 = 0.15;
/// Bits of the largest coordinate.
const MEAN_BITS: i32 = 16;
/// Maximum number of fractional bits; more would leave too few integer bits.
const FRACTION_MAX: i32 = 20;
/// Largest magnitude of the three smaller components of a quat.
const QUAT_STEPS: f32 = 511.0;

/// Writes plain Gaussians.
///
/// # Errors
///
/// [`crate::Error::Write`] if the file cannot be written.
pub fn write(path: &Path, gaussians: &Gaussians<Vec<f32>>) -> Result<()> {
    let Layout { sh_degree, .. } = gaussians.layout;
    let bits = fraction_bits(gaussians);
    let header =
        [MAGIC, VERSION, gaussians.count as u32, u32::from_le_bytes([sh_degree.unwrap_or(0), bits as u8, 0, 0])];
    whole_file::write(path, |out| {
        let mut out = GzEncoder::new(out, Compression::best());
        header.iter().try_for_each(|word| out.write_all(&word.to_le_bytes()))?;
        let all = || 0..gaussians.count;
        all().try_for_each(|gaussian| out.write_all(&mean_bytes(gaussians, gaussian, bits)))?;
        all().try_for_each(|gaussian| out.write_all(&[opacity_byte(gaussians, gaussian)]))?;
        all().try_for_each(|gaussian| out.write_all(&color_bytes(gaussians, gaussian)))?;
        all().try_for_each(|gaussian| out.write_all(&scale_bytes(gaussians, gaussian)))?;
        all().try_for_each(|gaussian| out.write_all(&pack_quat(gaussians.get(gaussian, QUAT)).to_le_bytes()))?;
        all().try_for_each(|gaussian| out.write_all(&rest_bytes(gaussians, gaussian)))?;
        out.finish().map(drop)
    })
}

/// Gaussians after quantisation, as a reader decodes them.
pub fn stored(gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
    let layout = gaussians.layout;
    let mut stored = Gaussians { values: vec![0.0; len_of_values(gaussians.count, layout)], ..*gaussians };
    let step = f32::powi(2.0, -fraction_bits(gaussians));
    for gaussian in 0..gaussians.count {
        let number = |byte: u8| f32::from(byte) / 255.0;
        stored.set(gaussian, MEAN, gaussians.get::<3>(gaussian, MEAN).map(|x| (x / step).round() * step));
        stored.set(gaussian, OPACITY, [logit(number(opacity_byte(gaussians, gaussian)))]);
        let first = color_bytes(gaussians, gaussian).map(|byte| (number(byte) - 0.5) / COLOR_SCALE);
        stored.set(gaussian, layout.sh_start(), first);
        let log_scales = scale_bytes(gaussians, gaussian).map(|byte| f32::from(byte) / 16.0 - 10.0);
        stored.set(gaussian, LOG_SCALE, log_scales);
        stored.set(gaussian, QUAT, unpack_quat(pack_quat(gaussians.get(gaussian, QUAT))));
        for (k, byte) in rest_bytes(gaussians, gaussian).into_iter().enumerate() {
            stored.set(gaussian, layout.sh_start() + 3 + k, [(f32::from(byte) - 128.0) / 128.0]);
        }
    }
    stored
}

/// Number of fractional bits for which the largest coordinate has [`MEAN_BITS`], so that the
/// precision is relative to the scene's size.
fn fraction_bits(gaussians: &Gaussians<Vec<f32>>) -> i32 {
    let means = (MEAN..MEAN + 3).flat_map(|plane| gaussians.plane(plane));
    let largest = means.fold(f32::MIN_POSITIVE, |most, x| most.max(x.abs()));
    (MEAN_BITS - largest.log2().ceil() as i32).clamp(0, FRACTION_MAX)
}

fn mean_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize, bits: i32) -> [u8; 9] {
    let mut bytes = [0; 9];
    for (bytes, x) in bytes.chunks_exact_mut(3).zip(gaussians.get::<3>(gaussian, MEAN)) {
        bytes.copy_from_slice(&((x * f32::powi(2.0, bits)).round() as i32).to_le_bytes()[..3]);
    }
    bytes
}

fn opacity_byte(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> u8 {
    byte(255.0 * sigmoid(gaussians.get::<1>(gaussian, OPACITY)[0]))
}

fn color_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> [u8; 3] {
    gaussians.get::<3>(gaussian, gaussians.layout.sh_start()).map(|first| byte(255.0 * (COLOR_SCALE * first + 0.5)))
}

fn scale_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> [u8; 3] {
    gaussians.get::<3>(gaussian, LOG_SCALE).map(|log_scale| byte(16.0 * (log_scale + 10.0)))
}

/// Harmonics above degree 0, coefficient by coefficient.
fn rest_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> Vec<u8> {
    let Layout { sh_degree: Some(_), .. } = gaussians.layout else { return Vec::new() };
    let rest = gaussians.layout.sh_start() + 3..gaussians.layout.sh_end();
    rest.map(|plane| byte(128.0 * gaussians.get::<1>(gaussian, plane)[0] + 128.0)).collect()
}

/// Packs a quat: the index of the largest component in the two highest bits, then the others as
/// sign and magnitude.
fn pack_quat(quat: [f32; 4]) -> u32 {
    let [w, x, y, z] = unit(quat);
    let quat = [x, y, z, w];
    let largest = (0..4).fold(0, |most, k| if quat[k].abs() > quat[most].abs() { k } else { most });
    let others = (0..4).filter(|k| *k != largest);
    others.fold(largest as u32, |bits, k| {
        let is_negative = (quat[k] < 0.0) != (quat[largest] < 0.0);
        let magnitude = (QUAT_STEPS * quat[k].abs() / FRAC_1_SQRT_2).round().min(QUAT_STEPS) as u32;
        bits << 10 | u32::from(is_negative) << 9 | magnitude
    })
}

/// Unpacks a quat (w, x, y, z).
fn unpack_quat(bits: u32) -> [f32; 4] {
    let largest = (bits >> 30) as usize;
    let mut quat = [0.0; 4];
    for (place, k) in (0..4).filter(|k| *k != largest).enumerate() {
        let part = bits >> (10 * (2 - place));
        let magnitude = FRAC_1_SQRT_2 * (part & 0x1ff) as f32 / QUAT_STEPS;
        quat[k] = if part >> 9 & 1 == 1 { -magnitude } else { magnitude };
    }
    quat[largest] = (1.0 - quat.iter().map(|q| q * q).sum::<f32>()).max(0.0).sqrt();
    let [x, y, z, w] = quat;
    [w, x, y, z]
}
