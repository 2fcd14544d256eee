//! Compositing of the splats of each tile, each pixel in its own order
//! ([`specula_core::cutoffs::BlendOrder`]).

use crate::{
    device::{context::Context, error::GpuError, memory::Array},
    stages::{
        bin::Tiles,
        blend::{Kernel, rasterise, rasteriser},
        frame::Frame,
        project::Splats,
        response::response,
        shade::Colors,
    },
};
use formulas::{AlphaOf, BlendAlpha, DepthAt, PIXEL};
use specula_core::camera::Camera;

pub mod formulas;

/// Splats selected by a pass of the exact order, limited by private memory.
const SELECTED: usize = 32;

/// Kernel of a window; without one, of the exact order.
pub(crate) fn source(channel_count: usize, window: Option<usize>) -> String {
    let source = rasteriser(PIXEL, channel_count)
        .part(response)
        .count("HITS", window.unwrap_or(SELECTED))
        .formula(&AlphaOf)
        .formula(&DepthAt)
        .formula(&BlendAlpha { channels: channel_count })
        .with(include_str!("hits.wgsl"));
    source.with(if window.is_some() { include_str!("window.wgsl") } else { include_str!("pixel.wgsl") }).text()
}

/// Composites the splats of all tiles, whose responses have these depths.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn blend_in_order(
    context: &mut Context,
    splats: &Splats,
    responses: &Array,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
    window: Option<usize>,
) -> Result<Frame, GpuError> {
    let channels = colors.channels;
    let kernel = Kernel {
        key: &format!("{channels} channels, window {window:?}"),
        entry: if window.is_some() { "blend_window" } else { "blend_pixel" },
        source: &|| source(channels, window),
        others: &[responses],
    };
    rasterise(context, splats, colors, tiles, camera, &kernel)
}
