//! Gradient of compositing.
//!
//! Every tile-splat pair has a slot for its sums over the tile's pixels, at its emission index, so
//! that the slots of a Gaussian are adjacent. Pairs beyond the largest array are processed in
//! batches of emissions; every Gaussian adds its slots in the same order for any number of batches.
//!
//! If invocations own splats, a tile is divided into segments of splats, which are replayed in
//! parallel: the states of the pixels in front of them come from a first pass, which needs no sums.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        chunks::{Chunk, ChunkedArray, Chunking},
        context::Context,
        error::GpuError,
        kernel_set::KernelSet,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        bin::Tiles,
        blend::{BATCH, color, formulas::PixelBlock, pixels, round, staging},
        camera::{CameraUniform, camera},
        frame::{Frame, FrameGrad},
        project::{Splats, splat},
        shade::{Colors, channels},
    },
};
use core::ops::Range;
use formulas::{GEOMETRY, MOMENTS, MomentsVjp, PixelGrads, ReplayResume, ReplaySplat, ReplayStart, ReplayState};
use specula_core::{bin::TILE_SIZE, camera::Camera, scene::BLOCK};

pub mod formulas;

/// Numbers of workgroup memory, by the limits of WebGPU; a few words are reserved for counters.
const WORKGROUP_NUMBERS: usize = (16 * 1024 - 64) / 4;

/// Ownership of invocations in the replay. Results differ by rounding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplayBy {
    /// Invocations own blocks of pixels and iterate over the splats of a tile. The sums of each
    /// splat are reduced in workgroup memory. Larger blocks need fewer reductions, but more
    /// registers.
    Pixels(PixelBlock),
    /// Invocations own splats and iterate over the blocks of a tile's pixels. No reductions are
    /// needed, but every step ends with a barrier; larger blocks need fewer barriers, but more
    /// registers.
    Splats {
        /// Pixels of a step.
        block: PixelBlock,
        /// Invocations of a workgroup, at most one per block of a tile. More of them are idle in
        /// tiles of few splats.
        count: usize,
        /// Splats of a segment, a multiple of 64. Segments are replayed in parallel; longer ones
        /// have fewer idle invocations and fewer initial states.
        segment: usize,
    },
}

/// Division of the replay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplayDivision {
    /// Invocations.
    pub by: ReplayBy,
    /// Largest number of slots at a time, if they fit into an array. Results do not depend on it.
    pub slots_max: usize,
    /// Largest number of segments with stored states at a time, if they fit into an array.
    pub segments_max: usize,
}

impl ReplayDivision {
    /// Division of a set of kernels. On a software driver registers are cheap and barriers
    /// expensive; 32 invocations are a subgroup of most hardware.
    pub(crate) fn new(kernels: KernelSet) -> Self {
        let by = match kernels {
            KernelSet::Software => ReplayBy::Pixels(PixelBlock { width: 4, height: 4 }),
            KernelSet::Hardware => {
                ReplayBy::Splats { block: PixelBlock { width: 4, height: 1 }, count: 32, segment: BATCH }
            }
        };
        Self { by, slots_max: usize::MAX, segments_max: usize::MAX }
    }
}

/// Blocks of a tile.
fn block_count(block: PixelBlock) -> usize {
    (TILE_SIZE * TILE_SIZE) as usize / block.count()
}

/// Splats with sums in workgroup memory at the same time; each has a bit of a word, and one bit is
/// reserved.
fn splats_at_once(block: PixelBlock, channels: usize) -> usize {
    (WORKGROUP_NUMBERS / ((MOMENTS + channels) * (block_count(block) + 1))).min(31)
}

/// True if the gradients of a tile's pixels are in workgroup memory, next to their states.
fn keeps_grads(block: PixelBlock, channels: usize) -> bool {
    (channels.next_multiple_of(4) + 2) * block.count() * block_count(block) <= WORKGROUP_NUMBERS
}

