//! A picture against what it should be: colour, structure, normals, coverage, and their gradients.

use crate::{
    blend::{Frame, FrameGrad, bands},
    lanes::{Lanes, load_some, store_some},
};
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    color::over,
    depth_normal::{Cross, expected_depth, expected_depth_vjp, normal, normal_vjp},
    loss::{
        LossReport, LossWeights, NormalForm, SSIM_WINDOW, SsimMoments, absolute, absolute_vjp, normal_cosine,
        normal_cosine_vjp, normal_distance, normal_distance_vjp, sparse_coverage_vjp, squared, squared_vjp, ssim,
        ssim_vjp, ssim_window,
    },
    plan::channel,
    real::Real,
    scene::{BLOCK, Image},
    vector::{Mat3, Vec3, vec3},
};

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

    /// The picture over a background: three planes, then its alpha.
    fn over(&self, background: [f32; 3]) -> Vec<f32> {
        let size = self.width * self.height;
        let mut planes = vec![0.0; 4 * size];
        for (channel, plane) in planes.chunks_mut(size.max(1)).enumerate() {
            plane.par_iter_mut().zip(self.rgba.par_chunks_exact(4)).with_min_len(4096).for_each(|(value, pixel)| {
                *value = match channel {
                    3 => f32::from(pixel[3]) / 255.0,
                    c => over(pixel[c], pixel[3], background[c]),
                };
            });
        }
        planes
    }
}

/// Rows that one task takes.
const ROWS_AT_ONCE: usize = 16;

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
    let truth = target.over(background);
    let rendered = composite(frame, background);
    let mut grad = vec![0.0; frame.image.values.len()];
    let mut report = LossReport::default();

    color_loss(&rendered, &truth[..3 * size], weights, &mut grad[..3 * size], &mut report);
    if weights.dssim != 0.0 {
        let plane = Plane { width, height };
        report.ssim = structure_loss(level, plane, &rendered, &truth[..3 * size], weights.dssim, &mut grad[..3 * size]);
    }
    background_vjp(&mut grad, size, background);
    if weights.coverage != 0.0 && target.has_alpha {
        report.coverage = coverage_loss(frame, &truth[3 * size..], weights.coverage, &mut grad);
    }
    if frame.channel_count() > 3 {
        geometry_loss(level, frame, camera, weights, &mut grad, &mut report);
    }
    report.total = f64::from(weights.absolute) * report.absolute
        + f64::from(weights.squared) * report.squared
        + f64::from(weights.dssim) * (1.0 - report.ssim)
        + f64::from(weights.normal) * report.normal
        + f64::from(weights.coverage) * report.coverage;
    (report, FrameGrad { image: Image { values: grad, ..frame.image } })
}

/// Colours over a background: C + T · background.
pub(crate) fn composite(frame: &Frame, background: [f32; 3]) -> Vec<f32> {
    let size = frame.image.pixel_count();
    let transmittance = frame.transmittance();
    let mut out = frame.image.values[..3 * size].to_vec();
    for (plane, background) in out.chunks_mut(size.max(1)).zip(background) {
        plane.iter_mut().zip(transmittance).for_each(|(color, passed)| *color += passed * background);
    }
    out
}

/// Gradient of the transmittance through the background.
fn background_vjp(grad: &mut [f32], size: usize, background: [f32; 3]) {
    let (channels, last) = grad.split_at_mut(grad.len() - size);
    for (plane, background) in channels.chunks(size.max(1)).zip(background) {
        last.iter_mut().zip(plane).for_each(|(sum, grad)| *sum += grad * background);
    }
}

fn color_loss(rendered: &[f32], truth: &[f32], weights: &LossWeights, grad: &mut [f32], report: &mut LossReport) {
    const AT_ONCE: usize = 16384;
    let share = 1.0 / rendered.len() as f32;
    let sums: Vec<[f64; 2]> = grad
        .par_chunks_mut(AT_ONCE)
        .zip(rendered.par_chunks(AT_ONCE).zip(truth.par_chunks(AT_ONCE)))
        .map(|(grad, (rendered, truth))| {
            let mut sum = [0.0; 2];
            for ((grad, x), y) in grad.iter_mut().zip(rendered).zip(truth) {
                sum[0] += f64::from(absolute(*x, *y));
                sum[1] += f64::from(squared(*x, *y));
                *grad = absolute_vjp(*x, *y, weights.absolute * share) + squared_vjp(*x, *y, weights.squared * share);
            }
            sum
        })
        .collect();
    let total = |k: usize| sums.iter().map(|sum| sum[k]).sum::<f64>() * f64::from(share);
    report.absolute = total(0);
    report.squared = total(1);
}

