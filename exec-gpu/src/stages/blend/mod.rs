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
use formulas::{BlendEnd, BlendSplat, BlendStart, PixelBlock};
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
        .with(include_str!("color.wgsl"))
}

/// Splats of a batch in workgroup memory: 8 KiB with 24 channels.
const BATCH: usize = 64;

pub(crate) fn source(kernels: KernelSet, channel_count: usize) -> String {
    let block = block_of(kernels);
    let source = rasteriser(block, channel_count).formula(&BlendSplat { block, channels: channel_count });
    let source = match kernels {
        KernelSet::Software => source.with(include_str!("blend.wgsl")),
        KernelSet::Hardware => source.count("BATCH", BATCH).with(include_str!("staged.wgsl")),
    };
    source.text()
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
) -> Result<Frame, GpuError> {
    let (kernels, channels) = (context.kernels, colors.channels);
    let kernel = Kernel {
        key: &format!("{channels} channels, {kernels:?}"),
        entry: "blend",
        source: &|| source(kernels, channels),
        others: &[],
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
