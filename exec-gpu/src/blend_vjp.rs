//! The gradient of blending.
//!
//! Every splat of every tile has a slot for its sums over the tile's pixels, at the number that it was emitted with, so
//! that a Gaussian's slots lie side by side. Where there are more than an array holds, emissions take turns; every
//! Gaussian adds its slots in the same order, however many turns there are.

use crate::{
    bin::Tiles,
    blend::Frame,
    device::{Gpu, GpuError},
    executor::GpuExecutor,
    formulas::{blend::PixelBlock, blend_vjp::MOMENTS},
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    pieces::{Division, Piece, Pieces},
    project::Splats,
    shade::Colors,
    source,
    view::View,
};
use core::ops::Range;
use specula_core::{bin::TILE_SIZE, camera::Camera, executor::Renderer, scene::BLOCK};
use wgpu::DeviceType;

/// Numbers of a splat's gradient before those of its channels: mean2d (2), root of the conic (3), opacity (1).
pub const GEOMETRY: usize = 6;

/// Memory of a workgroup that is left for sums, in numbers, by the limits of WebGPU.
const SUMS_MAX: usize = (16 * 1024 - 64) / 4;

/// How the work is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplayParts {
    /// The pixels of an invocation, a part of a tile: the more there are, the fewer sums go through the workgroup's
    /// memory, but the more has to stay in registers.
    pub block: PixelBlock,
    /// Most splats of tiles whose gradients are kept at once, if an array holds so many. Results do not depend on it.
    pub slots_max: usize,
}

impl ReplayParts {
    /// What is fastest. A program that computes on the CPU has registers to spare, compared with what its memory costs.
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let block = match gpu.info().device_type {
            DeviceType::Cpu => PixelBlock { width: 4, height: 4 },
            _ => PixelBlock { width: 2, height: 2 },
        };
        Self { block, slots_max: usize::MAX }
    }
}

/// Splats whose sums go through the workgroup's memory at once; each has a bit of a word, which has one to spare.
pub(crate) fn splats_at_once(block: PixelBlock, channels: usize) -> usize {
    let invocations = (TILE_SIZE * TILE_SIZE) as usize / block.count();
    (SUMS_MAX / ((MOMENTS + channels) * (invocations + 1))).min(31)
}

/// Gradient of a [`Frame`], plane by plane: what is blended, then the transmittance.
#[derive(Debug)]
pub struct FrameGrad {
    pub(crate) size: [usize; 2],
    pub(crate) channels: usize,
    pub(crate) values: Array,
}

/// Gradients of splats and their channels, in blocks as Gaussians are: [`GEOMETRY`] planes, then the channels.
#[derive(Debug)]
pub struct SplatGrads {
    pub(crate) channels: usize,
    pub(crate) values: Pieces,
}

impl FrameGrad {
    /// A gradient of so many channels, which lie as [`FrameGrad`] says.
    pub fn new(size: [usize; 2], channels: usize, values: Pieces) -> Self {
        Self { size, channels, values: values.into_whole() }
    }
}

impl SplatGrads {
    /// Gradients with so many channels, which lie as [`SplatGrads`] says.
    pub fn new(channels: usize, values: Pieces) -> Self {
        Self { channels, values }
    }
}

impl GpuExecutor {
    /// How the way back through blending is divided.
    pub fn replay_parts(&self) -> ReplayParts {
        self.machine.replay_parts
    }

    /// Divides the way back through blending otherwise.
    pub fn set_replay_parts(&mut self, parts: ReplayParts) {
        self.machine.replay_parts = parts;
    }

    /// Gradients of splats on the host, as [`SplatGrads`] lie.
    pub fn read_splat_grads(&mut self, grads: &SplatGrads) -> Result<Vec<f32>, GpuError> {
        let mut values = vec![0.0; grads.values.len()];
        self.download(&grads.values, &mut values)?;
        Ok(values)
    }
}

