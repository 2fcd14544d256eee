//! Gradients of splats and their channels: tiles are replayed front to back, a quad at a time.
//!
//! Each splat visits the quads in which it was visible in the forward pass, and the lanes of all
//! its gradients are summed at once, with neighbours added pairwise.

use crate::{
    buffer::Buffer,
    context::Context,
    frame::{Bits, Frame, FrameGrad, QUADS, Quad, tile_len},
    lanes::{Lanes, sum_each},
    parts::{Pieces, each_part},
    stages::{
        bin::Tiles,
        blend::{CHANNELS_MAX, read_colors, with_channels},
        project::{SplatRecord, Splats},
        shade::Colors,
        splat_batch::centers_of,
    },
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    blend::{
        OffsetMoments, Replay, StepGrad, center_vjp, log2_strength, moments_vjp, offset_from, offset_of_origin,
        step_vjp,
    },
    real::Real,
    scene::BLOCK,
    splat::{Splat2d, SplatGrad},
};

/// Splats that are replayed at once: fewer than in the forward pass, because each needs more state.
const REPLAYED_AT_ONCE: usize = 32;

/// Gradient of each splat and of its channels.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatGrads {
    pub(crate) channels: usize,
    /// Block by block, `GEOMETRY + channels` planes of [`BLOCK`] numbers: mean2d, root of the
    /// conic, opacity; channels.
    values: Buffer<f32>,
}

/// Numbers of a splat's gradient before its channels.
pub(crate) const GEOMETRY: usize = 6;

impl SplatGrads {
    #[cfg(feature = "testing")]
    /// Creates gradients with this number of channels from values in the order of
    /// [`SplatGrads::values`].
    pub fn of_values(channels: usize, values: &[f32]) -> Self {
        let mut buffer = crate::buffer::Pool::default().take(values.len());
        buffer.copy_from_slice(values);
        Self { channels, values: buffer }
    }
    #[cfg(feature = "testing")]
    /// Number of channels.
    pub fn channel_count(&self) -> usize {
        self.channels
    }
    #[cfg(feature = "testing")]
    /// All numbers: block by block, plane by plane.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
    /// The gradient of one channel of one Gaussian: by linearity the sum over all pixels of the
    /// pixel's gradient times the Gaussian's weight in it.
    pub fn of_channel(&self, gaussian: usize, channel: usize) -> f32 {
        self.block(gaussian / BLOCK)[(GEOMETRY + channel) * BLOCK + gaussian % BLOCK]
    }
    /// Gaussians with a gradient, and those that fill the last block up.
    pub(crate) fn count(&self) -> usize {
        self.values.len() / (GEOMETRY + self.channels)
    }
    /// The gradient of one splat, without that of its channels.
    pub(crate) fn of_splat(&self, gaussian: usize) -> SplatGrad<f32> {
        let planes = self.block(gaussian / BLOCK);
        let number = |plane: usize| planes[plane * BLOCK + gaussian % BLOCK];
        SplatGrad {
            mean2d: [number(0), number(1)],
            root_conic: [number(2), number(3), number(4)],
            depth: 0.0,
            opacity: number(5),
        }
    }
    /// The planes of a block.
    pub(crate) fn block(&self, block: usize) -> &[f32] {
        let len = BLOCK * (GEOMETRY + self.channels);
        &self.values[block * len..(block + 1) * len]
    }
}

/// Some splats of a tile and their channels, side by side. Reading all of them before the first use
/// overlaps the memory latencies.
struct Near<const C: usize> {
    records: [SplatRecord; REPLAYED_AT_ONCE],
    colors: [[f32; C]; REPLAYED_AT_ONCE],
}

impl<const C: usize> Near<C> {
    #[inline(always)]
    fn none() -> Self {
        Self { records: [SplatRecord::default(); REPLAYED_AT_ONCE], colors: [[0.0; C]; REPLAYED_AT_ONCE] }
    }
    #[inline(always)]
    fn read(&mut self, records: &[SplatRecord], colors: &[f32], list: &[AtomicU32]) {
        for (gaussian, record) in list.iter().zip(&mut self.records) {
            *record = records[gaussian.load(Relaxed) as usize];
        }
        read_colors(&mut self.colors, colors, list);
    }
}

pub(crate) fn blend_all_vjp(
    context: &Context,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
) -> SplatGrads {
    with_channels!(colors.channels, blend_channels_vjp(context, splats, colors, tiles, frame, grad))
}

