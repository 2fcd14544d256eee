//! Pictures in the layout of this executor: tile by tile, and only tiles that a splat touches.
//!
//! Tiles without a splat are neither written nor read. Losses skip a tile if both pictures show
//! only the background in it and in all windows that overlap it.

use crate::{buffer::Buffer, context::Context};
use rayon::prelude::*;
use specula_core::{bin::TILE_SIZE, scene::BLOCK};

/// Pixels along an edge of a tile.
pub(crate) const SIZE: usize = TILE_SIZE as usize;
/// Pixels along an edge of a quad, which has one pixel per lane.
pub(crate) const QUAD: usize = 4;
/// Quads along an edge of a tile.
pub(crate) const QUADS_ACROSS: usize = SIZE / QUAD;
/// Quads of a tile, in the order of rows.
pub(crate) const QUADS: usize = QUADS_ACROSS * QUADS_ACROSS;
/// Centres of the pixels of a quad, from its corner.
pub(crate) const PIXEL_X: Quad = [0.5, 1.5, 2.5, 3.5, 0.5, 1.5, 2.5, 3.5, 0.5, 1.5, 2.5, 3.5, 0.5, 1.5, 2.5, 3.5];
/// See [`PIXEL_X`].
pub(crate) const PIXEL_Y: Quad = [0.5, 0.5, 0.5, 0.5, 1.5, 1.5, 1.5, 1.5, 2.5, 2.5, 2.5, 2.5, 3.5, 3.5, 3.5, 3.5];
/// Channels of a colour.
pub(crate) const RGB: usize = 3;

/// A number of each pixel of a quad, row by row.
pub(crate) type Quad = [f32; BLOCK];

/// Tiles of a picture covered by splats.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cover {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Covered tiles, in the order of rows.
    pub(crate) tiles: Buffer<u32>,
    /// Number of covered tiles before each tile, and in total.
    before: Buffer<u32>,
}

impl Cover {
    /// Tiles of a grid for which `is_covered` returns true.
    pub(crate) fn new(context: &Context, columns: usize, rows: usize, is_covered: impl Fn(usize) -> bool) -> Self {
        let mut before = context.take::<u32>(columns * rows + 1);
        before[0] = 0;
        for tile in 0..columns * rows {
            before[tile + 1] = before[tile] + u32::from(is_covered(tile));
        }
        let mut tiles = context.take::<u32>(before[columns * rows] as usize);
        for tile in 0..columns * rows {
            if before[tile + 1] > before[tile] {
                tiles[before[tile] as usize] = tile as u32;
            }
        }
        Self { columns, rows, tiles, before }
    }
    /// Index of a tile among the covered tiles, if it is covered.
    pub(crate) fn slot(&self, tile: usize) -> Option<usize> {
        (self.before[tile + 1] > self.before[tile]).then_some(self.before[tile] as usize)
    }
    /// Covered tiles before a row of tiles.
    pub(crate) fn before_row(&self, row: usize) -> usize {
        self.before[row * self.columns] as usize
    }
    /// Column and row of a covered tile.
    pub(crate) fn tile_position(&self, slot: usize) -> [usize; 2] {
        let tile = self.tiles[slot] as usize;
        [tile % self.columns, tile / self.columns]
    }
    /// Upper left corner of a covered tile, in pixels.
    pub(crate) fn origin(&self, slot: usize) -> [f32; 2] {
        self.tile_position(slot).map(|tile| (tile * SIZE) as f32)
    }
}

/// Column and row of a quad's first pixel within its tile.
pub(crate) const fn quad_origin(quad: usize) -> [usize; 2] {
    [quad % QUADS_ACROSS * QUAD, quad / QUADS_ACROSS * QUAD]
}

/// Quads, or lanes of one, with set bits. Iterate with `for`: closures may be compiled without the
/// vector instructions of the machine.
#[derive(Clone, Copy)]
pub(crate) struct Bits(pub(crate) u16);

impl Iterator for Bits {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        if self.0 == 0 {
            return None;
        }
        let bit = self.0.trailing_zeros() as usize % QUADS;
        self.0 &= self.0 - 1;
        Some(bit)
    }
}

/// Number of quads of a tile with `channels` channels: those of the channels, quad after quad, then
/// the transmittances.
pub(crate) const fn tile_len(channels: usize) -> usize {
    (channels + 1) * QUADS
}

/// The `len` quads of each quad of a covered tile.
pub(crate) fn of_tile(all: &[Quad], slot: usize, len: usize) -> &[Quad] {
    &all[slot * QUADS * len..(slot + 1) * QUADS * len]
}

/// Index of a channel of a quad in a tile.
#[inline(always)]
pub(crate) const fn at(channels: usize, quad: usize, channel: usize) -> usize {
    if channel < channels { quad * channels + channel } else { QUADS * channels + quad }
}

/// A blended picture: its channels, premultiplied, and the transmittance behind them.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) channels: usize,
    pub(crate) cover: Cover,
    /// Blended channels: [`tile_len`] quads for each covered tile.
    pub(crate) blended: Buffer<Quad>,
    /// Reflections of the pixels, quad after quad, if rays were traced.
    pub(crate) reflections: Option<Buffer<Quad>>,
    /// Light of lamps on the pixels, quad after quad, if there are any.
    pub(crate) direct: Option<Buffer<Quad>>,
    /// Colour of the picture, quad after quad, if it differs from the blended one.
    pub(crate) shaded: Option<Buffer<Quad>>,
    /// Colour of the picture after its exposure, quad after quad, if it has one.
    pub(crate) exposed: Option<Buffer<Quad>>,
    /// For each intersection a bit for each quad in which the splat is visible.
    pub(crate) seen: Buffer<u16>,
}

