//! Comparison of a picture with its target, and tile by tile access to both.

use crate::{
    buffer::Buffer,
    context::Context,
    frame::{Cover, Frame, PIXEL_X, PIXEL_Y, QUAD, QUADS, Quad, SIZE, at, quad_origin, tile_len},
    lanes::Lanes,
    parts::{Parts, Pieces, each_part},
};
use fearless_simd::Simd;
use specula_core::{
    bin::tile_count,
    camera::Camera,
    color::{Picture, from_byte, has_alpha, is_unknown},
    loss::{LossWeights, White},
    real::Real,
    scene::BLOCK,
};

/// A picture to compare with.
#[derive(Clone, Debug)]
pub struct Target {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(super) columns: usize,
    /// Bytes tile by tile and quad by quad: the reds of a quad, then greens, blues and alphas.
    quads: Vec<[[u8; BLOCK]; 4]>,
    /// Unclipped reds, greens and blues, likewise; empty for pictures of 8 bits.
    unclipped: Vec<[Quad; 3]>,
    /// Whether a tile is transparent everywhere.
    is_empty: Vec<bool>,
    /// Whether any pixel is not opaque.
    pub(super) has_alpha: bool,
    /// Whether any pixel is unknown.
    pub(super) has_unknown: bool,
}

impl Target {
    pub(crate) fn new(picture: &Picture<'_>) -> Self {
        let Picture { width, height, rgba, unclipped } = *picture;
        let [columns, rows] = [width, height].map(|pixels| tile_count(pixels as u32) as usize);
        let quads = quads_of(rgba.as_chunks().0, [width, columns, rows], |byte| byte);
        let unclipped = unclipped.map(|colors| quads_of(colors, [width, columns, rows], f32::from));
        let is_transparent = |quads: &[[[u8; BLOCK]; 4]]| quads.iter().all(|quad| quad[3] == [0; BLOCK]);
        Self {
            width,
            height,
            columns,
            is_empty: quads.chunks_exact(QUADS).map(is_transparent).collect(),
            has_alpha: has_alpha(rgba),
            has_unknown: rgba.chunks_exact(4).any(is_unknown),
            quads,
            unclipped: unclipped.unwrap_or_default(),
        }
    }

    /// Whether no number of the picture is above white.
    pub(super) const fn is_clipped(&self) -> bool {
        self.unclipped.is_empty()
    }

    /// Red, green, blue and alpha of a quad: alpha in \[0, 1\], colours above if unclipped.
    #[inline(always)]
    pub(super) fn read<S: Simd>(&self, simd: S, [column, row]: [usize; 2], quad: usize) -> [Lanes<S>; 4] {
        let index = (row * self.columns + column) * QUADS + quad;
        let [mut red, mut green, mut blue, alpha] = read_bytes(simd, &self.quads[index]);
        if let Some(colors) = self.unclipped.get(index) {
            [red, green, blue] = colors.map(|color| Lanes::from_array(simd, color));
        }
        [red, green, blue, alpha]
    }

    /// One for the known pixels of a quad, zero for others.
    #[inline(always)]
    pub(super) fn known<S: Simd>(&self, simd: S, [column, row]: [usize; 2], quad: usize) -> Lanes<S> {
        let quad = &self.quads[(row * self.columns + column) * QUADS + quad];
        let mut known = [1.0; BLOCK];
        for lane in 0..BLOCK {
            let pixel = [quad[0][lane], quad[1][lane], quad[2][lane], quad[3][lane]];
            known[lane] = if is_unknown(&pixel) { 0.0 } else { 1.0 };
        }
        Lanes::from_array(simd, known)
    }
}

/// Numbers of pixels tile by tile and quad by quad, from rows.
fn quads_of<T: Copy, U: Copy + Default, const N: usize>(
    pixels: &[[T; N]],
    [width, columns, rows]: [usize; 3],
    number: impl Fn(T) -> U,
) -> Vec<[[U; BLOCK]; N]> {
    let mut quads = vec![[[U::default(); BLOCK]; N]; columns * rows * QUADS];
    for (y, row) in pixels.chunks_exact(width.max(1)).enumerate() {
        // The pixels of a row that share a quad.
        for (run, pixels) in row.chunks(QUAD).enumerate() {
            let tile = y / SIZE * columns + run / (SIZE / QUAD);
            let quad = &mut quads[tile * QUADS + y % SIZE / QUAD * (SIZE / QUAD) + run % (SIZE / QUAD)];
            let lanes = y % QUAD * QUAD..;
            for (lane, pixel) in lanes.zip(pixels) {
                for channel in 0..N {
                    quad[channel][lane] = number(pixel[channel]);
                }
            }
        }
    }
    quads
}

/// Comparison of a frame with its target.
pub(super) struct Comparison<'a> {
    pub(super) context: &'a Context,
    pub(super) frame: &'a Frame,
    pub(super) target: &'a Target,
    pub(super) camera: &'a Camera,
    pub(super) weights: LossWeights,
    pub(super) white: White,
    pub(super) background: [f32; 3],
    /// Distance of each tile, in tiles, from the nearest one with anything but the background, up
    /// to [`FAR`].
    pub(super) distance: Buffer<u32>,
}

/// Distance beyond the reach of any window.
pub(super) const FAR: u32 = 3;

