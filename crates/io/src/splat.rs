//! Plain Gaussians as `.splat`, the layout of antimatter15's viewer, which many others read.
//!
//! 32 bytes per Gaussian, without a header: mean and scale as three `f32` each; red, green, blue
//! and opacity as bytes; the quat (w, x, y, z) as bytes 128 + 128 q. Colours are those of the
//! constant harmonic. Gaussians are sorted by opacity times volume, largest first, so that a viewer
//! can show a partial download (github.com/antimatter15/splat, `convert.py`). Numbers are rounded
//! to the nearest byte; that program truncates.

use crate::{
    budget::SCENE,
    error::{Error, Result},
    gaussian_ply::{GaussianFile, thin},
    whole_file,
};
use specula_core::{
    activation::{logit, sigmoid},
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
    sh::Y0,
};
use std::{io::Write, path::Path};

/// Bytes per Gaussian.
pub const RECORD_LEN: usize = 32;

/// Writes plain Gaussians.
///
/// # Errors
///
/// [`crate::Error::Write`] if the file cannot be written.
pub fn write(path: &Path, gaussians: &Gaussians<Vec<f32>>) -> Result<()> {
    whole_file::write(path, |out| {
        by_visibility(gaussians).into_iter().try_for_each(|gaussian| out.write_all(&record(gaussians, gaussian)))
    })
}

/// Reads plain Gaussians.
///
/// # Errors
///
/// [`Error::Splats`] for a file that has no whole number of Gaussians, or numbers that are not
/// finite; [`Error::TooLarge`].
pub(crate) fn read(path: &Path) -> Result<GaussianFile> {
    let bytes = SCENE.read(path)?;
    let broken = |cause: String| Error::Splats { path: path.to_owned(), cause };
    let (records, rest) = bytes.as_chunks::<RECORD_LEN>();
    if records.is_empty() || !rest.is_empty() {
        let cause = format!("its {} bytes are not a multiple of {RECORD_LEN}, one for each Gaussian", bytes.len());
        return Err(broken(cause));
    }
    SCENE.ask(path, bytes.len() as u64, "it", 5 * bytes.len() as u64)?;
    let mut gaussians = empty(records.len());
    records.iter().enumerate().for_each(|(index, record)| decode(&mut gaussians, index, record));
    match (0..gaussians.count).find(|index| !gaussians.get::<6>(*index, MEAN).iter().all(|number| number.is_finite())) {
        Some(index) => Err(broken(format!("Gaussian {index} has a position or scale that is not finite"))),
        None => Ok(GaussianFile { gaussians, comments: Vec::new(), notes: Vec::new(), are_materials: false }),
    }
}

/// Gaussians after quantisation, as a reader decodes them, in their original order.
pub fn stored(gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
    let mut stored = empty(gaussians.count);
    for gaussian in 0..gaussians.count {
        decode(&mut stored, gaussian, &record(gaussians, gaussian));
        // Logarithms are not rounded by their exponential.
        stored.set(gaussian, LOG_SCALE, gaussians.get::<3>(gaussian, LOG_SCALE));
    }
    stored
}

fn empty(count: usize) -> Gaussians<Vec<f32>> {
    let layout = Layout::radiance(0);
    Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] }
}

/// Sets a Gaussian from its record. Scales of 0 become thin.
fn decode(gaussians: &mut Gaussians<Vec<f32>>, index: usize, record: &[u8; RECORD_LEN]) {
    let (numbers, _) = record[..24].as_chunks::<4>();
    let number = |k: usize| f32::from_le_bytes(numbers[k]);
    gaussians.set(index, MEAN, [0, 1, 2].map(number));
    gaussians.set(index, LOG_SCALE, thin([3, 4, 5].map(|k| number(k).ln())));
    let quat: [f32; 4] = core::array::from_fn(|k| (f32::from(record[28 + k]) - 128.0) / 128.0);
    gaussians.set(index, QUAT, quat);
    let [r, g, b, opacity]: [f32; 4] = core::array::from_fn(|k| f32::from(record[24 + k]) / 255.0);
    gaussians.set(index, OPACITY, [logit(opacity)]);
    gaussians.set(index, gaussians.layout.sh_start(), [r, g, b].map(|color| (color - 0.5) / Y0));
}

/// Indices by decreasing visibility; ties in their order.
fn by_visibility(gaussians: &Gaussians<Vec<f32>>) -> Vec<usize> {
    let visibility = |gaussian: usize| {
        let volume = gaussians.get::<3>(gaussian, LOG_SCALE).iter().sum::<f32>().exp();
        sigmoid(gaussians.get::<1>(gaussian, OPACITY)[0]) * volume
    };
    let visibilities: Vec<f32> = (0..gaussians.count).map(visibility).collect();
    let mut order: Vec<usize> = (0..gaussians.count).collect();
    order.sort_by(|a, b| visibilities[*b].total_cmp(&visibilities[*a]));
    order
}

fn record(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> [u8; RECORD_LEN] {
    let [mean, scale] = [gaussians.get::<3>(gaussian, MEAN), gaussians.get::<3>(gaussian, LOG_SCALE).map(f32::exp)];
    let mut record = [0; RECORD_LEN];
    for (bytes, number) in record.chunks_exact_mut(4).zip(mean.into_iter().chain(scale)) {
        bytes.copy_from_slice(&number.to_le_bytes());
    }
    record[24..28].copy_from_slice(&color_bytes(gaussians, gaussian));
    record[28..].copy_from_slice(&quat_bytes(gaussians, gaussian));
    record
}

fn color_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> [u8; 4] {
    let [r, g, b] = gaussians.get::<3>(gaussian, gaussians.layout.sh_start()).map(|first| 0.5 + Y0 * first);
    let [opacity] = gaussians.get::<1>(gaussian, OPACITY).map(sigmoid);
    [r, g, b, opacity].map(|share| byte(255.0 * share))
}

fn quat_bytes(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> [u8; 4] {
    unit(gaussians.get::<4>(gaussian, QUAT)).map(|q| byte(128.0 * q + 128.0))
}

/// Nearest byte, clamped to 0–255.
pub(crate) fn byte(number: f32) -> u8 {
    number.round().clamp(0.0, 255.0) as u8
}

/// Normalised quat; the identity for a quat of length 0.
pub(crate) fn unit(quat: [f32; 4]) -> [f32; 4] {
    let length = quat.iter().map(|q| q * q).sum::<f32>().sqrt();
    if length > 0.0 { quat.map(|q| q / length) } else { [1.0, 0.0, 0.0, 0.0] }
}
