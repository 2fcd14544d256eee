//! Gaussians in plain columns, and as executors store them.

use crate::{
    error::{Column, InputError},
    inputs::{Colors, Inputs},
};
use specula_core::{
    activation::logit,
    antialias::LowPass,
    covariance::QUAT_MIN,
    scene::{Appearance, BLOCK, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
};

/// Largest harmonics of a colour: degree 3.
const DEGREE_MAX: u8 = 3;

/// Layout of Gaussians with these colours: harmonics, or none where the caller gives the colours.
pub(crate) fn layout_of(inputs: &Inputs<'_>, low_pass: LowPass) -> Result<Layout, InputError> {
    let plain = Layout { appearance: Appearance::Radiance, low_pass, ..Layout::radiance(0) };
    let (degree, coefficients) = match inputs.colors {
        Colors::Rgb(_) => return Ok(Layout { sh_degree: None, ..plain }),
        Colors::Harmonics { degree, coefficients } => (degree, coefficients.len()),
    };
    let count = inputs.means.len();
    let stored = (degree..=DEGREE_MAX).find(|stored| count * (usize::from(*stored) + 1).pow(2) == coefficients);
    match stored {
        Some(stored) => Ok(Layout { sh_degree: Some(stored), ..plain }),
        None => Err(InputError::Harmonics { degree, coefficients, count }),
    }
}

/// Checks the columns: one row for each Gaussian, and values in their ranges.
pub(crate) fn check(inputs: &Inputs<'_>) -> Result<(), InputError> {
    let count = inputs.means.len();
    let lengths = [
        (Column::Quats, inputs.quats.len()),
        (Column::Scales, inputs.scales.len()),
        (Column::Opacities, inputs.opacities.len()),
    ];
    let colors = match inputs.colors {
        Colors::Rgb(rgb) => Some((Column::Colors, rgb.len())),
        Colors::Harmonics { .. } => None,
    };
    if let Some((column, found)) = lengths.into_iter().chain(colors).find(|(_, len)| *len != count) {
        return Err(InputError::Length { column, expected: count, found });
    }
    check_column(Column::Means, inputs.means, |row| row.iter().all(|x| x.is_finite()))?;
    check_column(Column::Quats, inputs.quats, |row| {
        row.iter().all(|x| x.is_finite()) && row.iter().any(|x| x.abs() > QUAT_MIN)
    })?;
    check_column(Column::Scales, inputs.scales, |row| row.iter().all(|x| *x > 0.0 && x.is_finite()))?;
    check_column(Column::Opacities, inputs.opacities, |x| (0.0..=1.0).contains(x))?;
    let (Colors::Rgb(colors) | Colors::Harmonics { coefficients: colors, .. }) = inputs.colors;
    check_column(Column::Colors, colors, |row| row.iter().all(|x| x.is_finite()))
}

fn check_column<T>(column: Column, rows: &[T], is_valid: impl Fn(&T) -> bool) -> Result<(), InputError> {
    match rows.iter().position(|row| !is_valid(row)) {
        Some(row) => Err(InputError::Value { column, row }),
        None => Ok(()),
    }
}

/// Columns to Gaussians before activation. Colours that the caller gives are left out.
///
/// Opacities are kept in \[1e-7, 1 − 1e-7\], the range of [`logit`].
pub(crate) fn from_columns(inputs: &Inputs<'_>, layout: Layout) -> Gaussians<Vec<f32>> {
    let count = inputs.means.len();
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    let block_len = gaussians.block_len();
    let harmonics = match inputs.colors {
        Colors::Rgb(_) => &[],
        Colors::Harmonics { coefficients, .. } => coefficients,
    };
    let sh_count = layout.sh_count();
    for (number, block) in gaussians.values.chunks_exact_mut(block_len).enumerate() {
        let first = number * BLOCK;
        for lane in 0..BLOCK.min(count - first) {
            let gaussian = first + lane;
            let mut set = |plane: usize, value: f32| block[plane * BLOCK + lane] = value;
            for k in 0..3 {
                set(MEAN + k, inputs.means[gaussian][k]);
                set(LOG_SCALE + k, inputs.scales[gaussian][k].ln());
            }
            for k in 0..4 {
                set(QUAT + k, inputs.quats[gaussian][k]);
            }
            set(OPACITY, logit(inputs.opacities[gaussian]));
            for (k, coefficient) in harmonics[gaussian * sh_count..(gaussian + 1) * sh_count].iter().enumerate() {
                for c in 0..3 {
                    set(layout.sh_start() + 3 * k + c, coefficient[c]);
                }
            }
        }
    }
    gaussians
}

/// Adds neighbouring planes to rows of `width` numbers for each Gaussian; the factor of a number
/// depends on its index among all rows.
pub(crate) fn add_rows(
    rows: &mut [f32],
    width: usize,
    gaussians: &Gaussians<Vec<f32>>,
    first_plane: usize,
    factor: impl Fn(usize) -> f32,
) {
    let blocks = gaussians.values.chunks_exact(gaussians.block_len());
    for (number, (rows, block)) in rows.chunks_mut(BLOCK * width).zip(blocks).enumerate() {
        let first = number * BLOCK * width;
        for (lane, row) in rows.chunks_exact_mut(width).enumerate() {
            for (k, sum) in row.iter_mut().enumerate() {
                *sum += block[(first_plane + k) * BLOCK + lane] * factor(first + lane * width + k);
            }
        }
    }
}