/// Size of a plane.
#[derive(Clone, Copy)]
struct Plane {
    width: usize,
    height: usize,
}

/// Half of SSIM's window.
const REACH: usize = SSIM_WINDOW / 2;

/// Mean SSIM of three planes; adds the gradient of `weight` · (1 − SSIM).
fn structure_loss(level: Level, plane: Plane, rendered: &[f32], truth: &[f32], weight: f32, grad: &mut [f32]) -> f64 {
    let size = plane.width * plane.height;
    let share = weight / rendered.len() as f32;
    let mut partials = vec![0.0; 3 * rendered.len()];
    let sums: Vec<f64> = partials
        .par_chunks_mut(3 * size)
        .zip(rendered.par_chunks(size).zip(truth.par_chunks(size)))
        .map(|(partials, (x, y))| ssim_plane(level, plane, x, y, Some((partials, -share))))
        .collect();

    let inputs = rendered.par_chunks(size).zip(truth.par_chunks(size));
    grad.par_chunks_mut(size).zip(partials.par_chunks(3 * size)).zip(inputs).for_each(|((grad, partials), (x, y))| {
        let rows = grad.par_chunks_mut(ROWS_AT_ONCE * plane.width).enumerate();
        rows.for_each(|(band, grad)| {
            let maps = [0, 1, 2].map(|k| &partials[k * size..(k + 1) * size]);
            let blurred = blur_maps(level, plane, band * ROWS_AT_ONCE, &maps);
            let start = band * ROWS_AT_ONCE * plane.width;
            for (k, grad) in grad.iter_mut().enumerate() {
                *grad += blurred[0][k] + 2.0 * x[start + k] * blurred[1][k] + y[start + k] * blurred[2][k];
            }
        });
    });
    sums.iter().sum::<f64>() / rendered.len() as f64
}

/// Sum of SSIM over a plane; if asked, the gradients of E\[x\], E\[x²\] and E\[xy\] of every pixel, times a factor.
fn ssim_plane(level: Level, plane: Plane, x: &[f32], y: &[f32], grads: Option<(&mut [f32], f32)>) -> f64 {
    let size = plane.width * plane.height;
    let products = products(x, y);
    let maps = [x, y, &products[..size], &products[size..2 * size], &products[2 * size..]];
    let band_len = ROWS_AT_ONCE * plane.width;
    let one_band = |band: usize, grads: Option<[&mut [f32]; 3]>, factor: f32| {
        let blurred = blur_maps(level, plane, band * ROWS_AT_ONCE, &maps);
        dispatch!(level, simd => ssim_band(simd, &blurred, grads, factor))
    };
    let sums: Vec<f64> = match grads {
        None => (0..size.div_ceil(band_len)).into_par_iter().map(|band| one_band(band, None, 0.0)).collect(),
        Some((grads, factor)) => {
            let (first, rest) = grads.split_at_mut(size);
            let (second, third) = rest.split_at_mut(size);
            let bands = first.par_chunks_mut(band_len).zip(second.par_chunks_mut(band_len));
            bands
                .zip(third.par_chunks_mut(band_len))
                .enumerate()
                .map(|(band, ((a, b), c))| one_band(band, Some([a, b, c]), factor))
                .collect()
        }
    };
    sums.iter().sum()
}

/// x², y² and xy of every pixel.
fn products(x: &[f32], y: &[f32]) -> Vec<f32> {
    const AT_ONCE: usize = 4096;
    let size = x.len();
    let mut products = vec![0.0; 3 * size];
    for (plane, factors) in products.chunks_mut(size.max(1)).zip([(x, x), (y, y), (x, y)]) {
        let inputs = factors.0.par_chunks(AT_ONCE).zip(factors.1.par_chunks(AT_ONCE));
        plane.par_chunks_mut(AT_ONCE).zip(inputs).for_each(|(out, (a, b))| {
            out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| *out = a * b);
        });
    }
    products
}

