//! Rendered normals against those of the depth.

use crate::{
    blend::{Frame, bands},
    lanes::{Lanes, load_some, store_some},
};
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    depth_normal::{Cross, expected_depth, expected_depth_vjp, normal, normal_vjp},
    loss::{LossWeights, NormalForm, normal_cosine, normal_cosine_vjp, normal_distance, normal_distance_vjp},
    plan::channel,
    real::Real,
    scene::BLOCK,
    vector::{Mat3, Vec3, vec3},
};

/// Coverage below which a pixel has no surface.
const SURFACE_COVERAGE: f32 = 0.5;

/// Mean normal loss of a picture; adds its gradient.
pub(super) fn normal_loss(
    level: Level,
    frame: &Frame,
    camera: &Camera,
    weights: &LossWeights,
    grad: &mut [f32],
) -> f64 {
    let (width, height) = (frame.image.width, frame.image.height);
    let geometry = Geometry::new(frame);
    // Gradients of the rendered normal, then of the depths to the left, right, above and below of each pixel, with a
    // row of zeros before the first and one behind the last.
    let padded_size = (height + 2) * width;
    let mut own = vec![0.0; 7 * padded_size];
    let sums: Vec<f64> = bands(&mut own, padded_size, width)
        .par_iter_mut()
        .enumerate()
        .filter(|(row, _)| *row > 1 && *row < height)
        .map(|(row, out)| dispatch!(level, simd => normal_row(simd, frame, camera, weights, &geometry, row - 1, out)))
        .collect();
    bands(grad, width * height, width).par_iter_mut().enumerate().for_each(|(row, grad)| {
        dispatch!(level, simd => gather_row(simd, &own, padded_size, &geometry, row, grad));
    });
    sums.iter().sum::<f64>() / (width * height) as f64
}

/// Where a picture has surfaces, and how far they are.
struct Geometry {
    coverage: Vec<f32>,
    /// Zero where nothing is.
    depth: Vec<f32>,
}

impl Geometry {
    fn new(frame: &Frame) -> Self {
        let coverage: Vec<f32> = frame.transmittance().iter().map(|passed| 1.0 - passed).collect();
        let depth = |(blended, a): (&f32, &f32)| if *a > SURFACE_COVERAGE { expected_depth(*blended, *a) } else { 0.0 };
        let depth = frame.image.plane(channel::DEPTH).iter().zip(&coverage).map(depth).collect();
        Self { coverage, depth }
    }
}

#[inline(always)]
fn normal_row<S: Simd>(
    simd: S,
    frame: &Frame,
    camera: &Camera,
    weights: &LossWeights,
    geometry: &Geometry,
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
        let (a, around) = (at(&geometry.coverage, index), cross(&geometry.coverage));
        let least = a.min(around.left.min(around.right)).min(around.above.min(around.below));
        let weight = a.keep(a.constant(SURFACE_COVERAGE).less(least));
        if weight.any_positive() {
            let rays = rays_around(simd, camera, start, row);
            let depths = cross(&geometry.depth);
            let geometric = rotation.transform_transposed(normal(&rays, &depths));
            let plane = |c: usize| at(frame.image.plane(channel::NORMAL + c), index);
            let rendered = vec3(plane(0), plane(1), plane(2));
            let weight_grad = weight * (weights.normal / geometry.coverage.len() as f32);
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

/// The pixels of a row gather what their neighbours left for their depths, and pass it on to blended depth and coverage.
#[inline(always)]
fn gather_row<S: Simd>(
    simd: S,
    own: &[f32],
    padded_size: usize,
    geometry: &Geometry,
    row: usize,
    grad: &mut [&mut [f32]],
) {
    let width = grad[0].len();
    let last = grad.len() - 1;
    for start in (0..width).step_by(BLOCK) {
        let count = BLOCK.min(width - start);
        let (index, padded) = (row * width + start, (row + 1) * width + start);
        let left_by = |plane: usize, pixel: usize| load_some(simd, &own[plane * padded_size + pixel..], count);
        for k in 0..3 {
            let plane = &mut grad[channel::NORMAL + k][start..];
            store_some(load_some(simd, plane, count) + left_by(k, padded), plane, count);
        }
        let grad_depth = (left_by(3, padded + 1) + left_by(4, padded - 1))
            + (left_by(5, padded + width) + left_by(6, padded - width));
        let at = |values: &[f32]| load_some(simd, &values[index..], count);
        let (depth, coverage) = (at(&geometry.depth), at(&geometry.coverage));
        let is_surface = coverage.constant(SURFACE_COVERAGE).less(coverage);
        let (blended, covered) = expected_depth_vjp(depth, coverage, grad_depth);
        let plane = &mut grad[channel::DEPTH][start..];
        store_some(load_some(simd, plane, count) + blended.keep(is_surface), plane, count);
        let plane = &mut grad[last][start..];
        store_some(load_some(simd, plane, count) - covered.keep(is_surface), plane, count);
    }
}
