//! Rendered normals against those of the depth.

use super::comparison::{Comparison, add_to_row, plane, row_of_tile};
use crate::{
    frame::{Frame, Quad, SIZE, tile_len},
    lanes::Lanes,
    parts::Pieces,
    planes::{CENTER, Planes, Row, WideRow, plane_start},
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    depth_normal::{Cross, expected_depth_vjp, is_surface, rays_around, surface_weight},
    loss::{NormalPatch, normal_loss as loss_of_normal},
    real::Real,
    rules::channel,
    scene::BLOCK,
    vector::vec3,
};

/// Rows of the pixels of a tile and their neighbours.
const ROWS: usize = SIZE + 2;

/// Mean normal loss of a picture; adds its gradient.
pub(super) fn normal_loss(comparison: &Comparison<'_>, planes: &Planes, grad: &mut [Quad]) -> f64 {
    let Comparison { context, frame, .. } = comparison;
    let cover = &frame.cover;
    let len = tile_len(frame.channels);
    // Gradients of the depths to the left, right, above and below of each pixel.
    let mut grad_neighbours = Planes::new(context, [cover.columns, cover.rows], 4);
    let (rows, rows_of) = grad_neighbours.parts();
    let grad_of = comparison.grad_starts();
    let parts = (Pieces::new(grad, &grad_of), Pieces::new(rows, &rows_of));
    let [sum, ..] = comparison.each_tile_row(parts, |row, (grad, rows)| {
        let rows = rows.only();
        let slots = cover.before_row(row)..;
        let sums = slots.zip(grad.only().chunks_exact_mut(len)).map(
            |(slot, grad)| dispatch!(context.level, simd => compare_tile(simd, comparison, planes, slot, grad, rows)),
        );
        [sums.sum(), 0.0, 0.0, 0.0]
    });
    grad.par_chunks_mut(len).enumerate().for_each(|(slot, tile)| {
        dispatch!(context.level, simd => gather(simd, comparison, planes, &grad_neighbours, slot, tile));
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

/// Sum of the normal loss over a tile; adds the gradients of its normals, and stores those of its
/// neighbours' depths.
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
    let camera = camera.lift(Lanes::splat(simd, 0.0));
    let position = frame.cover.tile_position(slot);
    let is_covered = |tile: usize| frame.cover.slot(tile).is_some();
    let mut windows = [[[0.0; 2 * SIZE]; ROWS]; 2];
    let [coverages, all_depths] = &mut windows;
    planes.read_window(position, plane::COVERAGE, is_covered, coverages);
    planes.read_window(position, plane::DEPTH, is_covered, all_depths);
    let mut sum = Lanes::splat(simd, 0.0);
    for row in 0..SIZE {
        let a = Lanes::load(simd, &coverages[row + 1][CENTER..]);
        let weight = surface_weight(a, &cross(simd, coverages, row));
        let mut grad_depths = [a.zero(); 4];
        if weight.any_positive() {
            let is_on = weight.zero().less(weight);
            let plane = |c: usize| {
                Lanes::from_array(simd, row_of_tile(frame.tile(slot), frame.channels, channel::NORMAL + c, row))
            };
            let [x, y] = centres(simd, position, row);
            let patch = NormalPatch {
                rays: rays_around(&camera, x, y),
                depths: cross(simd, all_depths, row),
                rendered: vec3(plane(0), plane(1), plane(2)),
                coverage: a,
            };
            let weight_grad = weight * (weights.normal / comparison.pixel_count() as f32);
            let (value, grad_rendered, grad_cross) =
                loss_of_normal(weights.normal_form, &camera.camera_from_world, &patch, weight_grad);
            sum = sum + (value * weight).keep(is_on);
            grad_depths = [
                grad_cross.left.keep(is_on),
                grad_cross.right.keep(is_on),
                grad_cross.above.keep(is_on),
                grad_cross.below.keep(is_on),
            ];
            for (c, lanes) in [grad_rendered.x, grad_rendered.y, grad_rendered.z].into_iter().enumerate() {
                add_to_row(grad, frame.channels, channel::NORMAL + c, row, &lanes.keep(is_on).to_array());
            }
        }
        for (plane, lanes) in grad_depths.into_iter().enumerate() {
            lanes.store(&mut out[plane_start(frame.cover.columns, plane, position[0]) + row]);
        }
    }
    f64::from(sum.sum())
}

/// Centres of sixteen pixels of a row of a tile.
#[inline(always)]
pub(super) fn centres<S: Simd>(simd: S, position: [usize; 2], row: usize) -> [Lanes<S>; 2] {
    const LANES: [f32; BLOCK] = [0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5, 10.5, 11.5, 12.5, 13.5, 14.5, 15.5];
    let x = Lanes::from_array(simd, LANES) + (position[0] * SIZE) as f32;
    [x, Lanes::splat(simd, (position[1] * SIZE + row) as f32 + 0.5)]
}

/// Gathers the gradients of a tile's depths from its pixels' neighbours, and propagates them to
/// blended depth and coverage.
#[inline(always)]
fn gather<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    planes: &Planes,
    grad_neighbours: &Planes,
    slot: usize,
    grad: &mut [Quad],
) {
    let Frame { cover, channels, .. } = comparison.frame;
    let position = cover.tile_position(slot);
    let mut windows = [[[0.0; 2 * SIZE]; ROWS]; 4];
    for (plane, window) in windows.iter_mut().enumerate() {
        grad_neighbours.read_window(position, plane, |tile| cover.slot(tile).is_some(), window);
    }
    let [left, right, above, below] = &windows;
    let (coverage, depth) = (planes.plane(position, plane::COVERAGE), planes.plane(position, plane::DEPTH));
    for row in 0..SIZE {
        // The contribution of a pixel to its left neighbour is stored one to the right of that
        // neighbour; likewise in the other directions.
        let grad_depth = (cross(simd, left, row).right + cross(simd, right, row).left)
            + (cross(simd, above, row).below + cross(simd, below, row).above);
        let (depth, coverage) = (Lanes::load(simd, &depth[row]), Lanes::load(simd, &coverage[row]));
        let is_surface = is_surface(coverage);
        let (blended, covered) = expected_depth_vjp(depth, coverage, grad_depth);
        add_to_row(grad, *channels, channel::DEPTH, row, &blended.keep(is_surface).to_array());
        add_to_row(grad, *channels, *channels, row, &(-covered).keep(is_surface).to_array());
    }
}
