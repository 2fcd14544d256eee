//! Rendered normals against those of the depth.

use super::{Comparison, SURFACE_COVERAGE, add_to_row, plane, row_of_tile};
use crate::{
    frame::{Frame, Quad, SIZE, tile_len},
    lanes::Lanes,
    parts::Pieces,
    planes::{CENTER, Planes, Row, WideRow, place_in_row},
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    depth_normal::{Cross, expected_depth_vjp, normal, normal_vjp},
    loss::{NormalForm, normal_cosine, normal_cosine_vjp, normal_distance, normal_distance_vjp},
    plan::channel,
    real::Real,
    scene::BLOCK,
    vector::{Mat3, Vec3, vec3},
};

/// Rows that the pixels of a tile and their neighbours lie in.
const ROWS: usize = SIZE + 2;

/// Mean normal loss of a picture; adds its gradient.
pub(super) fn normal_loss(comparison: &Comparison<'_>, planes: &Planes, grad: &mut [Quad]) -> f64 {
    let Comparison { machine, frame, .. } = comparison;
    let cover = &frame.cover;
    let len = tile_len(frame.channels);
    // Gradients of the depths to the left, right, above and below of each pixel.
    let mut of_neighbours = Planes::new(machine, [cover.columns, cover.rows], 4);
    let (rows, rows_of) = of_neighbours.parts();
    let grad_of = comparison.grad_starts();
    let parts = (Pieces::new(grad, &grad_of), Pieces::new(rows, &rows_of));
    let [sum, ..] = comparison.each_tile_row(parts, |row, (grad, rows)| {
        let rows = rows.only();
        let slots = cover.before_row(row)..;
        let sums = slots.zip(grad.only().chunks_exact_mut(len)).map(
            |(slot, grad)| dispatch!(machine.level, simd => compare_tile(simd, comparison, planes, slot, grad, rows)),
        );
        [sums.sum(), 0.0, 0.0, 0.0]
    });
    grad.par_chunks_mut(len).enumerate().for_each(|(slot, tile)| {
        dispatch!(machine.level, simd => gather(simd, comparison, planes, &of_neighbours, slot, tile));
    });
    sum / comparison.pixel_count() as f64
}

/// The neighbours of the pixels of a row.
#[inline(always)]
fn cross<S: Simd>(simd: S, window: &[WideRow; ROWS], row: usize) -> Cross<Lanes<S>> {
    let at = |row: usize, start: usize| Lanes::load(simd, &window[row][start..]);
    Cross {
        left: at(row + 1, CENTER - 1),
        right: at(row + 1, CENTER + 1),
        above: at(row, CENTER),
        below: at(row + 2, CENTER),
    }
}

