//! Outline of a splat and the tiles that it touches.

use crate::codegen::formula::{Field, Inputs, fields, formula};
use specula_core::{
    bin::{TILE_SIZE, outline, span_in_rows, tile_range},
    real::Real,
    splat::{Footprint, Outline, ROOT_SCALE},
};

/// Outline as parameters or results, in the order of [`take_outline`].
fn outline_fields() -> Vec<Field> {
    fields!(center: 2, slope: 1, half_width: 2, extreme_y: 1, reach_y: 1)
}

/// Reads an outline from a formula's inputs.
fn take_outline<R: Real>(inputs: &mut Inputs<'_, R>) -> Outline<R> {
    Outline {
        center: inputs.array(),
        slope: inputs.number(),
        half_width: inputs.array(),
        extreme_y: inputs.number(),
        reach_y: inputs.number(),
    }
}

/// Outline of a splat in the form for compositing ([`specula_core::bin::outline`]).
#[derive(Clone, Copy, Debug)]
pub struct OutlineOf;

formula!(OutlineOf, |_, inputs| outline_of(mean2d: 2, root: 3, reach: 1) -> (..outline_fields()) {
    let (mean2d, root): ([R; 2], [R; 3]) = (inputs.array(), inputs.array());
    let footprint = Footprint { mean2d, root_conic: root.map(|x| x / ROOT_SCALE), reach: inputs.number() };
    let Outline { center, slope, half_width, extreme_y, reach_y } = outline(&footprint);
    (center, [slope], half_width, [extreme_y, reach_y])
});

/// Rows of tiles that a splat touches: the first, and one past the last
/// ([`specula_core::bin::tile_range`]).
#[derive(Clone, Copy, Debug)]
pub struct TileRows;

formula!(TileRows, |_, inputs| tile_rows(center_y: 1, half_height: 1, tiles: 2) -> (rows: 2) {
    let ([center, half], tiles) = (inputs.array(), inputs.array());
    tile_range(center - half, center + half, tiles)
});

/// Columns of tiles that an outline touches in a row ([`specula_core::bin::span_in_rows`]).
#[derive(Clone, Copy, Debug)]
pub struct TileColumns;

formula!(TileColumns, |_, inputs| tile_columns(..outline_fields(), row: 1, tiles: 2) -> (columns: 2) {
    let (outline, row, tiles) = (take_outline(inputs), inputs.number(), inputs.array());
    let top = row * TILE_SIZE as f32;
    let [left, right] = span_in_rows(&outline, top, top + TILE_SIZE as f32);
    tile_range(left, right, tiles)
});
