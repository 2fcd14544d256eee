//! Smoothness of rendered normals between creases.

use super::{
    comparison::{Comparison, add_to_row, plane, row_of_quads, row_of_tile},
    normals::centres,
};
use crate::{
    frame::{Frame, Quad, SIZE, tile_len},
    lanes::Lanes,
    parts::Pieces,
    planes::{CENTER, Planes, Row, WideRow, plane_start},
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    camera::CameraOf,
    depth_normal::is_surface,
    real::Real,
    rules::{Channels, channel},
    shade_pixels::unlit_pixel_color,
    smoothness::{
        BLUR_REACH, CREASE_REACH, Line, REACHES, bending, bending_vjp, blurred_normal, evenness, gloss, unit_normal,
        unit_normal_vjp,
    },
    vector::{Vec3, vec3},
};

/// Distance in pixels of the farthest neighbour in the comparison of normals.
const REACH: usize = REACHES[1];
/// Distance in pixels of the farthest normal that affects a weight.
const WEIGHT_REACH: usize = CREASE_REACH + BLUR_REACH;
/// Rows around a tile for weights.
const WEIGHT_ROWS: usize = SIZE + 2 * WEIGHT_REACH;
/// Rows around a tile for gradients, to the far ends of lines that end in the tile.
const GRAD_ROWS: usize = SIZE + 4 * REACH;
/// Rows of the centres of blurred normals.
const BLURRED_ROWS: usize = WEIGHT_ROWS - 2 * BLUR_REACH;

const _: () = assert!(2 * REACH <= CENTER && WEIGHT_REACH <= CENTER, "windows reach half a tile");
const _: () = assert!(REACHES[0] < REACH && REACH <= WEIGHT_REACH, "the far reach is the largest");

/// Windows of the three components of vectors.
type Windows<const ROWS: usize> = [[WideRow; ROWS]; 3];

/// Mean loss of a picture; adds its gradient.
pub(super) fn smoothness_loss(comparison: &Comparison<'_>, planes: &Planes, grad: &mut [Quad]) -> f64 {
    let Comparison { context, frame, .. } = comparison;
    let cover = &frame.cover;
    let len = tile_len(frame.channels);
    let mut normals = Planes::new(context, [cover.columns, cover.rows], 3);
    let (rows, rows_of) = normals.parts();
    comparison.each_tile_row(Pieces::new(rows, &rows_of), |row, rows| {
        let rows = rows.only();
        for slot in cover.before_row(row)..cover.before_row(row + 1) {
            dispatch!(context.level, simd => write_normals(simd, frame, planes, slot, rows));
        }
        [0.0; 4]
    });
    let mut weights = Planes::new(context, [cover.columns, cover.rows], 1);
    let (rows, rows_of) = weights.parts();
    let [sum, ..] = comparison.each_tile_row(Pieces::new(rows, &rows_of), |row, rows| {
        let rows = rows.only();
        let mut sum = 0.0;
        for slot in cover.before_row(row)..cover.before_row(row + 1) {
            sum += dispatch!(context.level, simd => weigh_tile(simd, comparison, &normals, slot, rows));
        }
        [sum, 0.0, 0.0, 0.0]
    });
    grad.par_chunks_mut(len).enumerate().for_each(|(slot, tile)| {
        dispatch!(context.level, simd => gather(simd, comparison, planes, &normals, &weights, slot, tile));
    });
    sum / comparison.pixel_count() as f64
}

/// Writes the unit normals of a tile.
#[inline(always)]
fn write_normals<S: Simd>(simd: S, frame: &Frame, planes: &Planes, slot: usize, out: &mut [Row]) {
    let position = frame.cover.tile_position(slot);
    for row in 0..SIZE {
        let coverage = Lanes::load(simd, &planes.plane(position, plane::COVERAGE)[row]);
        let normal = unit_normal(blended_normal(simd, frame, slot, row), is_surface(coverage));
        for (component, lanes) in normal.to_array().into_iter().enumerate() {
            lanes.store(&mut out[plane_start(frame.cover.columns, component, position[0]) + row]);
        }
    }
}

#[inline(always)]
fn blended_normal<S: Simd>(simd: S, frame: &Frame, slot: usize, row: usize) -> Vec3<Lanes<S>> {
    blended_vector(simd, frame, channel::NORMAL, slot, row)
}

/// Vectors of a row of a tile, from three channels.
#[inline(always)]
fn blended_vector<S: Simd>(simd: S, frame: &Frame, first: usize, slot: usize, row: usize) -> Vec3<Lanes<S>> {
    let mut rows = [[0.0; SIZE]; 3];
    for (component, numbers) in rows.iter_mut().enumerate() {
        *numbers = row_of_tile(frame.tile(slot), frame.channels, first + component, row);
    }
    let [x, y, z] = Lanes::load_each(simd, &rows);
    vec3(x, y, z)
}

