//! A picture against what it should be: colour, structure, normals, coverage, and their gradients.

mod normals;
mod structure;

use crate::{
    blend::{Frame, FrameGrad, bands},
    lanes::{Lanes, load_some, store_some},
};
use fearless_simd::{Level, Simd, dispatch};
use normals::normal_loss;
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    color::over,
    loss::{LossReport, LossWeights, absolute, absolute_vjp, sparse_coverage_vjp, squared, squared_vjp},
    plan::channel,
    scene::{BLOCK, Image},
};
use structure::structure_loss;

/// A picture to compare with: 8-bit sRGB with straight alpha.
#[derive(Clone, Debug)]
pub struct Target {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) rgba: Vec<u8>,
    /// Whether any pixel is not opaque.
    has_alpha: bool,
}

impl Target {
    pub(crate) fn new(width: usize, height: usize, rgba: &[u8]) -> Self {
        let has_alpha = rgba.chunks_exact(4).any(|pixel| pixel[3] < u8::MAX);
        Self { width, height, rgba: rgba.to_vec(), has_alpha }
    }
}

/// Size of a plane.
#[derive(Clone, Copy)]
struct Plane {
    width: usize,
    height: usize,
}

/// Pixels that one task takes.
const PIXELS_AT_ONCE: usize = 4096;

pub(crate) fn loss_all(
    level: Level,
    frame: &Frame,
    target: &Target,
    camera: &Camera,
    weights: &LossWeights,
    background: [f32; 3],
) -> (LossReport, FrameGrad) {
    let (width, height) = (frame.image.width, frame.image.height);
    let size = width * height;
    let mut grad = vec![0.0; frame.image.values.len()];
    // The rendered colours over the background, then the true ones.
    let mut colors = vec![0.0; 6 * size];
    let mut report = pixel_losses(level, frame, target, weights, background, &mut colors, &mut grad);
    if weights.dssim != 0.0 {
        let (rendered, truth) = colors.split_at(3 * size);
        let plane = Plane { width, height };
        report.ssim = structure_loss(level, plane, rendered, truth, weights.dssim, &mut grad[..3 * size]);
    }
    background_vjp(&mut grad, size, background);
    if frame.channel_count() > 3 {
        attribute_losses(frame, weights, &mut grad);
        if weights.normal != 0.0 && width > 2 && height > 2 {
            report.normal = normal_loss(level, frame, camera, weights, &mut grad);
        }
    }
    report.total = f64::from(weights.absolute) * report.absolute
        + f64::from(weights.squared) * report.squared
        + f64::from(weights.dssim) * (1.0 - report.ssim)
        + f64::from(weights.normal) * report.normal
        + f64::from(weights.coverage) * report.coverage;
    (report, FrameGrad { image: Image { values: grad, ..frame.image } })
}

/// What pixels add to the losses that look at one pixel at a time.
#[derive(Clone, Copy, Default)]
struct PixelSums {
    absolute: f64,
    squared: f64,
    coverage: f64,
}

/// Losses that look at one pixel at a time, and their gradients: colour and coverage. Writes both pictures as well.
fn pixel_losses(
    level: Level,
    frame: &Frame,
    target: &Target,
    weights: &LossWeights,
    background: [f32; 3],
    colors: &mut [f32],
    grad: &mut [f32],
) -> LossReport {
    let size = frame.image.pixel_count();
    let mut weights = *weights;
    if !target.has_alpha {
        weights.coverage = 0.0;
    }
    let bands = bands(colors, size, PIXELS_AT_ONCE).into_par_iter().zip(bands(grad, size, PIXELS_AT_ONCE));
    let sums: Vec<PixelSums> = bands
        .enumerate()
        .map(|(band, (mut colors, mut grad))| {
            let first = band * PIXELS_AT_ONCE;
            dispatch!(level, simd => {
                pixel_losses_in_band(simd, frame, target, &weights, background, first, &mut colors, &mut grad)
            })
        })
        .collect();
    let mean = |of: fn(&PixelSums) -> f64, count: usize| sums.iter().map(of).sum::<f64>() / count as f64;
    LossReport {
        absolute: mean(|sums| sums.absolute, 3 * size),
        squared: mean(|sums| sums.squared, 3 * size),
        coverage: mean(|sums| sums.coverage, size),
        ..LossReport::default()
    }
}