/// Gradients of splats and their channels, in the block layout of Gaussians: `GEOMETRY` planes,
/// then the channels.
#[derive(Debug)]
pub struct SplatGrads {
    pub(crate) channels: usize,
    pub(crate) values: ChunkedArray,
}

uniform! {
    /// Emissions that have a slot.
    struct Batch {
        first: u32,
        end: u32,
    }
}

uniform! {
    /// Segments that are kept.
    struct Kept {
        first: u32,
        end: u32,
    }
}

uniform! {
    /// Emissions that have a slot, and the chunk of the sums.
    struct SlotBatch {
        first: u32,
        end: u32,
        first_gaussian: u32,
        /// End of the chunk, with the padding of its last block.
        gaussians_end: u32,
    }
}

/// Source of the replay of splats by `block`s of pixels, without bindings.
fn replay(block: PixelBlock, channel_count: usize) -> Source {
    Source::new()
        .real()
        .part(camera)
        .part(splat)
        .part(|source| channels(source, channel_count))
        .part(|source| pixels(source, block))
        .with(include_str!("replay.wgsl"))
        .part(|source| color(source, channel_count))
}

/// Source of the kernel that replays the splats of tiles or segments into slots.
pub(crate) fn replay_source(by: ReplayBy, channel_count: usize) -> String {
    let (ReplayBy::Pixels(block) | ReplayBy::Splats { block, .. }) = by;
    let slot = MOMENTS + channel_count;
    let source = replay(block, channel_count)
        .formula(&ReplaySplat { block, channels: channel_count })
        .count("SLOT", slot)
        .uniform::<Batch>()
        .with(include_str!("batch.wgsl"));
    let source = match by {
        ReplayBy::Pixels(_) => source
            .with(include_str!("start.wgsl"))
            .formula(&ReplayStart { block, channels: channel_count })
            .count("SPLATS_AT_ONCE", splats_at_once(block, channel_count))
            .with(include_str!("by_pixels.wgsl")),
        ReplayBy::Splats { count, .. } => {
            assert!(count <= block_count(block), "no two invocations have the same block in a step");
            let vectors = channel_count.div_ceil(4);
            let keeps_grads = keeps_grads(block, channel_count);
            let kept = if keeps_grads { vectors * block.count() } else { 0 };
            source
                .formula(&ReplayResume { block })
                .formula(&PixelGrads { block, channels: channel_count })
                .count("SPLATS", count)
                .flag("KEEPS_GRADS", keeps_grads)
                .with(include_str!("segments.wgsl"))
                .with(include_str!("by_splats.wgsl"))
                .unrolled("keep_grads(block: u32)", kept, |k| {
                    format!("grads[{k}u * BLOCKS + block] = pixel_grads[{k}];")
                })
                .unrolled("read_kept_grads(block: u32)", kept, |k| {
                    format!("pixel_grads[{k}] = grads[{k}u * BLOCKS + block];")
                })
                .unrolled("read_next_color(gaussian: u32)", vectors, |k| {
                    format!("next_color[{k}] = colors[gaussian * {vectors}u + {k}u];")
                })
                .unrolled("write_slot(first: u32)", slot, |k| format!("slots[first + {k}u] = sums[{k}];"))
        }
    };
    source.text()
}

/// Source of the kernel that replays the splats of tiles for the initial states of segments.
pub(crate) fn state_source(segment: usize, channel_count: usize) -> String {
    let block = ReplayState::BLOCK;
    replay(block, channel_count)
        .with(include_str!("start.wgsl"))
        .formula(&ReplayStart { block, channels: channel_count })
        .formula(&ReplayState { channels: channel_count })
        .count("SEGMENT", segment)
        .with(include_str!("segments.wgsl"))
        .part(|source| staging(source, channel_count))
        .uniform::<Kept>()
        .with(include_str!("states.wgsl"))
        .with(&round("replay_round", "replay_staged"))
        .text()
}

