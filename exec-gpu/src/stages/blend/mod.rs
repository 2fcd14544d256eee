//! Compositing: the splats of each tile, front to back.
//!
//! An invocation composites a rectangle of pixels of a tile, in one traced formula without loops:
//! one pixel on hardware, where the splats of a tile pass through workgroup memory; sixteen on a
//! software driver, where reading a splat costs more than computing with it.

use crate::{
    codegen::{formula::type_of, source::Source},
    device::{
        context::Context,
        error::GpuError,
        kernel_set::KernelSet,
        kernels::{
            Binding::{self, Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        bin::Tiles,
        camera::{CameraUniform, camera},
        frame::Frame,
        project::{Splats, splat},
        shade::{Colors, channels},
    },
};
use core::iter;
use formulas::{BlendEnd, BlendSplat, BlendStart, EndPixels, PixelBlock, ReadSurfaces};
use specula_core::{camera::Camera, cutoffs::TRANSMITTANCE_MIN};

pub mod formulas;

/// Appends the assignment of a tile's pixels to invocations.
pub(crate) fn pixels(source: Source, block: PixelBlock) -> Source {
    source
        .with(&format!("alias Pixels = {};\n", type_of(block.count())))
        .count("BLOCK_WIDTH", block.width)
        .count("BLOCK_HEIGHT", block.height)
        .with(include_str!("pixels.wgsl"))
}

/// Appends the channels of the composited splat, and `read_color`, which reads those of a Gaussian.
pub(crate) fn color(source: Source, channel_count: usize) -> Source {
    let vectors = channel_count.div_ceil(4);
    source.with(include_str!("color.wgsl")).unrolled("read_color(gaussian: u32)", vectors, |k| {
        format!("color[{k}] = colors[gaussian * {vectors}u + {k}u];")
    })
}

/// Splats of a batch in workgroup memory: 8 KiB with 24 channels.
pub(crate) const BATCH: usize = 64;
/// Splats between two tests whether all pixels have terminated; divides [`BATCH`].
const SPLATS_A_ROUND: usize = 4;

/// Appends batches of splats in workgroup memory, and `read_staged_color`, which reads their
/// channels.
pub(crate) fn staging(source: Source, channel_count: usize) -> Source {
    let vectors = channel_count.div_ceil(4);
    source.count("BATCH", BATCH).count("SPLATS_A_ROUND", SPLATS_A_ROUND).with(include_str!("staging.wgsl")).unrolled(
        "read_staged_color(k: u32)",
        vectors,
        |vector| format!("color[{vector}] = staged_colors[k * {vectors}u + {vector}u];"),
    )
}

/// Source of a rasteriser: its inputs, the state of its pixels, and the picture.
pub(crate) fn rasteriser(block: PixelBlock, channel_count: usize) -> Source {
    Source::new()
        .real()
        .part(camera)
        .part(splat)
        .part(|source| channels(source, channel_count))
        .part(|source| pixels(source, block))
        .number("TRANSMITTANCE_MIN", TRANSMITTANCE_MIN)
        .formula(&BlendStart { block })
        .formula(&BlendEnd { block })
        .with(include_str!("rasteriser.wgsl"))
        .unrolled("store_channels(vector: u32, size: u32, index: u32)", channel_count, |c| {
            format!("frame[{c}u * size + index] = sums[vector + {}u].{};", c / 4, ["x", "y", "z", "w"][c % 4])
        })
        .part(|source| color(source, channel_count))
}

/// Appends the surfaces of another renderer, or none.
fn surfaces(source: Source, block: PixelBlock, is_occluded: bool) -> Source {
    if !is_occluded {
        return source.with(include_str!("no_surfaces.wgsl"));
    }
    let source = source.formula(&ReadSurfaces { block }).formula(&EndPixels { block });
    source.with(include_str!("surfaces.wgsl"))
}

pub(crate) fn source(kernels: KernelSet, channel_count: usize, is_occluded: bool) -> String {
    let block = block_of(kernels);
    let source = rasteriser(block, channel_count)
        .formula(&BlendSplat { block, channels: channel_count })
        .part(|source| surfaces(source, block, is_occluded));
    let source = match kernels {
        KernelSet::Software => source.with(include_str!("blend.wgsl")),
        KernelSet::Hardware => source
            .part(|source| staging(source, channel_count))
            .with(include_str!("staged.wgsl"))
            .with(&round("blend_round", "blend_staged")),
    };
    source.text()
}

/// Function that calls a step for each staged splat of a round; returns the last result.
pub(crate) fn round(name: &str, step: &str) -> String {
    let steps: String = (0..SPLATS_A_ROUND - 1).map(|k| format!("    {step}(first + {k}u, point);\n")).collect();
    let last = SPLATS_A_ROUND - 1;
    format!("fn {name}(first: u32, point: vec2f) -> f32 {{\n{steps}    return {step}(first + {last}u, point);\n}}\n")
}

/// Composites the splats of all tiles.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn blend(
    context: &mut Context,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
    occlusion: Option<&Array>,
) -> Result<Frame, GpuError> {
    let (kernels, channels, is_occluded) = (context.kernels, colors.channels, occlusion.is_some());
    let kernel = Kernel {
        key: &format!("{channels} channels, {kernels:?}, occluded {is_occluded}"),
        entry: "blend",
        source: &|| source(kernels, channels, is_occluded),
        others: occlusion.as_slice(),
    };
    rasterise(context, splats, colors, tiles, camera, &kernel)
}

/// Kernel of a rasteriser.
pub(crate) struct Kernel<'a> {
    /// Variant among the kernels of an entry point.
    pub(crate) key: &'a str,
    /// Entry point.
    pub(crate) entry: &'static str,
    /// Source.
    pub(crate) source: &'a dyn Fn() -> String,
    /// Arrays bound after those of every rasteriser.
    pub(crate) others: &'a [&'a Array],
}