/// Writes the weights of a tile's pixels; returns the sum of their losses.
#[inline(always)]
fn weigh_tile<S: Simd>(simd: S, comparison: &Comparison<'_>, normals: &Planes, slot: usize, out: &mut [Row]) -> f64 {
    let Comparison { frame, camera, .. } = comparison;
    let camera = camera.lift(Lanes::splat(simd, 0.0));
    let position = frame.cover.tile_position(slot);
    let mut windows = [[[0.0; 2 * SIZE]; WEIGHT_ROWS]; 3];
    read_windows(normals, frame, position, &mut windows);
    let sums = sums_down(simd, &windows);
    let share = Lanes::splat(simd, (REACHES.len() as f32).recip());
    let has_gloss = frame.shaded.is_some() && Channels::of_count(frame.channels).contain(channel::ROUGHNESS);
    let mut sum = share.zero();
    for row in 0..SIZE {
        let view_dir = view_dir(simd, &camera, position, row, [0, 0]);
        let at = blurred_at(simd, &sums, row + CREASE_REACH, CENTER);
        let across = Line {
            before: blurred_at(simd, &sums, row + CREASE_REACH, CENTER - CREASE_REACH),
            at,
            after: blurred_at(simd, &sums, row + CREASE_REACH, CENTER + CREASE_REACH),
        };
        let down = Line {
            before: blurred_at(simd, &sums, row, CENTER),
            at,
            after: blurred_at(simd, &sums, row + 2 * CREASE_REACH, CENTER),
        };
        // Blurred normals extend beyond the picture, where they are not compared.
        let evenness = evenness(&across, &down, view_dir).keep(are_ends_inside(simd, comparison, position, row));
        let weight = match has_gloss && evenness.any_positive() {
            true => evenness * gloss_of_row(simd, frame, slot, row),
            false => evenness,
        };
        weight.store(&mut out[plane_start(frame.cover.columns, 0, position[0]) + row]);
        for reach in REACHES {
            for axis in 0..2 {
                let line = line_at(simd, &windows, [CENTER, row + WEIGHT_REACH], axis, reach);
                sum = sum + bending(&line, view_dir, weight) * share;
            }
        }
    }
    f64::from(sum.sum())
}

/// Gloss of a row of a tile with added light.
#[inline(always)]
fn gloss_of_row<S: Simd>(simd: S, frame: &Frame, slot: usize, row: usize) -> Lanes<S> {
    let blended = |channel: usize| Lanes::load(simd, &row_of_tile(frame.tile(slot), frame.channels, channel, row));
    let shaded = |c: usize| Lanes::load(simd, &row_of_quads(|quad| frame.color_before_exposure(slot, quad, c), row));
    let coverage = -blended(frame.channels) + 1.0;
    let base = blended_vector(simd, frame, channel::COLOR, slot, row);
    let lit = vec3(shaded(0), shaded(1), shaded(2));
    gloss(lit, unlit_pixel_color(base, coverage), blended(channel::ROUGHNESS), coverage)
}

/// Mask of the pixels of a row of a tile with neighbours at [`CREASE_REACH`] in the picture.
#[inline(always)]
fn are_ends_inside<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    position: [usize; 2],
    row: usize,
) -> <Lanes<S> as Real>::Mask {
    let [x, y] = centres(simd, position, row);
    let reach = x.constant(CREASE_REACH as f32);
    let [width, height] = [x.constant(comparison.target.width as f32), x.constant(comparison.target.height as f32)];
    reach.less(x) & reach.less(y) & (x + reach).less(width) & (y + reach).less(height)
}

/// Sums of the rows around each within the blur of normals.
#[inline(always)]
fn sums_down<S: Simd>(simd: S, windows: &Windows<WEIGHT_ROWS>) -> Windows<BLURRED_ROWS> {
    let mut sums = [[[0.0; 2 * SIZE]; BLURRED_ROWS]; 3];
    for (sums, window) in sums.iter_mut().zip(windows) {
        for (row, sums) in sums.iter_mut().enumerate() {
            for half in [0, SIZE] {
                let mut sum = Lanes::splat(simd, 0.0);
                for numbers in &window[row..=row + 2 * BLUR_REACH] {
                    sum = sum + Lanes::load(simd, &numbers[half..]);
                }
                sum.store(&mut sums[half..]);
            }
        }
    }
    sums
}

