//! SSIM of two pictures and its gradient, a tile at a time.

use super::{Comparison, FAR, add_to_row, plane};
use crate::{
    frame::{Frame, Quad, SIZE, tile_len},
    lanes::Lanes,
    parts::Pieces,
    planes::{CENTER, Planes, Row, WideRow, place_in_row},
};
use fearless_simd::{Simd, dispatch};
use specula_core::{
    loss::{SSIM_WINDOW, SsimMoments, ssim, ssim_vjp, ssim_window},
    real::Real,
};

/// Half of SSIM's window.
const REACH: usize = SSIM_WINDOW / 2;
/// Rows that the windows of a tile look at.
const ROWS: usize = SIZE + 2 * REACH;
/// Where the first window of a tile begins in a wide row.
const FIRST: usize = CENTER - REACH;

/// Mean SSIM; adds its gradient.
///
/// Where both pictures show the background alone, SSIM is one and its gradient zero: such tiles are left out.
pub(super) fn structure_loss(comparison: &Comparison<'_>, planes: &Planes, grad: &mut [Quad]) -> f64 {
    let Comparison { machine, frame, weights, distance, .. } = comparison;
    let cover = &frame.cover;
    let values = 3 * comparison.pixel_count();
    let mut partials = Planes::new(machine, [cover.columns, cover.rows], 9);
    let (rows, rows_of) = partials.parts();
    let factor = -weights.dssim / values as f32;
    let [sum, ..] = comparison.each_tile_row(Pieces::new(rows, &rows_of), |row, partials| {
        let partials = partials.only();
        let mut sum = 0.0;
        // A colour after the other: so what neighbouring tiles share is still near.
        for (c, partials) in partials.chunks_exact_mut(3 * cover.columns * SIZE).enumerate() {
            for column in 0..cover.columns {
                let size = inside(frame, [column, row]);
                sum += if distance[row * cover.columns + column] <= 1 {
                    dispatch!(machine.level, simd => {
                        compare_tile(simd, planes, distance, [column, row], c, size, factor, partials)
                    })
                } else {
                    (size[0] * size[1]) as f64
                };
            }
        }
        [sum, 0.0, 0.0, 0.0]
    });
    let grad_of = comparison.grad_starts();
    comparison.each_tile_row(Pieces::new(grad, &grad_of), |row, grad| {
        let grad = grad.only();
        for c in 0..3 {
            let tiles = grad.chunks_exact_mut(tile_len(frame.channels));
            for (slot, tile) in (cover.before_row(row)..).zip(tiles) {
                let place = cover.place(slot);
                dispatch!(machine.level, simd => {
                    add_grads(simd, planes, &partials, distance, place, c, frame, tile);
                });
            }
        }
        [0.0; 4]
    });
    sum / values as f64
}

/// Columns and rows of a tile that lie in the picture.
fn inside(frame: &Frame, [column, row]: [usize; 2]) -> [usize; 2] {
    [SIZE.min(frame.width - column * SIZE), SIZE.min(frame.height - row * SIZE)]
}

/// A row of SSIM's window, each weight in every lane.
#[inline(always)]
fn window_lanes<S: Simd>(simd: S) -> [Lanes<S>; SSIM_WINDOW] {
    let weights = ssim_window();
    let mut lanes = [Lanes::splat(simd, 0.0); SSIM_WINDOW];
    for k in 0..SSIM_WINDOW {
        lanes[k] = Lanes::splat(simd, weights[k]);
    }
    lanes
}