fn blend_channels_vjp<const C: usize>(
    context: &Context,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
) -> SplatGrads {
    let width = GEOMETRY + C;
    let mut slots = context.take::<f32>(tiles.intersection_count() * width);
    let slots_of = |slot: usize| tiles.start_of_covered(slot) * width;
    each_part(frame.cover.tiles.len(), Pieces::new(&mut slots, &slots_of), &|slot, out: Pieces<'_, f32>| {
        let list = tiles.of_covered(slot);
        let seen = &frame.seen[tiles.start_of_covered(slot)..][..list.len()];
        let origin = frame.cover.origin(slot);
        let grad = &grad.values[slot * tile_len(C)..][..tile_len(C)];
        let pixels = frame.tile(slot);
        dispatch!(context.level, simd => {
            blend_tile_vjp::<_, C>(simd, &splats.records, &colors.values, list, seen, origin, pixels, grad, out.only());
        });
    });
    SplatGrads { channels: C, values: sum_slots::<C>(context, &slots, tiles) }
}

/// Each Gaussian sums the slots of its own intersections, in the order of their emission.
fn sum_slots<const C: usize>(context: &Context, slots: &[f32], tiles: &Tiles) -> Buffer<f32> {
    const BLOCKS_AT_ONCE: usize = 16;
    let count = tiles.emissions.len() - 1;
    let block_len = BLOCK * (GEOMETRY + C);
    let mut sums = context.take::<f32>(count.div_ceil(BLOCK) * block_len);
    sums.par_chunks_mut(BLOCKS_AT_ONCE * block_len).enumerate().for_each(|(part, sums)| {
        let blocks = part * BLOCKS_AT_ONCE..;
        dispatch!(context.level, _simd => {
            for (block, sums) in blocks.zip(sums.chunks_exact_mut(block_len)) {
                for lane in 0..BLOCK {
                    sum_slots_of::<C>(block * BLOCK + lane, count, slots, tiles, &mut sums[lane..]);
                }
            }
        });
    });
    sums
}

/// Sums of known size, so that they stay in registers, into every [`BLOCK`]th place; zeros for
/// missing ones.
#[inline(always)]
fn sum_slots_of<const C: usize>(gaussian: usize, count: usize, slots: &[f32], tiles: &Tiles, out: &mut [f32]) {
    let (mut geometry, mut channels) = ([0.0; GEOMETRY], [0.0; C]);
    if gaussian < count {
        for position in tiles.positions_of(gaussian) {
            let slot = &slots[position * (GEOMETRY + C)..][..GEOMETRY + C];
            for k in 0..GEOMETRY {
                geometry[k] += slot[k];
            }
            for c in 0..C {
                channels[c] += slot[GEOMETRY + c];
            }
        }
    }
    for k in 0..GEOMETRY {
        out[k * BLOCK] = geometry[k];
    }
    for c in 0..C {
        out[(GEOMETRY + c) * BLOCK] = channels[c];
    }
}

/// Writes the slots of all splats, zeros for those that never passed the alpha test, so sums need
/// no mask.
#[inline(always)]
fn blend_tile_vjp<S: Simd, const C: usize>(
    simd: S,
    records: &[SplatRecord],
    colors: &[f32],
    list: &[AtomicU32],
    seen: &[u16],
    origin: [f32; 2],
    pixels: &[Quad],
    grad: &[Quad],
    out: &mut [f32],
) {
    let mut replays = replays_at_start::<S, C>(simd, pixels, grad);
    let grad = grad[..QUADS * C].as_chunks::<C>().0;
    let mut near = Near::<C>::none();
    let mut weights = [[0.0; BLOCK]; QUADS];
    let out = out.chunks_mut(REPLAYED_AT_ONCE * (GEOMETRY + C));
    for ((list, seen), out) in list.chunks(REPLAYED_AT_ONCE).zip(seen.chunks(REPLAYED_AT_ONCE)).zip(out) {
        if seen.iter().all(|quads| *quads == 0) {
            out.fill(0.0);
            continue;
        }
        near.read(records, colors, list);
        let splats = near.records.iter().zip(&near.colors).zip(seen);
        for (((record, color), seen), out) in splats.zip(out.chunks_exact_mut(GEOMETRY + C)) {
            if *seen == 0 {
                out.fill(0.0);
            } else {
                splat_vjp(simd, record, color, *seen, origin, grad, &mut replays, &mut weights, out);
            }
        }
    }
}