pub(crate) fn slot_source(channel_count: usize) -> String {
    let source = Source::new().real().part(camera).part(splat);
    let source = source.count("SLOT", MOMENTS + channel_count).count("MOMENTS", MOMENTS);
    source.formula(&MomentsVjp).uniform::<SlotBatch>().with(include_str!("slots.wgsl")).text()
}

/// Gradients of splats and channels from that of a frame.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn blend_vjp(
    context: &mut Context,
    division: ReplayDivision,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
    camera: &Camera,
) -> Result<SplatGrads, GpuError> {
    let channels = colors.channels;
    debug_assert_eq!((grad.size, grad.channels), (frame.size, channels), "gradients have the channels of the frame");
    let slot = GEOMETRY + channels;
    let chunking = Chunking::around(&context.gpu, slot, splats.chunk_len);
    let sums = context.allocate_chunks("gradients of splats", splats.count, chunking)?;
    let slots_at_once = division.slots_max.max(1).min((context.gpu.binding_max() / 4) as usize / slot);
    let slots = context.allocate("gradients of splats in tiles", tiles.count_max.min(slots_at_once) * slot)?;
    let view = CameraUniform::new(camera, splats.count);
    let segments = match division.by {
        ReplayBy::Pixels(_) => None,
        ReplayBy::Splats { segment, .. } => Some(Segments::new(context, segment, division.segments_max, tiles, &view)?),
    };
    let replay = Replay { by: division.by, splats, colors, tiles, frame, grad, slots, sums, segments, view };
    // Runs at least one batch, so all sums are written.
    for first in (0..tiles.count_max.max(1)).step_by(slots_at_once) {
        replay.run_batch(context, [first, (first + slots_at_once).min(tiles.count_max)], first == 0)?;
    }
    replay.finish(context)?;
    Ok(SplatGrads { channels, values: replay.sums })
}

/// Initial states of segments, a range at a time.
struct Segments {
    /// Splats of a segment.
    length: usize,
    /// Number of all segments, at most.
    count: usize,
    at_once: usize,
    segments: Array,
    states: Array,
}

/// Words of a segment, and of its initial states.
const SEGMENT_WORDS: usize = 4;
const STATE_WORDS: usize = 2 * (TILE_SIZE * TILE_SIZE) as usize;

impl Segments {
    fn new(
        context: &Context,
        length: usize,
        most: usize,
        tiles: &Tiles,
        view: &CameraUniform,
    ) -> Result<Self, GpuError> {
        // A first segment of each tile, and those that begin at multiples.
        let count = view.tile_count() + tiles.count_max.div_ceil(length);
        let at_once = most.max(1).min((context.gpu.binding_max() / 4) as usize / STATE_WORDS).min(count).max(1);
        Ok(Self {
            length,
            count,
            at_once,
            segments: context.allocate("segments of tiles", SEGMENT_WORDS * at_once)?,
            states: context.allocate("states of segments", STATE_WORDS * at_once)?,
        })
    }
}

/// Inputs and outputs of the replay.
struct Replay<'a> {
    by: ReplayBy,
    splats: &'a Splats,
    colors: &'a Colors,
    tiles: &'a Tiles,
    frame: &'a Frame,
    grad: &'a FrameGrad,
    slots: Array,
    sums: ChunkedArray,
    /// `None` if invocations own pixels.
    segments: Option<Segments>,
    view: CameraUniform,
}