/// Composites the splats of all tiles by a kernel.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn rasterise(
    context: &mut Context,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
    kernel: &Kernel<'_>,
) -> Result<Frame, GpuError> {
    let view = CameraUniform::new(camera, splats.count);
    let channels = colors.channels;
    let blended = context.allocate("channels of a picture", (channels + 1) * view.pixel_count())?;
    let arrays = [&splats.splats, &colors.values, &tiles.ranges, &tiles.gaussians, &blended];
    let arrays = arrays.into_iter().chain(kernel.others.iter().copied()).map(Buffer);
    let bindings: Vec<Binding<'_>> = iter::once(Uniform(view.bytes())).chain(arrays).collect();
    context.dispatch(kernel.key, kernel.entry, kernel.source, &bindings, Dispatch::Grid(view.tiles()))?;
    let size = [camera.width as usize, camera.height as usize];
    Ok(Frame { size, channels, blended, reflections: None, direct: None, shaded: None, exposed: None })
}

/// Pixels of an invocation. Hardware reads a splat once for all pixels of a tile; a software driver
/// amortises each read over many pixels.
fn block_of(kernels: KernelSet) -> PixelBlock {
    match kernels {
        KernelSet::Software => PixelBlock { width: 4, height: 4 },
        KernelSet::Hardware => PixelBlock { width: 1, height: 1 },
    }
}

/// Downloads a frame: its channels, with the final colour first, then the transmittance.
///
/// # Errors
///
/// See [`Context::download`].
pub(crate) fn read(context: &mut Context, frame: &Frame, values: &mut [f32]) -> Result<(), GpuError> {
    let other_color = frame.exposed.as_ref().or(frame.shaded.as_ref());
    let shown = other_color.map_or(0, |_| 3 * frame.pixel_count());
    let (colors, others) = values.split_at_mut(shown);
    if let Some(color) = other_color {
        context.download(color, 0, colors)?;
    }
    context.download(&frame.blended, shown, others)
}