/// Sum of SSIM of one colour over a tile, and the gradients of E\[x\], E\[x²\] and E\[xy\] of every pixel, times a factor.
#[inline(always)]
fn compare_tile<S: Simd>(
    simd: S,
    planes: &Planes,
    distance: &[u32],
    place: [usize; 2],
    c: usize,
    [columns, rows]: [usize; 2],
    factor: f32,
    partials: &mut [Row],
) -> f64 {
    let window = window_lanes(simd);
    let zero = Lanes::splat(simd, 0.0);
    let factor = Lanes::splat(simd, factor);
    let is_written = |tile: usize| distance[tile] < FAR;
    let rendered = planes.window::<ROWS>(place, plane::RENDERED + c, is_written);
    let truth = planes.window::<ROWS>(place, plane::TRUTH + c, is_written);
    let mut across = [[zero; 4]; ROWS];
    for row in 0..ROWS {
        across[row] = blur_moments(simd, &rendered[row], &truth[row], &window);
    }
    let all_columns = partials.len() / (3 * SIZE);
    let mut sum = zero;
    for row in 0..SIZE {
        let mut blurred = [zero; 4];
        for tap in 0..SSIM_WINDOW {
            for k in 0..4 {
                blurred[k] = across[row + tap][k].mul_add(window[tap], blurred[k]);
            }
        }
        // Only the sum of the two mean squares counts.
        let moments = SsimMoments { x: blurred[0], y: blurred[1], xx: blurred[2], yy: zero, xy: blurred[3] };
        let count = if row < rows { columns } else { 0 };
        sum = sum + ssim(&moments).keep_first(count);
        let own = ssim_vjp(&moments, factor);
        for k in 0..3 {
            own[k].keep_first(count).store(&mut partials[place_in_row(all_columns, k, place[0]) + row]);
        }
    }
    f64::from(sum.sum())
}

/// E\[x\], E\[y\], E\[x² + y²\] and E\[xy\] of sixteen windows of a row.
#[inline(always)]
fn blur_moments<S: Simd>(simd: S, x: &WideRow, y: &WideRow, window: &[Lanes<S>; SSIM_WINDOW]) -> [Lanes<S>; 4] {
    let mut sums = [Lanes::splat(simd, 0.0); 4];
    for tap in 0..SSIM_WINDOW {
        let (x, y) = (Lanes::load(simd, &x[FIRST + tap..]), Lanes::load(simd, &y[FIRST + tap..]));
        let weight = window[tap];
        sums[0] = x.mul_add(weight, sums[0]);
        sums[1] = y.mul_add(weight, sums[1]);
        sums[2] = x.mul_add(x, y * y).mul_add(weight, sums[2]);
        sums[3] = (x * y).mul_add(weight, sums[3]);
    }
    sums
}

/// Every window passes its gradients on to a colour of the pixels of a tile.
#[inline(always)]
fn add_grads<S: Simd>(
    simd: S,
    planes: &Planes,
    partials: &Planes,
    distance: &[u32],
    place: [usize; 2],
    c: usize,
    frame: &Frame,
    tile: &mut [Quad],
) {
    let window = window_lanes(simd);
    let blur = |k: usize| {
        let partial = partials.window::<ROWS>(place, 3 * c + k, |tile| distance[tile] <= 1);
        blur_plane(simd, &partial, &window)
    };
    let (of_x, of_xx, of_xy) = (blur(0), blur(1), blur(2));
    let (rendered, truth) = (planes.plane(place, plane::RENDERED + c), planes.plane(place, plane::TRUTH + c));
    let [columns, rows] = inside(frame, place);
    for row in 0..rows {
        let (x, y) = (Lanes::load(simd, &rendered[row]), Lanes::load(simd, &truth[row]));
        let through_squares = x * 2.0 * of_xx[row] + y * of_xy[row];
        let own = (of_x[row] + through_squares).keep_first(columns);
        add_to_row(tile, frame.channels, c, row, &own.to_array());
    }
}

/// SSIM's window over a plane of a tile.
#[inline(always)]
fn blur_plane<S: Simd>(simd: S, plane: &[WideRow; ROWS], window: &[Lanes<S>; SSIM_WINDOW]) -> [Lanes<S>; SIZE] {
    let zero = Lanes::splat(simd, 0.0);
    let mut across = [zero; ROWS];
    for row in 0..ROWS {
        for tap in 0..SSIM_WINDOW {
            across[row] = Lanes::load(simd, &plane[row][FIRST + tap..]).mul_add(window[tap], across[row]);
        }
    }
    let mut blurred = [zero; SIZE];
    for row in 0..SIZE {
        for tap in 0..SSIM_WINDOW {
            blurred[row] = across[row + tap].mul_add(window[tap], blurred[row]);
        }
    }
    blurred
}