/// Sum of SSIM over a band of blurred rows; if asked, the gradients of E\[x\], E\[x²\] and E\[xy\].
#[inline(always)]
fn ssim_band<S: Simd>(simd: S, blurred: &[Vec<f32>; 5], mut grads: Option<[&mut [f32]; 3]>, factor: f32) -> f64 {
    let mut sum = 0.0;
    let len = blurred[0].len();
    let mut start = 0;
    while start < len {
        let count = BLOCK.min(len - start);
        let at = |k: usize| load_some(simd, &blurred[k][start..], count);
        let moments = SsimMoments { x: at(0), y: at(1), xx: at(2), yy: at(3), xy: at(4) };
        let values = ssim(&moments);
        sum += if count == BLOCK {
            f64::from(values.sum())
        } else {
            values.to_array()[..count].iter().map(|value| f64::from(*value)).sum()
        };
        if let Some(grads) = &mut grads {
            let [x, xx, xy] = ssim_vjp(&moments, Lanes::splat(simd, factor));
            store_some(x, &mut grads[0][start..], count);
            store_some(xx, &mut grads[1][start..], count);
            store_some(xy, &mut grads[2][start..], count);
        }
        start += count;
    }
    sum
}

/// Up to sixteen rows of each map, blurred by SSIM's window.
fn blur_maps<const N: usize>(level: Level, plane: Plane, first_row: usize, maps: &[&[f32]; N]) -> [Vec<f32>; N] {
    maps.map(|map| dispatch!(level, simd => blur_band(simd, plane, first_row, map)))
}

/// Up to sixteen rows of a map, blurred by SSIM's window; beyond the border everything is zero.
#[inline(always)]
fn blur_band<S: Simd>(simd: S, plane: Plane, first_row: usize, map: &[f32]) -> Vec<f32> {
    let window = ssim_window();
    let rows = ROWS_AT_ONCE.min(plane.height - first_row);
    let padded_width = plane.width.next_multiple_of(BLOCK);
    let above = REACH.min(first_row);
    let below = REACH.min(plane.height - first_row - rows);

    let mut line = vec![0.0; padded_width + 2 * REACH];
    let mut across = vec![0.0; (above + rows + below) * padded_width];
    for (row, out) in across.chunks_exact_mut(padded_width).enumerate() {
        let from = (first_row - above + row) * plane.width;
        line[REACH..REACH + plane.width].copy_from_slice(&map[from..from + plane.width]);
        blur_line(simd, &line, &window, out);
    }
    let mut out = vec![0.0; rows * plane.width];
    let mut wide = vec![0.0; padded_width];
    for (row, out) in out.chunks_exact_mut(plane.width).enumerate() {
        blur_down(simd, &across, padded_width, row + above, &window, &mut wide);
        out.copy_from_slice(&wide[..plane.width]);
    }
    out
}

#[inline(always)]
fn blur_line<S: Simd>(simd: S, line: &[f32], window: &[f32; SSIM_WINDOW], out: &mut [f32]) {
    for (k, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let mut sum = Lanes::splat(simd, 0.0);
        for (tap, weight) in window.iter().enumerate() {
            sum = Lanes::load(simd, &line[k * BLOCK + tap..]).mul_add(Lanes::splat(simd, *weight), sum);
        }
        sum.store(out);
    }
}

#[inline(always)]
fn blur_down<S: Simd>(simd: S, lines: &[f32], width: usize, row: usize, window: &[f32; SSIM_WINDOW], out: &mut [f32]) {
    let height = lines.len() / width;
    let first = row.saturating_sub(REACH);
    let last = (row + REACH).min(height - 1);
    for (k, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let mut sum = Lanes::splat(simd, 0.0);
        for line in first..=last {
            let weight = Lanes::splat(simd, window[line + REACH - row]);
            sum = Lanes::load(simd, &lines[line * width + k * BLOCK..]).mul_add(weight, sum);
        }
        sum.store(out);
    }
}