pub(crate) fn blend_vjp(
    machine: &mut Machine,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
    camera: &Camera,
) -> Result<SplatGrads, GpuError> {
    let channels = colors.channels;
    debug_assert_eq!((grad.size, grad.channels), (frame.size, channels), "gradients are of what was blended");
    let slot = GEOMETRY + channels;
    let division = Division::around(&machine.gpu, slot, splats.gaussians_each);
    let sums = machine.take_pieces("gradients of splats", splats.count, division)?;
    let slots_at_once = machine.replay_parts.slots_max.max(1).min((machine.gpu.binding_max() / 4) as usize / slot);
    let slots = machine.take("gradients of splats in tiles", tiles.count_max.min(slots_at_once) * slot)?;
    let way = Way { splats, colors, tiles, frame, grad, slots, sums, view: View::new(camera, splats.count) };
    // At least once, so that all sums are written.
    for first in (0..tiles.count_max.max(1)).step_by(slots_at_once) {
        way.run_batch(machine, [first, (first + slots_at_once).min(tiles.count_max)])?;
    }
    way.finish(machine)?;
    Ok(SplatGrads { channels, values: way.sums })
}

/// What the way back reads and writes.
struct Way<'a> {
    splats: &'a Splats,
    colors: &'a Colors,
    tiles: &'a Tiles,
    frame: &'a Frame,
    grad: &'a FrameGrad,
    slots: Array,
    sums: Pieces,
    view: View,
}

impl Way<'_> {
    /// Emissions from the first to before the last: to their slots, and from there to the sums.
    fn run_batch(&self, machine: &mut Machine, batch: [usize; 2]) -> Result<(), GpuError> {
        let batch = batch.map(|emission| emission as u32);
        let channels = self.colors.channels;
        let bound = [
            Uniform(self.view.bytes()),
            Uniform(bytemuck::cast_slice(&batch)),
            Of(&self.splats.splats),
            Of(&self.colors.values),
            Of(&self.tiles.ranges),
            Of(&self.tiles.gaussians),
            Of(&self.tiles.emissions),
            Of(&self.frame.blended),
            Of(&self.grad.values),
            Of(&self.slots),
        ];
        let block = machine.replay_parts.block;
        let key = format!("{channels} channels, {block:?}");
        machine.run(
            &key,
            "blend_vjp",
            &|| source::blend_vjp(block, channels),
            &bound,
            Groups::Grid(self.view.tiles()),
        )?;
        let lanes = self.splats.count.next_multiple_of(BLOCK);
        for piece in self.sums.of(self.splats.count) {
            self.run_slots(machine, "sum_slots", batch, &piece, lanes * (GEOMETRY + channels))?;
        }
        Ok(())
    }

    /// From moments to gradients, once all sums are there.
    fn finish(&self, machine: &mut Machine) -> Result<(), GpuError> {
        for piece in self.sums.of(self.splats.count) {
            self.run_slots(machine, "finish_splats", [0; 2], &piece, piece.gaussians.len())?;
        }
        Ok(())
    }

    fn run_slots(
        &self,
        machine: &mut Machine,
        entry: &'static str,
        [first, end]: [u32; 2],
        piece: &Piece<'_>,
        invocations: usize,
    ) -> Result<(), GpuError> {
        let channels = self.colors.channels;
        let Range { start, end: gaussians_end } = piece.gaussians;
        let settings = [first, end, start as u32, gaussians_end.next_multiple_of(BLOCK) as u32];
        let bound = [
            Uniform(self.view.bytes()),
            Uniform(bytemuck::cast_slice(&settings)),
            Of(&self.splats.splats),
            Of(&self.tiles.order),
            Of(&self.tiles.offsets),
            Of(&self.slots),
            Of(piece.array),
        ];
        let key = format!("{channels} channels");
        machine.run(&key, entry, &|| source::slots(channels), &bound, Groups::For(invocations))
    }
}
