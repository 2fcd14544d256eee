//! SSIM of two pictures and its gradient, a band of rows at a time.

use super::Plane;
use crate::lanes::{Lanes, load_some, store_some};
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    loss::{SSIM_WINDOW, SsimMoments, ssim, ssim_vjp, ssim_window},
    real::Real,
    scene::BLOCK,
};

/// Half of SSIM's window.
const REACH: usize = SSIM_WINDOW / 2;
/// Rows that one task takes. Those above and below that the window needs are worked on twice.
const ROWS_AT_ONCE: usize = 32;

/// Mean SSIM of three planes; adds the gradient of `weight` · (1 − SSIM).
pub(super) fn structure_loss(
    level: Level,
    plane: Plane,
    rendered: &[f32],
    truth: &[f32],
    weight: f32,
    grad: &mut [f32],
) -> f64 {
    let size = plane.width * plane.height;
    let share = weight / rendered.len() as f32;
    let mut partials = vec![0.0; 3 * rendered.len()];
    let pictures = || rendered.par_chunks(size).zip(truth.par_chunks(size));
    let sums: Vec<f64> = partials
        .par_chunks_mut(3 * size)
        .zip(pictures())
        .map(|(partials, (x, y))| compare(level, plane, x, y, partials, -share))
        .collect();
    grad.par_chunks_mut(size)
        .zip(partials.par_chunks(3 * size))
        .zip(pictures())
        .for_each(|((grad, partials), (x, y))| add_grads(level, plane, x, y, partials, grad));
    sums.iter().sum::<f64>() / rendered.len() as f64
}

/// Sum of SSIM over a plane, and the gradients of E\[x\], E\[x²\] and E\[xy\] of every pixel, times a factor.
fn compare(level: Level, plane: Plane, x: &[f32], y: &[f32], partials: &mut [f32], factor: f32) -> f64 {
    let maps = [Map::Plain(x), Map::Plain(y), Map::Product(x, x), Map::Product(y, y), Map::Product(x, y)];
    let band_len = ROWS_AT_ONCE * plane.width;
    let [first, second, third] = planes_of(partials);
    let bands = first.par_chunks_mut(band_len).zip(second.par_chunks_mut(band_len));
    let sums: Vec<f64> = bands
        .zip(third.par_chunks_mut(band_len))
        .enumerate()
        .map(|(band, ((a, b), c))| {
            let blurred = blur_maps(level, plane, band * ROWS_AT_ONCE, maps);
            dispatch!(level, simd => compare_band(simd, &blurred, [a, b, c], factor))
        })
        .collect();
    sums.iter().sum()
}

fn planes_of(values: &mut [f32]) -> [&mut [f32]; 3] {
    let size = values.len() / 3;
    let (first, rest) = values.split_at_mut(size);
    let (second, third) = rest.split_at_mut(size);
    [first, second, third]
}

#[inline(always)]
fn compare_band<S: Simd>(simd: S, blurred: &[Vec<f32>; 5], mut partials: [&mut [f32]; 3], factor: f32) -> f64 {
    let factor = Lanes::splat(simd, factor);
    let mut sum = 0.0;
    let len = blurred[0].len();
    for start in (0..len).step_by(BLOCK) {
        let count = BLOCK.min(len - start);
        let at = |k: usize| load_some(simd, &blurred[k][start..], count);
        let moments = SsimMoments { x: at(0), y: at(1), xx: at(2), yy: at(3), xy: at(4) };
        // Where there are no more pixels all moments are zero, and windows of zeros are equal: SSIM is one.
        sum += f64::from(ssim(&moments).sum()) - (BLOCK - count) as f64;
        for (lanes, partials) in ssim_vjp(&moments, factor).into_iter().zip(&mut partials) {
            store_some(lanes, &mut partials[start..], count);
        }
    }
    sum
}

/// Every window passes its gradients on to its pixels.
fn add_grads(level: Level, plane: Plane, x: &[f32], y: &[f32], partials: &[f32], grad: &mut [f32]) {
    let size = plane.width * plane.height;
    let band_len = ROWS_AT_ONCE * plane.width;
    let pictures = x.par_chunks(band_len).zip(y.par_chunks(band_len));
    grad.par_chunks_mut(band_len).zip(pictures).enumerate().for_each(|(band, (grad, (x, y)))| {
        let maps = [0, 1, 2].map(|k| Map::Plain(&partials[k * size..(k + 1) * size]));
        let blurred = blur_maps(level, plane, band * ROWS_AT_ONCE, maps);
        dispatch!(level, simd => add_grads_of_band(simd, x, y, &blurred, grad));
    });
}