/// Replays one splat over the quads in which it was visible and writes its gradient. `weights` is
/// scratch memory.
#[inline(always)]
fn splat_vjp<S: Simd, const C: usize>(
    simd: S,
    record: &SplatRecord,
    color: &[f32; C],
    seen: u16,
    origin: [f32; 2],
    grad: &[[Quad; C]],
    replays: &mut [ReplayQuad; QUADS],
    weights: &mut [Quad; QUADS],
    out: &mut [f32],
) {
    let splat = splat_on_tile(simd, record, origin);
    let at_corner = offset_of_origin(&splat);
    let color = color_lanes(simd, color);
    let zero = Lanes::splat(simd, 0.0);
    let mut moments = OffsetMoments::zero(zero);
    for index in Bits(seen) {
        let offset = offset_from(at_corner, splat.root, centers_of(simd, index));
        let along = dot_channels(simd, &color, &grad[index]);
        let [log_strength, weight] = replays[index].step(simd, log2_strength(splat.log2_opacity, offset), along);
        weight.store(&mut weights[index]);
        moments = moments.with(log_strength, offset);
    }
    // Channels in a separate loop, because not all sums fit into registers.
    let mut grad_colors = [zero; C];
    for index in Bits(seen) {
        let weight = Lanes::load(simd, &weights[index]);
        for c in 0..C {
            grad_colors[c] = weight.mul_add(Lanes::load(simd, &grad[index][c]), grad_colors[c]);
        }
    }
    let OffsetMoments { first, second, sum } = moments;
    let mut sums = [zero; GEOMETRY + CHANNELS_MAX];
    sums[..GEOMETRY].copy_from_slice(&[first[0], first[1], second[0], second[1], second[2], sum]);
    sums[GEOMETRY..GEOMETRY + C].copy_from_slice(&grad_colors);
    sum_each(&sums[..GEOMETRY + C], out);
    let moments = OffsetMoments { first: [out[0], out[1]], second: [out[2], out[3], out[4]], sum: out[5] };
    let splat = Splat2d::new(record.mean2d, record.root_conic, record.log2_opacity);
    write_geometry(&moments_vjp(&splat, record.opacity, &moments), out);
}

/// The splat in every lane, its mean relative to the tile's corner.
#[inline(always)]
fn splat_on_tile<S: Simd>(simd: S, record: &SplatRecord, origin: [f32; 2]) -> Splat2d<Lanes<S>> {
    let splat = |value: f32| Lanes::splat(simd, value);
    let ([x, y], [xx, yx, yy]) = (record.mean2d, record.root_conic);
    let mean2d = [splat(x - origin[0]), splat(y - origin[1])];
    Splat2d::new(mean2d, [splat(xx), splat(yx), splat(yy)], splat(record.log2_opacity))
}

/// Σ color · grad over the channels of a quad, as two sums side by side.
#[inline(always)]
fn dot_channels<S: Simd, const C: usize>(simd: S, color: &[Lanes<S>; C], grad: &[Quad; C]) -> Lanes<S> {
    let mut sums = [Lanes::splat(simd, 0.0); 2];
    for c in 0..C {
        sums[c % 2] = color[c].mul_add(Lanes::load(simd, &grad[c]), sums[c % 2]);
    }
    sums[0] + sums[1]
}

/// A splat's channels, each in every lane.
#[inline(always)]
fn color_lanes<S: Simd, const C: usize>(simd: S, color: &[f32; C]) -> [Lanes<S>; C] {
    let mut lanes = [Lanes::splat(simd, 0.0); C];
    for c in 0..C {
        lanes[c] = Lanes::splat(simd, color[c]);
    }
    lanes
}

#[inline(always)]
fn write_geometry(grad: &SplatGrad<f32>, out: &mut [f32]) {
    out[..2].copy_from_slice(&grad.mean2d);
    out[2..5].copy_from_slice(&grad.root_conic);
    out[5] = grad.opacity;
}

/// State of the pixels of a quad in the backward pass.
#[derive(Clone, Copy)]
struct ReplayQuad {
    transmittance: Quad,
    remaining: Quad,
}

