//! Tiles that a splat touches.

use crate::codegen::source::Source;

/// Appends the tiles of a splat; needs the camera and the splat.
pub(crate) fn outline(source: Source) -> Source {
    source.number("F32_MAX", f32::MAX).with(include_str!("outline.wgsl"))
}