/// Mean |A − A_gt|; adds its gradient to that of the transmittance.
fn coverage_loss(frame: &Frame, truth: &[f32], weight: f32, grad: &mut [f32]) -> f64 {
    let size = truth.len();
    let start = grad.len() - size;
    let share = weight / size as f32;
    let mut sum = 0.0;
    for ((grad, passed), alpha) in grad[start..].iter_mut().zip(frame.transmittance()).zip(truth) {
        let coverage = 1.0 - passed;
        sum += f64::from(absolute(coverage, *alpha));
        *grad -= absolute_vjp(coverage, *alpha, share);
    }
    sum / size as f64
}

/// Coverage below which a pixel has no surface.
const SURFACE_COVERAGE: f32 = 0.5;

/// Normals against depth, size of residuals, sparseness of coverage.
fn geometry_loss(
    level: Level,
    frame: &Frame,
    camera: &Camera,
    weights: &LossWeights,
    grad: &mut [f32],
    report: &mut LossReport,
) {
    let image = &frame.image;
    let size = image.pixel_count();
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
    if weights.normal != 0.0 && image.width > 2 && image.height > 2 {
        report.normal = normal_loss(level, frame, camera, weights, grad);
    }
}

/// What a pixel's normal loss leaves for its neighbours: gradients of the depths to the left, right, above, below.
struct NormalPlanes {
    /// Gradients of the rendered normal, three planes, then of the four depths.
    planes: Vec<f32>,
}

fn normal_loss(level: Level, frame: &Frame, camera: &Camera, weights: &LossWeights, grad: &mut [f32]) -> f64 {
    let (width, size) = (frame.image.width, frame.image.pixel_count());
    let coverage: Vec<f32> = frame.transmittance().iter().map(|passed| 1.0 - passed).collect();
    let depth: Vec<f32> = frame
        .image
        .plane(channel::DEPTH)
        .iter()
        .zip(&coverage)
        .map(|(blended, a)| if *a > SURFACE_COVERAGE { expected_depth(*blended, *a) } else { 0.0 })
        .collect();

    let mut own = NormalPlanes { planes: vec![0.0; 7 * size] };
    let mut rows = bands(&mut own.planes, size, width);
    let last = frame.image.height - 1;
    let sums: Vec<f64> = rows
        .par_iter_mut()
        .enumerate()
        .filter(|(row, _)| *row > 0 && *row < last)
        .map(|(row, out)| {
            dispatch!(level, simd => normal_row(simd, frame, camera, weights, &coverage, &depth, row, out))
        })
        .collect();
    gather_normal_grads(&own, width, &coverage, &depth, grad);
    sums.iter().sum::<f64>() / size as f64
}

#[inline(always)]
fn normal_row<S: Simd>(
    simd: S,
    frame: &Frame,
    camera: &Camera,
    weights: &LossWeights,
    coverage: &[f32],
    depth: &[f32],
    row: usize,
    out: &mut [&mut [f32]],
) -> f64 {
    let width = frame.image.width;
    let rotation = Mat3::constant(Lanes::splat(simd, 0.0), camera.camera_from_world);
    let mut sum = 0.0;
    let mut start = 1;
    while start < width - 1 {
        let count = BLOCK.min(width - 1 - start);
        let at = |plane: &[f32], index: usize| load_some(simd, &plane[index..], count);
        let index = row * width + start;
        let cross = |plane: &[f32]| Cross {
            left: at(plane, index - 1),
            right: at(plane, index + 1),
            above: at(plane, index - width),
            below: at(plane, index + width),
        };
        let (a, around) = (at(coverage, index), cross(coverage));
        let least = a.min(around.left.min(around.right)).min(around.above.min(around.below));
        let weight = a.keep(a.constant(SURFACE_COVERAGE).less(least));
        if weight.any_positive() {
            let rays = rays_around(simd, camera, start, row);
            let depths = cross(depth);
            let geometric = rotation.transform_transposed(normal(&rays, &depths));
            let plane = |c: usize| at(frame.image.plane(channel::NORMAL + c), index);
            let rendered = vec3(plane(0), plane(1), plane(2));
            let weight_grad = weight * (weights.normal / coverage.len() as f32);
            let (value, grad_rendered, grad_geometric) =
                compare_normals(weights.normal_form, rendered, geometric * a, a, weight_grad);
            let is_on = weight.zero().less(weight);
            sum += f64::from((value * weight).keep(is_on).sum());
            let grad_depths = normal_vjp(&rays, &depths, rotation.transform(grad_geometric * a));
            let all = [
                grad_rendered.x,
                grad_rendered.y,
                grad_rendered.z,
                grad_depths.left,
                grad_depths.right,
                grad_depths.above,
                grad_depths.below,
            ];
            for (plane, value) in out.iter_mut().zip(all) {
                plane[start..start + count].copy_from_slice(&value.keep(is_on).to_array()[..count]);
            }
        }
        start += count;
    }
    sum
}