/// Blurred normals of sixteen pixels of a row, from the sums down.
#[inline(always)]
fn blurred_at<S: Simd>(simd: S, sums: &Windows<BLURRED_ROWS>, row: usize, start: usize) -> Vec3<Lanes<S>> {
    let mut sum = Vec3::zero(Lanes::splat(simd, 0.0));
    for first in start - BLUR_REACH..=start + BLUR_REACH {
        sum = sum + normal_at(simd, sums, row, first);
    }
    blurred_normal(sum)
}

/// Vectors of sixteen pixels of a row.
#[inline(always)]
fn normal_at<S: Simd, const ROWS: usize>(simd: S, windows: &Windows<ROWS>, row: usize, start: usize) -> Vec3<Lanes<S>> {
    let [x, y, z] = windows;
    vec3(Lanes::load(simd, &x[row][start..]), Lanes::load(simd, &y[row][start..]), Lanes::load(simd, &z[row][start..]))
}

/// Lines along an axis through sixteen pixels of a row of windows.
#[inline(always)]
fn line_at<S: Simd, const ROWS: usize>(
    simd: S,
    windows: &Windows<ROWS>,
    [start, row]: [usize; 2],
    axis: usize,
    reach: usize,
) -> Line<Lanes<S>> {
    let [across, down] = if axis == 0 { [reach, 0] } else { [0, reach] };
    Line {
        before: normal_at(simd, windows, row - down, start - across),
        at: normal_at(simd, windows, row, start),
        after: normal_at(simd, windows, row + down, start + across),
    }
}

/// Directions to the eye from sixteen pixels of a row of a tile, shifted by some pixels.
#[inline(always)]
fn view_dir<S: Simd>(
    simd: S,
    camera: &CameraOf<Lanes<S>>,
    position: [usize; 2],
    row: usize,
    [right, down]: [isize; 2],
) -> Vec3<Lanes<S>> {
    let [x, y] = centres(simd, position, row);
    camera.view_dir(x + right as f32, y + down as f32)
}

#[inline(always)]
fn read_windows<const ROWS: usize>(planes: &Planes, frame: &Frame, position: [usize; 2], windows: &mut Windows<ROWS>) {
    for (component, window) in windows.iter_mut().enumerate() {
        planes.read_window(position, component, |tile| frame.cover.slot(tile).is_some(), window);
    }
}

/// Adds the gradients of a tile's normals, from all lines with an end or the middle there.
#[inline(always)]
fn gather<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    planes: &Planes,
    normals: &Planes,
    weights: &Planes,
    slot: usize,
    grad: &mut [Quad],
) {
    let Comparison { frame, camera, .. } = comparison;
    let camera = camera.lift(Lanes::splat(simd, 0.0));
    let position = frame.cover.tile_position(slot);
    let mut windows = [[[0.0; 2 * SIZE]; GRAD_ROWS]; 3];
    read_windows(normals, frame, position, &mut windows);
    let mut all_weights = [[0.0; 2 * SIZE]; SIZE + 2 * REACH];
    weights.read_window(position, 0, |tile| frame.cover.slot(tile).is_some(), &mut all_weights);
    let share = comparison.weights.smoothness / (REACHES.len() * comparison.pixel_count()) as f32;
    let share = Lanes::splat(simd, share);
    for row in 0..SIZE {
        let is_surface = is_surface(Lanes::load(simd, &planes.plane(position, plane::COVERAGE)[row]));
        if !share.keep(is_surface).any_positive() {
            continue;
        }
        let mut grad_unit = Vec3::zero(share);
        for reach in REACHES {
            for axis in 0..2 {
                // The middle of the line is before, at or after the pixel.
                for shift in [-(reach as isize), 0, reach as isize] {
                    let [right, down] = if axis == 0 { [shift, 0] } else { [0, shift] };
                    let start = CENTER.wrapping_add_signed(right);
                    let line =
                        line_at(simd, &windows, [start, (row + 2 * REACH).wrapping_add_signed(down)], axis, reach);
                    let weight = Lanes::load(simd, &all_weights[(row + REACH).wrapping_add_signed(down)][start..]);
                    let view_dir = view_dir(simd, &camera, position, row, [right, down]);
                    let slope = bending_vjp(&line, view_dir, weight, share);
                    grad_unit = if shift == 0 { grad_unit - (slope + slope) } else { grad_unit + slope };
                }
            }
        }
        let grad_blended = unit_normal_vjp(blended_normal(simd, frame, slot, row), is_surface, grad_unit);
        for (component, lanes) in grad_blended.to_array().into_iter().enumerate() {
            add_to_row(grad, frame.channels, channel::NORMAL + component, row, &lanes.to_array());
        }
    }
}