impl Replay<'_> {
    /// Replays a range of emissions into their slots, and adds the slots to the sums.
    fn run_batch(&self, context: &mut Context, batch: [usize; 2], is_first: bool) -> Result<(), GpuError> {
        let [first, end] = batch.map(|emission| emission as u32);
        let batch = Batch { first, end };
        match &self.segments {
            None => {
                let others = [&self.tiles.ranges, &self.frame.blended];
                self.run_replay(context, batch, others, Dispatch::Grid(self.view.tiles()))?;
            }
            Some(segments) => {
                for first in (0..segments.count).step_by(segments.at_once) {
                    let end = (first + segments.at_once).min(segments.count);
                    if is_first || segments.at_once < segments.count {
                        self.run_states(context, segments, Kept { first: first as u32, end: end as u32 })?;
                    }
                    let others = [&segments.segments, &segments.states];
                    self.run_replay(context, batch, others, Dispatch::Workgroups(end - first))?;
                }
            }
        }
        let lanes = self.splats.count.next_multiple_of(BLOCK);
        for chunk in self.sums.chunks(self.splats.count) {
            self.run_slots(context, "sum_slots", batch, &chunk, lanes * (GEOMETRY + self.colors.channels))?;
        }
        Ok(())
    }

    /// Replays splats into the slots of a batch of emissions; `others` are bound after the arrays
    /// of every replay.
    fn run_replay(
        &self,
        context: &mut Context,
        batch: Batch,
        [first, second]: [&Array; 2],
        size: Dispatch,
    ) -> Result<(), GpuError> {
        let (by, channels) = (self.by, self.colors.channels);
        let bindings = [
            Uniform(self.view.bytes()),
            Uniform(batch.bytes()),
            Buffer(&self.splats.splats),
            Buffer(&self.colors.values),
            Buffer(&self.tiles.gaussians),
            Buffer(&self.tiles.emissions),
            Buffer(&self.grad.values),
            Buffer(&self.slots),
            Buffer(first),
            Buffer(second),
        ];
        let key = format!("{channels} channels, {by:?}");
        context.dispatch(&key, "blend_vjp", &|| replay_source(by, channels), &bindings, size)
    }

    /// Finds a range of segments, and the states in front of them.
    fn run_states(&self, context: &mut Context, segments: &Segments, kept: Kept) -> Result<(), GpuError> {
        let (length, channels) = (segments.length, self.colors.channels);
        context.clear(&segments.segments, 0);
        let bindings = [
            Uniform(self.view.bytes()),
            Uniform(kept.bytes()),
            Buffer(&self.splats.splats),
            Buffer(&self.colors.values),
            Buffer(&self.tiles.gaussians),
            Buffer(&self.grad.values),
            Buffer(&self.tiles.ranges),
            Buffer(&self.frame.blended),
            Buffer(&segments.segments),
            Buffer(&segments.states),
        ];
        let key = format!("{channels} channels, {length} splats");
        let size = Dispatch::Grid(self.view.tiles());
        context.dispatch(&key, "replay_states", &|| state_source(length, channels), &bindings, size)
    }

    /// Converts the moments to gradients, after all sums are complete.
    fn finish(&self, context: &mut Context) -> Result<(), GpuError> {
        for chunk in self.sums.chunks(self.splats.count) {
            self.run_slots(context, "finish_splats", Batch { first: 0, end: 0 }, &chunk, chunk.gaussians.len())?;
        }
        Ok(())
    }

    fn run_slots(
        &self,
        context: &mut Context,
        entry: &'static str,
        Batch { first, end }: Batch,
        chunk: &Chunk<'_>,
        invocations: usize,
    ) -> Result<(), GpuError> {
        let channels = self.colors.channels;
        let Range { start, end: gaussians_end } = chunk.gaussians;
        let gaussians_end = gaussians_end.next_multiple_of(BLOCK) as u32;
        let settings = SlotBatch { first, end, first_gaussian: start as u32, gaussians_end };
        let bindings = [
            Uniform(self.view.bytes()),
            Uniform(settings.bytes()),
            Buffer(&self.splats.splats),
            Buffer(&self.tiles.order),
            Buffer(&self.tiles.offsets),
            Buffer(&self.slots),
            Buffer(chunk.array),
        ];
        let key = format!("{channels} channels");
        context.dispatch(&key, entry, &|| slot_source(channels), &bindings, Dispatch::Invocations(invocations))
    }
}
