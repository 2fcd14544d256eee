//! Tiles that a splat touches.

use crate::codegen::source::Source;
use formulas::{OutlineOf, TileColumns, TileRows};

pub mod formulas;

/// Appends the tiles of a splat; needs the camera and the splat.
pub(crate) fn outline(source: Source) -> Source {
    source.formula(&OutlineOf).formula(&TileRows).formula(&TileColumns).with(include_str!("outline.wgsl"))
}
