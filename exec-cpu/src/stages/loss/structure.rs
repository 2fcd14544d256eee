//! SSIM of two pictures and its gradient, a row of tiles at a time: windows down the columns first,
//! then along the rows.

use super::comparison::{Comparison, FAR, add_to_row, plane};
use crate::{
    frame::{Frame, Quad, SIZE, tile_len},
    lanes::Lanes,
    parts::Pieces,
    planes::{Planes, Row, plane_start},
};
use fearless_simd::{Simd, dispatch};
use specula_core::loss::{
    SSIM_WINDOW, SsimMoments, White, recorded_vjp, ssim, ssim_pixel_vjp, ssim_vjp, ssim_window, window_mean,
};

/// Half of SSIM's window.
const REACH: usize = SSIM_WINDOW / 2;
/// Rows for the windows of a tile.
const ROWS: usize = SIZE + 2 * REACH;

/// Mean SSIM; adds its gradient.
///
/// Tiles in which both pictures show only the background are skipped: their SSIM is one and its
/// gradient zero.
pub(super) fn structure_loss(comparison: &Comparison<'_>, planes: &Planes, grad: &mut [Quad]) -> f64 {
    let Comparison { context, frame, weights, .. } = comparison;
    let cover = &frame.cover;
    let values = 3 * comparison.pixel_count();
    let mut partials = Planes::new(context, [cover.columns, cover.rows], 9);
    let (rows, rows_of) = partials.parts();
    let factor = -weights.dssim / values as f32;
    let [sum, ..] = comparison.each_tile_row(Pieces::new(rows, &rows_of), |row, partials| {
        // One colour after the other, so that the data that neighbouring tiles share is still in
        // the cache.
        let colors = partials.only().chunks_exact_mut(3 * cover.columns * SIZE).enumerate();
        let sums = colors.map(|(c, partials)| {
            dispatch!(context.level, simd => compare_row(simd, comparison, planes, row, c, factor, partials))
        });
        [sums.sum(), 0.0, 0.0, 0.0]
    });
    let grad_of = comparison.grad_starts();
    comparison.each_tile_row(Pieces::new(grad, &grad_of), |row, grad| {
        let grad = grad.only();
        for c in 0..3 {
            dispatch!(context.level, simd => add_grads_of_row(simd, comparison, planes, &partials, row, c, grad));
        }
        [0.0; 4]
    });
    sum / values as f64
}

/// Columns and rows of a tile in the picture.
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

/// Windows down the columns of a row of tiles, of the current tile and its neighbours. Values are
/// read one tile after they are pushed: then they are in the cache, where unaligned vectors are
/// fast.
struct Strip<const PLANES: usize> {
    rows: [[[f32; STRIP_TILES * SIZE]; SIZE]; PLANES],
    /// Number of tiles; the last but one is the current one.
    tiles: usize,
}

/// Capacity of a strip in tiles before it is reset.
const STRIP_TILES: usize = 8;

impl<const PLANES: usize> Strip<PLANES> {
    /// Strip left of the picture: zeros.
    #[inline(always)]
    fn new() -> Self {
        Self { rows: [[[0.0; STRIP_TILES * SIZE]; SIZE]; PLANES], tiles: 1 }
    }

    /// Pushes the next tile: windows down the columns of these rows, or zeros.
    #[inline(always)]
    fn push<S: Simd>(&mut self, window: &Window<S>, rows: Option<&[[Lanes<S>; PLANES]; ROWS]>) {
        const KEPT: usize = 2;
        if self.tiles == STRIP_TILES {
            let last = (STRIP_TILES - KEPT) * SIZE;
            self.rows.as_flattened_mut().iter_mut().for_each(|row| row.copy_within(last.., 0));
            self.tiles = KEPT;
        }
        let first = self.tiles * SIZE;
        for row in 0..SIZE {
            for plane in 0..PLANES {
                let to = &mut self.rows[plane][row][first..first + SIZE];
                match rows {
                    Some(rows) => window_mean(window, |tap| rows[row + tap][plane]).store(to),
                    None => to.fill(0.0),
                }
            }
        }
        self.tiles += 1;
    }

    /// Whole windows of a row of the last tile but one.
    #[inline(always)]
    fn along<S: Simd>(&self, simd: S, window: &Window<S>, row: usize) -> [Lanes<S>; PLANES] {
        let first = (self.tiles - 2) * SIZE - REACH;
        let mut along = [Lanes::splat(simd, 0.0); PLANES];
        for plane in 0..PLANES {
            let row = &self.rows[plane][row];
            along[plane] = window_mean(window, |tap| Lanes::load(simd, &row[first + tap..first + tap + SIZE]));
        }
        along
    }
}