/// Value of the normal loss and its gradients with respect to the rendered normal and the geometric one, both
/// premultiplied by coverage.
#[inline(always)]
fn compare_normals<R: Real>(
    form: NormalForm,
    rendered: Vec3<R>,
    geometric: Vec3<R>,
    coverage: R,
    grad: R,
) -> (R, Vec3<R>, Vec3<R>) {
    match form {
        NormalForm::Distance => {
            let grad_rendered = normal_distance_vjp(rendered, geometric, grad);
            (normal_distance(rendered, geometric), grad_rendered, -grad_rendered)
        }
        NormalForm::Cosine | NormalForm::CosineDetached => {
            let unit = geometric / coverage;
            let (grad_rendered, grad_unit) = normal_cosine_vjp(rendered, unit, grad);
            let kept = if form == NormalForm::Cosine { grad_unit / coverage } else { Vec3::zero(grad) };
            (normal_cosine(rendered, unit), grad_rendered, kept)
        }
    }
}

/// Camera-space rays through the neighbours of sixteen pixels of a row.
#[inline(always)]
fn rays_around<S: Simd>(simd: S, camera: &Camera, column: usize, row: usize) -> Cross<Vec3<Lanes<S>>> {
    let one = Lanes::splat(simd, 1.0);
    let x = Lanes::from_array(simd, core::array::from_fn(|lane| (column + lane) as f32 + 0.5));
    let y = one * (row as f32 + 0.5);
    let ray = |x: Lanes<S>, y: Lanes<S>| {
        vec3((x - camera.principal_px[0]) / camera.focal_px[0], (y - camera.principal_px[1]) / camera.focal_px[1], one)
    };
    Cross { left: ray(x - 1.0, y), right: ray(x + 1.0, y), above: ray(x, y - 1.0), below: ray(x, y + 1.0) }
}

/// Each pixel gathers what its neighbours left for its depth, and passes it on to blended depth and coverage.
fn gather_normal_grads(own: &NormalPlanes, width: usize, coverage: &[f32], depth: &[f32], grad: &mut [f32]) {
    let size = coverage.len();
    let plane = |k: usize| &own.planes[k * size..(k + 1) * size];
    let (from_right, from_left, from_below, from_above) = (plane(3), plane(4), plane(5), plane(6));
    let at = |plane: &[f32], index: Option<usize>| index.and_then(|index| plane.get(index)).copied().unwrap_or(0.0);
    let (channels, last) = grad.split_at_mut(grad.len() - size);
    for k in 0..3 {
        let start = (channel::NORMAL + k) * size;
        channels[start..start + size].iter_mut().zip(plane(k)).for_each(|(sum, grad)| *sum += grad);
    }
    let depth_plane = &mut channels[channel::DEPTH * size..(channel::DEPTH + 1) * size];
    depth_plane.par_iter_mut().zip(last).enumerate().with_min_len(4096).for_each(
        |(index, (grad_blended, grad_passed))| {
            if coverage[index] <= SURFACE_COVERAGE {
                return;
            }
            let grad = at(from_right, Some(index + 1))
                + at(from_left, index.checked_sub(1))
                + at(from_below, Some(index + width))
                + at(from_above, index.checked_sub(width));
            let (blended, covered) = expected_depth_vjp(depth[index], coverage[index], grad);
            *grad_blended += blended;
            *grad_passed -= covered;
        },
    );
}
