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
use core::iter;
use formulas::{AlphaOf, BlendAlpha, DepthAt, IsHidden, PIXEL};
use specula_core::camera::Camera;

pub mod formulas;

/// Splats selected by a pass of the exact order, limited by private memory.
const SELECTED: usize = 32;

/// Kernel of a window; without one, of the exact order.
pub(crate) fn source(channel_count: usize, window: Option<usize>, is_occluded: bool) -> String {
    let source = rasteriser(PIXEL, channel_count)
        .part(response)
        .count("HITS", window.unwrap_or(SELECTED))
        .formula(&AlphaOf)
        .formula(&DepthAt)
        .formula(&IsHidden)
        .formula(&BlendAlpha { channels: channel_count })
        .with(if is_occluded { include_str!("surfaces.wgsl") } else { include_str!("no_surfaces.wgsl") })
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
    occlusion: Option<&Array>,
    window: Option<usize>,
) -> Result<Frame, GpuError> {
    let (channels, is_occluded) = (colors.channels, occlusion.is_some());
    let arrays: Vec<&Array> = iter::once(responses).chain(occlusion).collect();
    let kernel = Kernel {
        key: &format!("{channels} channels, window {window:?}, occluded {is_occluded}"),
        entry: if window.is_some() { "blend_window" } else { "blend_pixel" },
        source: &|| source(channels, window, is_occluded),
        others: &arrays,
    };
    rasterise(context, splats, colors, tiles, camera, &kernel)
}