/// Sum of SSIM of one colour over a row of tiles, and the gradients of E\[x\], E\[x²\] and E\[xy\]
/// of every pixel, times a factor.
#[inline(always)]
fn compare_row<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    planes: &Planes,
    row: usize,
    c: usize,
    factor: f32,
    partials: &mut [Row],
) -> f64 {
    let Comparison { frame, distance, .. } = comparison;
    let columns = frame.cover.columns;
    let distance = &distance[row * columns..][..columns];
    let window = window_lanes(simd);
    let factor = Lanes::splat(simd, factor);
    let mut moments = [[factor; 4]; ROWS];
    let mut strip = Strip::new();
    let mut sum = 0.0;
    for next in 0..=columns {
        let is_near = next < columns && distance[next] <= 2;
        if is_near {
            read_moments(simd, comparison, planes, [next, row], c, &mut moments);
        }
        strip.push(&window, is_near.then_some(&moments));
        let Some(column) = next.checked_sub(1) else { continue };
        let size = inside(frame, [column, row]);
        sum += if distance[column] <= 1 {
            compare_tile(simd, &strip, &window, size, factor, partials, [columns, column])
        } else {
            (size[0] * size[1]) as f64
        };
    }
    sum
}

/// x, y, x² + y² and x y in the columns of a tile, of all rows that its windows read.
#[inline(always)]
fn read_moments<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    planes: &Planes,
    position: [usize; 2],
    c: usize,
    moments: &mut [[Lanes<S>; 4]; ROWS],
) {
    let is_written = |tile: usize| comparison.distance[tile] < FAR;
    let rendered = planes.rows_around::<ROWS>(position, plane::RENDERED + c, is_written);
    let truth = planes.rows_around::<ROWS>(position, plane::TRUTH + c, is_written);
    for row in 0..ROWS {
        moments[row] = SsimMoments::products(Lanes::load(simd, rendered[row]), Lanes::load(simd, truth[row]));
    }
}

#[inline(always)]
fn compare_tile<S: Simd>(
    simd: S,
    strip: &Strip<4>,
    window: &Window<S>,
    [columns, rows]: [usize; 2],
    factor: Lanes<S>,
    partials: &mut [Row],
    [all_columns, column]: [usize; 2],
) -> f64 {
    let mut sum = Lanes::splat(simd, 0.0);
    for row in 0..SIZE {
        let moments = SsimMoments::of_means(strip.along(simd, window, row));
        let count = if row < rows { columns } else { 0 };
        sum = sum + ssim(&moments).keep_first(count);
        let grads = ssim_vjp(&moments, factor);
        for k in 0..3 {
            grads[k].keep_first(count).store(&mut partials[plane_start(all_columns, k, column) + row]);
        }
    }
    f64::from(sum.sum())
}

/// Propagates the gradients of all windows to a colour of the pixels of a row of tiles.
#[inline(always)]
fn add_grads_of_row<S: Simd>(
    simd: S,
    comparison: &Comparison<'_>,
    planes: &Planes,
    partials: &Planes,
    row: usize,
    c: usize,
    grad: &mut [Quad],
) {
    let Comparison { frame, distance, .. } = comparison;
    let cover = &frame.cover;
    let (columns, len) = (cover.columns, tile_len(frame.channels));
    let window = window_lanes(simd);
    let mut rows = [[Lanes::splat(simd, 0.0); 3]; ROWS];
    let mut strip = Strip::new();
    for next in 0..=columns {
        let is_near = next < columns && distance[row * columns + next] <= 2;
        if is_near {
            for k in 0..3 {
                let around = partials.rows_around::<ROWS>([next, row], 3 * c + k, |tile| distance[tile] <= 1);
                for row in 0..ROWS {
                    rows[row][k] = Lanes::load(simd, around[row]);
                }
            }
        }
        strip.push(&window, is_near.then_some(&rows));
        let Some(column) = next.checked_sub(1) else { continue };
        if let Some(slot) = cover.slot(row * columns + column) {
            let tile = &mut grad[(slot - cover.before_row(row)) * len..][..len];
            add_grads(simd, &strip, &window, planes, [column, row], c, comparison, tile);
        }
    }
}

#[inline(always)]
fn add_grads<S: Simd>(
    simd: S,
    strip: &Strip<3>,
    window: &Window<S>,
    planes: &Planes,
    position: [usize; 2],
    c: usize,
    comparison: &Comparison<'_>,
    tile: &mut [Quad],
) {
    let Comparison { frame, white, .. } = comparison;
    let (rendered, truth) = (planes.plane(position, plane::RENDERED + c), planes.plane(position, plane::TRUTH + c));
    let [columns, rows] = inside(frame, position);
    for row in 0..rows {
        let (x, y) = (Lanes::load(simd, &rendered[row]), Lanes::load(simd, &truth[row]));
        let grad = ssim_pixel_vjp(x, y, strip.along(simd, window, row));
        let grad = if *white == White::Saturated { recorded_vjp(x, y, grad) } else { grad };
        let row_grad = grad.keep_first(columns);
        add_to_row(tile, frame.channels, c, row, &row_grad.to_array());
    }
}