#[inline(always)]
fn add_grads_of_band<S: Simd>(simd: S, x: &[f32], y: &[f32], blurred: &[Vec<f32>; 3], grad: &mut [f32]) {
    let [of_x, of_xx, of_xy] = blurred;
    for start in (0..grad.len()).step_by(BLOCK) {
        let count = BLOCK.min(grad.len() - start);
        let at = |values: &[f32]| load_some(simd, &values[start..], count);
        let through_squares = at(x) * 2.0 * at(of_xx) + at(y) * at(of_xy);
        store_some(at(grad) + at(of_x) + through_squares, &mut grad[start..], count);
    }
}

/// Numbers of pixels: those of a plane, or products of two.
#[derive(Clone, Copy)]
enum Map<'a> {
    Plain(&'a [f32]),
    Product(&'a [f32], &'a [f32]),
}

impl Map<'_> {
    #[inline(always)]
    fn read(self, start: usize, out: &mut [f32]) {
        let end = start + out.len();
        match self {
            Map::Plain(values) => out.copy_from_slice(&values[start..end]),
            Map::Product(a, b) => {
                let factors = a[start..end].iter().zip(&b[start..end]);
                out.iter_mut().zip(factors).for_each(|(out, (a, b))| *out = a * b);
            }
        }
    }
}

/// Some rows of each map, blurred by SSIM's window.
fn blur_maps<const N: usize>(level: Level, plane: Plane, first_row: usize, maps: [Map<'_>; N]) -> [Vec<f32>; N] {
    maps.map(|map| dispatch!(level, simd => blur_band(simd, plane, first_row, map)))
}

/// Some rows of a map, blurred by SSIM's window; beyond the border everything is zero.
#[inline(always)]
fn blur_band<S: Simd>(simd: S, plane: Plane, first_row: usize, map: Map<'_>) -> Vec<f32> {
    let window = window_lanes(simd);
    let rows = ROWS_AT_ONCE.min(plane.height - first_row);
    let padded_width = plane.width.next_multiple_of(BLOCK);
    let above = REACH.min(first_row);
    let below = REACH.min(plane.height - first_row - rows);

    let mut line = vec![0.0; padded_width + 2 * REACH];
    let mut across = vec![0.0; (above + rows + below) * padded_width];
    for (row, out) in across.chunks_exact_mut(padded_width).enumerate() {
        map.read((first_row - above + row) * plane.width, &mut line[REACH..REACH + plane.width]);
        blur_line(simd, &line, &window, out);
    }
    let mut out = vec![0.0; rows * plane.width];
    for (row, out) in out.chunks_exact_mut(plane.width).enumerate() {
        blur_down(simd, &across, padded_width, row + above, &window, out);
    }
    out
}

/// A row of SSIM's window, each weight in every lane.
#[inline(always)]
fn window_lanes<S: Simd>(simd: S) -> [Lanes<S>; SSIM_WINDOW] {
    let mut lanes = [Lanes::splat(simd, 0.0); SSIM_WINDOW];
    for (lanes, weight) in lanes.iter_mut().zip(ssim_window()) {
        *lanes = Lanes::splat(simd, weight);
    }
    lanes
}

#[inline(always)]
fn blur_line<S: Simd>(simd: S, line: &[f32], window: &[Lanes<S>; SSIM_WINDOW], out: &mut [f32]) {
    for (k, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let mut sum = Lanes::splat(simd, 0.0);
        for (tap, weight) in window.iter().enumerate() {
            sum = Lanes::load(simd, &line[k * BLOCK + tap..]).mul_add(*weight, sum);
        }
        sum.store(out);
    }
}

#[inline(always)]
fn blur_down<S: Simd>(
    simd: S,
    lines: &[f32],
    width: usize,
    row: usize,
    window: &[Lanes<S>; SSIM_WINDOW],
    out: &mut [f32],
) {
    let first = row.saturating_sub(REACH);
    let last = (row + REACH).min(lines.len() / width - 1);
    for (k, out) in out.chunks_mut(BLOCK).enumerate() {
        let mut sum = Lanes::splat(simd, 0.0);
        for line in first..=last {
            sum = Lanes::load(simd, &lines[line * width + k * BLOCK..]).mul_add(window[line + REACH - row], sum);
        }
        store_some(sum, out, out.len());
    }
}