impl Frame {
    /// Width and height, in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }
    /// Blended channels, without the transmittance.
    pub fn channel_count(&self) -> usize {
        self.channels
    }
    /// Numbers of the frame: those of each channel, and transmittance.
    pub fn len_of_values(&self) -> usize {
        (self.channels + 1) * self.width * self.height
    }
    /// Pixels of quads with a visible splat, over all splats: a lower bound of the work of
    /// blending.
    pub fn seen_pairs(&self) -> usize {
        BLOCK * self.seen.iter().map(|quads| quads.count_ones() as usize).sum::<usize>()
    }
    /// Pixels of covered tiles.
    pub fn covered_pixels(&self) -> usize {
        self.cover.tiles.len() * SIZE * SIZE
    }
    /// Blended channels of a covered tile.
    pub(crate) fn tile(&self, slot: usize) -> &[Quad] {
        &self.blended[slot * tile_len(self.channels)..][..tile_len(self.channels)]
    }
    /// A colour of the picture in a quad of a covered tile.
    #[inline(always)]
    pub(crate) fn color(&self, slot: usize, quad: usize, c: usize) -> &Quad {
        match &self.exposed {
            Some(exposed) => &exposed[(slot * QUADS + quad) * RGB + c],
            None => self.color_before_exposure(slot, quad, c),
        }
    }
    /// Colour before [`mod@crate::stages::expose`].
    #[inline(always)]
    pub(crate) fn color_before_exposure(&self, slot: usize, quad: usize, c: usize) -> &Quad {
        match &self.shaded {
            Some(shaded) => &shaded[(slot * QUADS + quad) * RGB + c],
            None => &self.tile(slot)[at(self.channels, quad, c)],
        }
    }
    fn shown(&self, slot: usize, quad: usize, channel: usize) -> &Quad {
        if channel < RGB { self.color(slot, quad, channel) } else { &self.tile(slot)[at(self.channels, quad, channel)] }
    }
    /// Planes of the picture, row by row: its channels, then transmittance, which is one without
    /// splats. There are [`Frame::len_of_values`] numbers.
    pub fn read(&self, values: &mut [f32]) {
        let empty = |channel: usize| if channel < self.channels { 0.0 } else { 1.0 };
        self.read_planes(values, empty, |slot, quad, channel| self.shown(slot, quad, channel));
    }

    /// Planes from quads of the covered tiles, with one number for all other pixels of each.
    fn read_planes<'a>(
        &self,
        values: &mut [f32],
        empty: impl Fn(usize) -> f32 + Sync,
        quad_of: impl Fn(usize, usize, usize) -> &'a Quad + Sync,
    ) {
        let planes = values.par_chunks_mut((self.width * self.height).max(1)).enumerate();
        planes.for_each(|(channel, plane)| {
            plane.par_chunks_mut(SIZE * self.width).enumerate().for_each(|(row, rows)| {
                rows.fill(empty(channel));
                self.read_rows(row, rows, |slot, quad| quad_of(slot, quad, channel));
            });
        });
    }

    /// Gradient of this picture from its planes, row by row like those of [`Frame::read`].
    pub fn grad(&self, planes: &[f32]) -> FrameGrad {
        let mut values = self.blended.clone();
        values.fill([0.0; BLOCK]);
        let len = tile_len(self.channels);
        for (slot, quad, lane) in self.lanes_of_tiles() {
            let ([column, row], [x, y]) = (self.cover.tile_position(slot), quad_origin(quad));
            let (x, y) = (column * SIZE + x + lane % QUAD, row * SIZE + y + lane / QUAD);
            if x < self.width && y < self.height {
                for plane in 0..=self.channels {
                    let number = planes[(plane * self.height + y) * self.width + x];
                    values[slot * len + at(self.channels, quad, plane)][lane] = number;
                }
            }
        }
        FrameGrad { channels: self.channels, values }
    }
    /// Covered tile, quad and lane of every pixel, including the padding of tiles.
    fn lanes_of_tiles(&self) -> impl Iterator<Item = (usize, usize, usize)> + use<> {
        let quads = (0..self.cover.tiles.len()).flat_map(|slot| (0..QUADS).map(move |quad| (slot, quad)));
        quads.flat_map(|(slot, quad)| (0..BLOCK).map(move |lane| (slot, quad, lane)))
    }

    fn read_rows<'a>(&self, tile_row: usize, rows: &mut [f32], quad_of: impl Fn(usize, usize) -> &'a Quad) {
        for slot in self.cover.before_row(tile_row)..self.cover.before_row(tile_row + 1) {
            let [column, _] = self.cover.tile_position(slot);
            for quad in 0..QUADS {
                let values = quad_of(slot, quad);
                let [x, y] = quad_origin(quad);
                let x = column * SIZE + x;
                for (k, row) in rows.chunks_exact_mut(self.width).skip(y).take(QUAD).enumerate() {
                    let len = QUAD.min(self.width.saturating_sub(x));
                    if len > 0 {
                        row[x..x + len].copy_from_slice(&values[k * QUAD..k * QUAD + len]);
                    }
                }
            }
        }
    }
}

/// Gradient of a [`Frame`]: `tile_len` quads for each covered tile.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameGrad {
    pub(crate) channels: usize,
    pub(crate) values: Buffer<Quad>,
}

impl FrameGrad {
    /// Planes row by row, like those of [`Frame::read`]; zero without a splat.
    pub(crate) fn read(&self, frame: &Frame, values: &mut [f32]) {
        let len = tile_len(self.channels);
        frame.read_planes(
            values,
            |_| 0.0,
            |slot, quad, channel| &self.values[slot * len + at(self.channels, quad, channel)],
        );
    }
}
