//! Planes of a picture, tile by tile and row by row: inputs of the losses over windows.

use crate::{
    buffer::Buffer,
    context::Context,
    frame::{QUAD, Quad, SIZE, quad_origin},
};

/// A row of a tile.
pub(crate) type Row = [f32; SIZE];
/// A row of a tile with half a row of each neighbour.
pub(crate) type WideRow = [f32; 2 * SIZE];
/// Start of the tile in a [`WideRow`].
pub(crate) const CENTER: usize = SIZE / 2;

/// Some planes of a grid of tiles.
pub(crate) struct Planes {
    columns: usize,
    rows: usize,
    count: usize,
    values: Buffer<Row>,
}

impl Planes {
    /// Takes `count` planes of a grid of tiles, uninitialised.
    pub(crate) fn new(context: &Context, [columns, rows]: [usize; 2], count: usize) -> Self {
        Self { columns, rows, count, values: context.take::<Row>(columns * rows * count * SIZE) }
    }
    /// All planes, row of tiles by row of tiles, and the start of each row of tiles. In a row of
    /// tiles one plane follows another, and [`plane_start`] is the start of a tile in each.
    pub(crate) fn parts(&mut self) -> (&mut [Row], impl Fn(usize) -> usize + Sync + use<>) {
        let len = self.columns * self.count * SIZE;
        (&mut self.values, move |row| row * len)
    }
    /// A plane of a tile.
    #[inline(always)]
    pub(crate) fn plane(&self, [column, row]: [usize; 2], plane: usize) -> &[Row] {
        let row_start = row * self.columns * self.count * SIZE;
        &self.values[row_start + plane_start(self.columns, plane, column)..][..SIZE]
    }
    /// Rows of a plane in the columns of a tile, the same number above as below, as in
    /// [`Planes::read_window`].
    #[inline(always)]
    pub(crate) fn rows_around<const ROWS: usize>(
        &self,
        [column, row]: [usize; 2],
        plane: usize,
        is_written: impl Fn(usize) -> bool,
    ) -> [&Row; ROWS] {
        let mut rows = [&[0.0; SIZE]; ROWS];
        for (down, (first, count, from)) in bands(ROWS).into_iter().enumerate() {
            // Above the first row this wraps to an index beyond any grid.
            let tile_row = (row + down).wrapping_sub(1);
            if tile_row < self.rows && is_written(tile_row * self.columns + column) {
                let source = &self.plane([column, tile_row], plane)[from..from + count];
                rows[first..first + count].iter_mut().zip(source).for_each(|(to, row)| *to = row);
            }
        }
        rows
    }
    /// A plane of a tile with some rows above and below and half a row to the left and right, into
    /// `window`: `ROWS` is [`SIZE`] plus the rows above and below. Outside of the picture, and in
    /// tiles that were not written, everything is zero.
    #[inline(always)]
    pub(crate) fn read_window<const ROWS: usize>(
        &self,
        [column, row]: [usize; 2],
        plane: usize,
        is_written: impl Fn(usize) -> bool,
        window: &mut [WideRow; ROWS],
    ) {
        for (down, (first, count, from)) in bands(ROWS).into_iter().enumerate() {
            let rows = &mut window[first..first + count];
            for across in 0..3 {
                // Beyond the first row or column these wrap to indices beyond any grid.
                let (tile_column, tile_row) = ((column + across).wrapping_sub(1), (row + down).wrapping_sub(1));
                let is_inside = tile_column < self.columns && tile_row < self.rows;
                if is_inside && is_written(tile_row * self.columns + tile_column) {
                    let source = &self.plane([tile_column, tile_row], plane)[from..from + count];
                    copy_part(across, rows, source);
                } else {
                    copy_part(across, rows, &[[0.0; SIZE]; SIZE][..count]);
                }
            }
        }
    }
}

/// For the row of tiles above, the tile's own and the one below: first of the `rows` window rows
/// that it fills, their number, and the first row of the source tile.
const fn bands(rows: usize) -> [(usize, usize, usize); 3] {
    let reach = (rows - SIZE) / 2;
    [(0, reach, SIZE - reach), (reach, SIZE, 0), (reach + SIZE, reach, 0)]
}

/// Part of wide rows from one tile: the left neighbour, the tile itself, or the right one.
#[inline(always)]
fn copy_part(across: usize, rows: &mut [WideRow], source: &[Row]) {
    let rows = rows.iter_mut().zip(source);
    match across {
        0 => rows.for_each(|(to, from)| to[..CENTER].copy_from_slice(&from[SIZE - CENTER..])),
        1 => rows.for_each(|(to, from)| to[CENTER..CENTER + SIZE].copy_from_slice(from)),
        _ => rows.for_each(|(to, from)| to[CENTER + SIZE..].copy_from_slice(&from[..CENTER])),
    }
}

/// Start of a tile's plane in a row of tiles.
#[inline(always)]
pub(crate) const fn plane_start(columns: usize, plane: usize, column: usize) -> usize {
    (plane * columns + column) * SIZE
}

/// Stores a quad into a plane of a tile.
#[inline(always)]
pub(crate) fn store_quad(plane: &mut [Row], quad: usize, values: &Quad) {
    let [x, y] = quad_origin(quad);
    for k in 0..QUAD {
        plane[y + k][x..x + QUAD].copy_from_slice(&values[k * QUAD..(k + 1) * QUAD]);
    }
}
