//! Planes of a picture, tile by tile and row by row: what windows look at.

use crate::{
    buffer::Buffer,
    frame::{QUAD, Quad, SIZE, quad_origin},
    machine::Machine,
};

/// A row of a tile.
pub(crate) type Row = [f32; SIZE];
/// A row of a tile with half a row of each neighbour.
pub(crate) type WideRow = [f32; 2 * SIZE];
/// Where the tile itself begins in a [`WideRow`].
pub(crate) const CENTER: usize = SIZE / 2;

/// Some planes of a grid of tiles.
pub(crate) struct Planes {
    columns: usize,
    rows: usize,
    count: usize,
    values: Buffer<Row>,
}

impl Planes {
    /// So many planes of a grid of tiles, holding whatever the memory held before.
    pub(crate) fn new(machine: &Machine, [columns, rows]: [usize; 2], count: usize) -> Self {
        Self { columns, rows, count, values: machine.quads.take(columns * rows * count * SIZE) }
    }
    /// All planes, row of tiles by row of tiles, and where each row of tiles begins. There a plane follows another, and
    /// in each [`place_in_row`] says where a tile lies.
    pub(crate) fn parts(&mut self) -> (&mut [Row], impl Fn(usize) -> usize + Sync + use<>) {
        let len = self.columns * self.count * SIZE;
        (&mut self.values, move |row| row * len)
    }
    /// A plane of a tile.
    #[inline(always)]
    pub(crate) fn plane(&self, [column, row]: [usize; 2], plane: usize) -> &[Row] {
        let row_start = row * self.columns * self.count * SIZE;
        &self.values[row_start + place_in_row(self.columns, plane, column)..][..SIZE]
    }
    /// A plane of a tile with `REACH` rows above and below and half a row to the left and right. Beyond the picture,
    /// and in tiles that nobody wrote, everything is zero. `ROWS` is [`SIZE`] + 2 · `REACH`.
    #[inline(always)]
    pub(crate) fn window<const ROWS: usize>(
        &self,
        [column, row]: [usize; 2],
        plane: usize,
        is_written: impl Fn(usize) -> bool,
    ) -> [WideRow; ROWS] {
        let reach = (ROWS - SIZE) / 2;
        let mut window = [[0.0; 2 * SIZE]; ROWS];
        for tile_row in row.saturating_sub(1)..(row + 2).min(self.rows) {
            // Rows of the window that this row of tiles fills, and the first of its own that they show.
            let (first, count, from) = match tile_row + 1 - row {
                0 => (0, reach, SIZE - reach),
                1 => (reach, SIZE, 0),
                _ => (reach + SIZE, reach, 0),
            };
            for tile_column in column.saturating_sub(1)..(column + 2).min(self.columns) {
                if !is_written(tile_row * self.columns + tile_column) {
                    continue;
                }
                let own = &self.plane([tile_column, tile_row], plane)[from..from + count];
                let rows = window[first..first + count].iter_mut().zip(own);
                match tile_column + 1 - column {
                    0 => rows.for_each(|(to, from)| to[..CENTER].copy_from_slice(&from[SIZE - CENTER..])),
                    1 => rows.for_each(|(to, from)| to[CENTER..CENTER + SIZE].copy_from_slice(from)),
                    _ => rows.for_each(|(to, from)| to[CENTER + SIZE..].copy_from_slice(&from[..CENTER])),
                }
            }
        }
        window
    }
}

/// Where a tile's plane lies in a row of tiles.
#[inline(always)]
pub(crate) const fn place_in_row(columns: usize, plane: usize, column: usize) -> usize {
    (plane * columns + column) * SIZE
}

/// A quad into a plane of a tile.
#[inline(always)]
pub(crate) fn put_quad(plane: &mut [Row], quad: usize, values: &Quad) {
    let [x, y] = quad_origin(quad);
    for k in 0..QUAD {
        plane[y + k][x..x + QUAD].copy_from_slice(&values[k * QUAD..(k + 1) * QUAD]);
    }
}