/// Planes for windows.
pub(super) mod plane {
    /// The rendered colour over the background.
    pub(in crate::stages::loss) const RENDERED: usize = 0;
    /// The true colour over the background.
    pub(in crate::stages::loss) const TRUTH: usize = 3;
    /// Coverage of the rendered picture.
    pub(in crate::stages::loss) const COVERAGE: usize = 6;
    /// Expected depth, zero without a surface.
    pub(in crate::stages::loss) const DEPTH: usize = 7;
}

impl Comparison<'_> {
    pub(super) fn pixel_count(&self) -> usize {
        self.target.width * self.target.height
    }
    /// Start of the gradient of each row of tiles.
    pub(super) fn grad_starts(&self) -> impl Fn(usize) -> usize + Sync + '_ {
        |row| self.frame.cover.before_row(row) * tile_len(self.frame.channels)
    }
    /// Visits the rows of tiles, each with its part of the data, and sums their results in order.
    pub(super) fn each_tile_row<P: Parts>(&self, parts: P, visit: impl Fn(usize, P) -> [f64; 4] + Sync) -> [f64; 4] {
        let rows = self.frame.cover.rows;
        let mut sums = self.context.take::<[f64; 4]>(rows);
        let one_by_one = |row: usize| row;
        let parts = (parts, Pieces::new(&mut sums, &one_by_one));
        each_part(rows, parts, &|row, (part, sum): (P, Pieces<'_, [f64; 4]>)| sum.only()[0] = visit(row, part));
        sums.iter().fold([0.0; 4], |sum, row| core::array::from_fn(|k| sum[k] + row[k]))
    }

    /// One for the pixels of a quad in the picture, zero for others.
    #[inline(always)]
    pub(super) fn inside<S: Simd>(&self, simd: S, tile: [usize; 2], quad: usize) -> Lanes<S> {
        let [x, y] = quad_origin(quad);
        let x = Lanes::from_array(simd, PIXEL_X) + (tile[0] * SIZE + x) as f32;
        let y = Lanes::from_array(simd, PIXEL_Y) + (tile[1] * SIZE + y) as f32;
        let end = |pixels: usize| Lanes::splat(simd, pixels as f32);
        let is_inside = x.less(end(self.target.width)) & y.less(end(self.target.height));
        x.constant(1.0).keep(is_inside)
    }
}

/// Distance of each tile, in tiles, from the nearest one that a splat touches or that the target
/// covers.
pub(super) fn distances(context: &Context, frame: &Frame, target: &Target) -> Buffer<u32> {
    let Cover { columns, rows, .. } = frame.cover;
    let mut distance = context.take::<u32>(columns * rows);
    for (tile, distance) in distance.iter_mut().enumerate() {
        let is_active = frame.cover.slot(tile).is_some() || !target.is_empty[tile];
        *distance = if is_active { 0 } else { FAR };
    }
    if distance.is_empty() {
        return distance;
    }
    // The larger of two distances along rows and columns: rows first, then columns of the result.
    for row in distance.chunks_exact_mut(columns) {
        spread_distance(row, columns, 1);
    }
    for column in 0..columns {
        let len = (rows - 1) * columns + 1;
        spread_distance(&mut distance[column..column + len], rows, columns);
    }
    distance
}

/// Limits every distance to one more than its neighbour's, forwards and backwards.
fn spread_distance(distance: &mut [u32], count: usize, step: usize) {
    for k in 1..count {
        distance[k * step] = distance[k * step].min(distance[(k - 1) * step] + 1);
    }
    for k in (1..count).rev() {
        distance[(k - 1) * step] = distance[(k - 1) * step].min(distance[k * step] + 1);
    }
}

/// Red, green, blue and alpha of a quad, in \[0, 1\].
#[inline(always)]
fn read_bytes<S: Simd>(simd: S, quad: &[[u8; BLOCK]; 4]) -> [Lanes<S>; 4] {
    let mut numbers = [[0.0; BLOCK]; 4];
    for (numbers, bytes) in numbers.iter_mut().zip(quad) {
        for lane in 0..BLOCK {
            numbers[lane] = f32::from(bytes[lane]);
        }
    }
    let channel = |k: usize| from_byte(Lanes::from_array(simd, numbers[k]));
    [channel(0), channel(1), channel(2), channel(3)]
}

/// A row of a tile's channel, from its four quads.
#[inline(always)]
pub(super) fn row_of_tile(tile: &[Quad], channels: usize, channel: usize, y: usize) -> [f32; SIZE] {
    row_of_quads(|quad| &tile[at(channels, quad, channel)], y)
}

/// A row of a tile's numbers, from those of its quads.
#[inline(always)]
pub(super) fn row_of_quads<'a>(quad_at: impl Fn(usize) -> &'a Quad, y: usize) -> [f32; SIZE] {
    let mut row = [0.0; SIZE];
    for (k, to) in row.chunks_exact_mut(QUAD).enumerate() {
        let quad = quad_at(y / QUAD * QUAD + k);
        to.copy_from_slice(&quad[y % QUAD * QUAD..][..QUAD]);
    }
    row
}

/// Adds to a row of a tile's channel.
#[inline(always)]
pub(super) fn add_to_row(tile: &mut [Quad], channels: usize, channel: usize, y: usize, row: &[f32; SIZE]) {
    for (k, from) in row.chunks_exact(QUAD).enumerate() {
        let quad = &mut tile[at(channels, y / QUAD * QUAD + k, channel)];
        quad[y % QUAD * QUAD..][..QUAD].iter_mut().zip(from).for_each(|(sum, x)| *sum += x);
    }
}
