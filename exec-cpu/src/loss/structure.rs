//! SSIM of two pictures and its gradient, a tile at a time.

use super::{Comparison, FAR, add_to_row, plane};
use crate::{
    frame::{Frame, Quad, SIZE, tile_len},
    lanes::Lanes,
    parts::Pieces,
    planes::{CENTER, Planes, Row, WideRow, place_in_row},
};
use fearless_simd::{Simd, dispatch};
use specula_core::loss::{SSIM_WINDOW, SsimMoments, ssim, ssim_pixel_vjp, ssim_vjp, ssim_window, window_mean};

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
        let mut windows = [[[0.0; 2 * SIZE]; ROWS]; 2];
        let mut sum = 0.0;
        // A colour after the other: so what neighbouring tiles share is still near.
        for (c, partials) in partials.chunks_exact_mut(3 * cover.columns * SIZE).enumerate() {
            for column in 0..cover.columns {
                let size = inside(frame, [column, row]);
                sum += if distance[row * cover.columns + column] <= 1 {
                    dispatch!(machine.level, simd => {
                        compare_tile(simd, planes, distance, [column, row], c, size, factor, &mut windows, partials)
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
        let mut window = [[0.0; 2 * SIZE]; ROWS];
        for c in 0..3 {
            let tiles = grad.chunks_exact_mut(tile_len(frame.channels));
            for (slot, tile) in (cover.before_row(row)..).zip(tiles) {
                let place = cover.place(slot);
                dispatch!(machine.level, simd => {
                    add_grads(simd, planes, &partials, distance, place, c, frame, &mut window, tile);
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
type Window<S> = [Lanes<S>; SSIM_WINDOW];

#[inline(always)]
fn window_lanes<S: Simd>(simd: S) -> Window<S> {
    let weights = ssim_window();
    let mut lanes = [Lanes::splat(simd, 0.0); SSIM_WINDOW];
    for k in 0..SSIM_WINDOW {
        lanes[k] = Lanes::splat(simd, weights[k]);
    }
    lanes
}

/// Sum of SSIM of one colour over a tile, and the gradients of E\[x\], E\[x²\] and E\[xy\] of every pixel, times a factor.
/// The windows are memory to work in.
#[inline(always)]
fn compare_tile<S: Simd>(
    simd: S,
    planes: &Planes,
    distance: &[u32],
    place: [usize; 2],
    c: usize,
    [columns, rows]: [usize; 2],
    factor: f32,
    [rendered, truth]: &mut [[WideRow; ROWS]; 2],
    partials: &mut [Row],
) -> f64 {
    let window = window_lanes(simd);
    let zero = Lanes::splat(simd, 0.0);
    let factor = Lanes::splat(simd, factor);
    let is_written = |tile: usize| distance[tile] < FAR;
    planes.read_window(place, plane::RENDERED + c, is_written, rendered);
    planes.read_window(place, plane::TRUTH + c, is_written, truth);
    let mut across = [[zero; 4]; ROWS];
    for row in 0..ROWS {
        across[row] = blur_moments(simd, &rendered[row], &truth[row], &window);
    }
    let all_columns = partials.len() / (3 * SIZE);
    let mut sum = zero;
    for row in 0..SIZE {
        let mut blurred = [zero; 4];
        for k in 0..4 {
            blurred[k] = window_mean(&window, |tap| across[row + tap][k]);
        }
        let moments = SsimMoments::of_means(blurred);
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
fn blur_moments<S: Simd>(simd: S, x: &WideRow, y: &WideRow, window: &Window<S>) -> [Lanes<S>; 4] {
    let (mut squares, mut products) = ([0.0; 2 * SIZE], [0.0; 2 * SIZE]);
    for half in 0..2 {
        let (x, y) = (Lanes::load(simd, &x[half * SIZE..]), Lanes::load(simd, &y[half * SIZE..]));
        let [_, _, both_squares, product] = SsimMoments::products(x, y);
        both_squares.store(&mut squares[half * SIZE..]);
        product.store(&mut products[half * SIZE..]);
    }
    [
        blur_row(simd, x, window),
        blur_row(simd, y, window),
        blur_row(simd, &squares, window),
        blur_row(simd, &products, window),
    ]
}

/// Sixteen windows of a row.
#[inline(always)]
fn blur_row<S: Simd>(simd: S, row: &WideRow, window: &Window<S>) -> Lanes<S> {
    window_mean(window, |tap| Lanes::load(simd, &row[FIRST + tap..FIRST + tap + SIZE]))
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
    partial: &mut [WideRow; ROWS],
    tile: &mut [Quad],
) {
    let window = window_lanes(simd);
    let mut blur = |k: usize| {
        partials.read_window(place, 3 * c + k, |tile| distance[tile] <= 1, partial);
        blur_plane(simd, partial, &window)
    };
    let (of_x, of_xx, of_xy) = (blur(0), blur(1), blur(2));
    let (rendered, truth) = (planes.plane(place, plane::RENDERED + c), planes.plane(place, plane::TRUTH + c));
    let [columns, rows] = inside(frame, place);
    for row in 0..rows {
        let (x, y) = (Lanes::load(simd, &rendered[row]), Lanes::load(simd, &truth[row]));
        let own = ssim_pixel_vjp(x, y, [of_x[row], of_xx[row], of_xy[row]]).keep_first(columns);
        add_to_row(tile, frame.channels, c, row, &own.to_array());
    }
}

/// SSIM's window over a plane of a tile.
#[inline(always)]
fn blur_plane<S: Simd>(simd: S, plane: &[WideRow; ROWS], window: &Window<S>) -> [Lanes<S>; SIZE] {
    let zero = Lanes::splat(simd, 0.0);
    let mut across = [zero; ROWS];
    for row in 0..ROWS {
        across[row] = blur_row(simd, &plane[row], window);
    }
    let mut blurred = [zero; SIZE];
    for row in 0..SIZE {
        blurred[row] = window_mean(window, |tap| across[row + tap]);
    }
    blurred
}