impl ReplayQuad {
    /// Replays a splat: the gradient of the logarithm of its strength, and its weight.
    #[inline(always)]
    fn step<S: Simd>(&mut self, simd: S, log2_strength: Lanes<S>, along: Lanes<S>) -> [Lanes<S>; 2] {
        let replay = Replay {
            transmittance: Lanes::load(simd, &self.transmittance),
            remaining: Lanes::load(simd, &self.remaining),
        };
        let StepGrad { log_strength, weight, behind } = step_vjp(log2_strength, replay, along);
        behind.transmittance.store(&mut self.transmittance);
        behind.remaining.store(&mut self.remaining);
        [log_strength, weight]
    }
}

/// Pixels before their first splat: Σ g · C + g_T · T is the initial [`Replay::remaining`].
#[inline(always)]
fn replays_at_start<S: Simd, const C: usize>(simd: S, pixels: &[Quad], grad: &[Quad]) -> [ReplayQuad; QUADS] {
    let mut replays = [ReplayQuad { transmittance: [1.0; BLOCK], remaining: [0.0; BLOCK] }; QUADS];
    for (quad, replay) in replays.iter_mut().enumerate() {
        let last = QUADS * C + quad;
        let mut sum = Lanes::load(simd, &pixels[last]) * Lanes::load(simd, &grad[last]);
        for k in quad * C..(quad + 1) * C {
            sum = Lanes::load(simd, &pixels[k]).mul_add(Lanes::load(simd, &grad[k]), sum);
        }
        sum.store(&mut replay.remaining);
    }
    replays
}

/// Sums over the pixels of the absolute gradients of the splats' centres, one for each Gaussian.
pub(crate) fn absolute_center_grads(
    context: &Context,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
    sums: &mut [[f32; 2]],
) {
    with_channels!(colors.channels, absolute_grads(context, splats, colors, tiles, frame, grad, sums));
}

fn absolute_grads<const C: usize>(
    context: &Context,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
    sums: &mut [[f32; 2]],
) {
    let mut slots = context.take::<[f32; 2]>(tiles.intersection_count());
    let slots_of = |slot: usize| tiles.start_of_covered(slot);
    each_part(frame.cover.tiles.len(), Pieces::new(&mut slots, &slots_of), &|slot, out: Pieces<'_, [f32; 2]>| {
        let list = tiles.of_covered(slot);
        let seen = &frame.seen[tiles.start_of_covered(slot)..][..list.len()];
        let origin = frame.cover.origin(slot);
        let grad = &grad.values[slot * tile_len(C)..][..tile_len(C)];
        let pixels = frame.tile(slot);
        dispatch!(context.level, simd => {
            let mut replays = replays_at_start::<_, C>(simd, pixels, grad);
            let grad = grad[..QUADS * C].as_chunks::<C>().0;
            for ((gaussian, seen), out) in list.iter().zip(seen).zip(out.only()) {
                let gaussian = gaussian.load(Relaxed) as usize;
                let color = colors.values[gaussian * C..].first_chunk::<C>().expect("a Gaussian has all channels");
                *out = absolute_splat_grad(simd, &splats.records[gaussian], color, *seen, origin, grad, &mut replays);
            }
        });
    });
    sums.par_iter_mut().enumerate().for_each(|(gaussian, sum)| {
        *sum = tiles.positions_of(gaussian).fold([0.0; 2], |[x, y], at| [x + slots[at][0], y + slots[at][1]]);
    });
}

/// Replays one splat over the quads in which it was visible; sums the absolute gradients of its
/// centre.
#[inline(always)]
fn absolute_splat_grad<S: Simd, const C: usize>(
    simd: S,
    record: &SplatRecord,
    color: &[f32; C],
    seen: u16,
    origin: [f32; 2],
    grad: &[[Quad; C]],
    replays: &mut [ReplayQuad; QUADS],
) -> [f32; 2] {
    let splat = splat_on_tile(simd, record, origin);
    let at_corner = offset_of_origin(&splat);
    let color = color_lanes(simd, color);
    let mut sums = [Lanes::splat(simd, 0.0); 2];
    for index in Bits(seen) {
        let offset = offset_from(at_corner, splat.root, centers_of(simd, index));
        let along = dot_channels(simd, &color, &grad[index]);
        let [log_strength, _] = replays[index].step(simd, log2_strength(splat.log2_opacity, offset), along);
        let center = center_vjp(&splat, offset.map(|x| log_strength * x));
        sums = [sums[0] + center[0].abs(), sums[1] + center[1].abs()];
    }
    sums.map(Lanes::sum)
}