#[inline(always)]
fn pixel_losses_in_band<S: Simd>(
    simd: S,
    frame: &Frame,
    target: &Target,
    weights: &LossWeights,
    background: [f32; 3],
    first: usize,
    colors: &mut [&mut [f32]],
    grad: &mut [&mut [f32]],
) -> PixelSums {
    let size = frame.image.pixel_count();
    let share = |weight: f32, count: usize| Lanes::splat(simd, weight / count as f32);
    let (of_absolute, of_squared) = (share(weights.absolute, 3 * size), share(weights.squared, 3 * size));
    let of_coverage = share(weights.coverage, size);
    let mut sums = [Lanes::splat(simd, 0.0); 3];
    let len = colors[0].len();
    for start in (0..len).step_by(BLOCK) {
        let count = BLOCK.min(len - start);
        let at = |plane: &[f32]| load_some(simd, &plane[first + start..], count);
        let [truth @ .., alpha] = read_pixels(simd, &target.rgba[4 * (first + start)..], count);
        let passed = at(frame.transmittance());
        for c in 0..3 {
            let rendered = at(frame.image.plane(c)) + passed * background[c];
            let truth = over(truth[c], alpha, Lanes::splat(simd, background[c])).keep_first(count);
            sums[0] = sums[0] + absolute(rendered, truth);
            sums[1] = sums[1] + squared(rendered, truth);
            let own = absolute_vjp(rendered, truth, of_absolute) + squared_vjp(rendered, truth, of_squared);
            store_some(own, &mut grad[c][start..], count);
            store_some(rendered, &mut colors[c][start..], count);
            store_some(truth, &mut colors[3 + c][start..], count);
        }
        if weights.coverage != 0.0 {
            let coverage = (-passed + 1.0).keep_first(count);
            sums[2] = sums[2] + absolute(coverage, alpha);
            let last = grad.len() - 1;
            store_some(-absolute_vjp(coverage, alpha, of_coverage), &mut grad[last][start..], count);
        }
    }
    let [absolute, squared, coverage] = sums;
    let number = |sum: Lanes<S>| f64::from(sum.sum());
    PixelSums { absolute: number(absolute), squared: number(squared), coverage: number(coverage) }
}

/// Red, green, blue and alpha of up to sixteen pixels, in \[0, 1\]; zeros where there are none.
#[inline(always)]
fn read_pixels<S: Simd>(simd: S, rgba: &[u8], count: usize) -> [Lanes<S>; 4] {
    let mut channels = [[0.0; BLOCK]; 4];
    for (lane, pixel) in rgba.chunks_exact(4).take(count).enumerate() {
        for (channel, value) in channels.iter_mut().zip(pixel) {
            channel[lane] = f32::from(*value);
        }
    }
    let share = |channel: [f32; BLOCK]| Lanes::from_array(simd, channel) * (1.0 / 255.0);
    let [red, green, blue, alpha] = channels;
    [share(red), share(green), share(blue), share(alpha)]
}

/// Gradient of the transmittance through the background.
fn background_vjp(grad: &mut [f32], size: usize, background: [f32; 3]) {
    let (channels, last) = grad.split_at_mut(grad.len() - size);
    for (plane, background) in channels.chunks(size.max(1)).zip(background) {
        last.iter_mut().zip(plane).for_each(|(sum, grad)| *sum += grad * background);
    }
}

/// Gradients of the authors' losses on what was blended: sparse coverage, small residuals.
fn attribute_losses(frame: &Frame, weights: &LossWeights, grad: &mut [f32]) {
    let size = frame.image.pixel_count();
    let share = 1.0 / size as f32;
    if weights.sparse_coverage != 0.0 {
        let start = grad.len() - size;
        for (grad, passed) in grad[start..].iter_mut().zip(frame.transmittance()) {
            *grad -= sparse_coverage_vjp(1.0 - passed, weights.sparse_coverage * share);
        }
    }
    if weights.residual_image != 0.0 {
        let plane = &mut grad[channel::RESIDUAL_SIZE * size..(channel::RESIDUAL_SIZE + 1) * size];
        for (grad, passed) in plane.iter_mut().zip(frame.transmittance()) {
            *grad += weights.residual_image * share * (1.0 - passed);
        }
    }
}