/// Sum of the normal loss over a tile; adds the gradients of its normals, and leaves those of its neighbours' depths.
#[inline(always)]
fn compare_tile<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    planes: &Planes,
    slot: usize,
    grad: &mut [Quad],
    out: &mut [Row],
) -> f64 {
    let Comparison { frame, camera, weights, .. } = comparison;
    let rotation = Mat3::constant(Lanes::splat(simd, 0.0), camera.camera_from_world);
    let place = frame.cover.place(slot);
    let is_covered = |tile: usize| frame.cover.slot(tile).is_some();
    let mut windows = [[[0.0; 2 * SIZE]; ROWS]; 2];
    let [coverages, all_depths] = &mut windows;
    planes.read_window(place, plane::COVERAGE, is_covered, coverages);
    planes.read_window(place, plane::DEPTH, is_covered, all_depths);
    let mut sum = Lanes::splat(simd, 0.0);
    for row in 0..SIZE {
        let a = Lanes::load(simd, &coverages[row + 1][CENTER..]);
        let around = cross(simd, coverages, row);
        let least = a.min(around.left.min(around.right)).min(around.above.min(around.below));
        let weight = a.keep(a.constant(SURFACE_COVERAGE).less(least));
        let mut grad_depths = [a.zero(); 4];
        if weight.any_positive() {
            let is_on = weight.zero().less(weight);
            let rays = rays_around(simd, camera, place[0] * SIZE, place[1] * SIZE + row);
            let depths = cross(simd, all_depths, row);
            let geometric = rotation.transform_transposed(normal(&rays, &depths));
            let plane = |c: usize| {
                Lanes::from_array(simd, row_of_tile(frame.tile(slot), frame.channels, channel::NORMAL + c, row))
            };
            let rendered = vec3(plane(0), plane(1), plane(2));
            let weight_grad = weight * (weights.normal / comparison.pixel_count() as f32);
            let (value, grad_rendered, grad_geometric) =
                compare_normals(weights.normal_form, rendered, geometric * a, a, weight_grad);
            sum = sum + (value * weight).keep(is_on);
            let of_depths = normal_vjp(&rays, &depths, rotation.transform(grad_geometric * a));
            grad_depths = [
                of_depths.left.keep(is_on),
                of_depths.right.keep(is_on),
                of_depths.above.keep(is_on),
                of_depths.below.keep(is_on),
            ];
            for (c, lanes) in [grad_rendered.x, grad_rendered.y, grad_rendered.z].into_iter().enumerate() {
                add_to_row(grad, frame.channels, channel::NORMAL + c, row, &lanes.keep(is_on).to_array());
            }
        }
        for (plane, lanes) in grad_depths.into_iter().enumerate() {
            lanes.store(&mut out[place_in_row(frame.cover.columns, plane, place[0]) + row]);
        }
    }
    f64::from(sum.sum())
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
    const LANES: [f32; BLOCK] = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5, 10.5, 11.5, 12.5, 13.5, 14.5, 15.5];
    let one = Lanes::splat(simd, 1.0);
    let x = Lanes::from_array(simd, LANES) + column as f32;
    let y = one * (row as f32 + 0.5);
    let ray = |x: Lanes<S>, y: Lanes<S>| {
        vec3((x - camera.principal_px[0]) / camera.focal_px[0], (y - camera.principal_px[1]) / camera.focal_px[1], one)
    };
    Cross { left: ray(x - 1.0, y), right: ray(x + 1.0, y), above: ray(x, y - 1.0), below: ray(x, y + 1.0) }
}

/// The pixels of a tile gather what their neighbours left for their depths, and pass it on to blended depth and
/// coverage.
#[inline(always)]
fn gather<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    planes: &Planes,
    of_neighbours: &Planes,
    slot: usize,
    grad: &mut [Quad],
) {
    let Frame { cover, channels, .. } = comparison.frame;
    let place = cover.place(slot);
    let mut windows = [[[0.0; 2 * SIZE]; ROWS]; 4];
    for (plane, window) in windows.iter_mut().enumerate() {
        of_neighbours.read_window(place, plane, |tile| cover.slot(tile).is_some(), window);
    }
    let [left, right, above, below] = &windows;
    let (coverage, depth) = (planes.plane(place, plane::COVERAGE), planes.plane(place, plane::DEPTH));
    for row in 0..SIZE {
        // What a pixel left for its left neighbour lies one to the right of that neighbour, and so on.
        let grad_depth = (cross(simd, left, row).right + cross(simd, right, row).left)
            + (cross(simd, above, row).below + cross(simd, below, row).above);
        let (depth, coverage) = (Lanes::load(simd, &depth[row]), Lanes::load(simd, &coverage[row]));
        let is_surface = coverage.constant(SURFACE_COVERAGE).less(coverage);
        let (blended, covered) = expected_depth_vjp(depth, coverage, grad_depth);
        add_to_row(grad, *channels, channel::DEPTH, row, &blended.keep(is_surface).to_array());
        add_to_row(grad, *channels, *channels, row, &(-covered).keep(is_surface).to_array());
    }
}
