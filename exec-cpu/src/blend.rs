//! Tiles to a picture and back, a quad of four by four pixels at a time: most splats are small and round.

use crate::{
    bin::Tiles,
    buffer::{Buffer, Pool},
    frame::{Frame, FrameGrad, QUADS, Quad, tile_len},
    lanes::{Lanes, sum_each},
    machine::Machine,
    parts::{Pieces, each_part},
    project::{SplatRecord, Splats},
    shade::Colors,
    stamps::{SPLATS_AT_ONCE, SplatBatch, Stamps, centers_of},
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::{Simd, dispatch, prelude::*, u32x16};
use rayon::prelude::*;
use specula_core::{
    blend::{
        Composite, OffsetMoments, PixelState, Replay, StepGrad, log2_strength, moments_vjp, offset_from,
        offset_of_origin, step_vjp,
    },
    camera::Camera,
    cutoffs::Cutoffs,
    real::Real,
    rules::Channels,
    scene::BLOCK,
    splat::{Splat2d, SplatGrad},
};

/// Splats that are replayed at once: more is kept of each than on the way forth.
const REPLAYED_AT_ONCE: usize = 32;

/// Gradient of each splat and of its channels.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatGrads {
    pub(crate) channels: usize,
    /// Block by block, `GEOMETRY + channels` planes of [`BLOCK`] numbers: mean2d, root of the conic, opacity; channels.
    values: Buffer<f32>,
}

/// Numbers of a splat's gradient before its channels.
pub(crate) const GEOMETRY: usize = 6;

impl SplatGrads {
    /// Gradients with so many channels, as [`SplatGrads::values`] gives them.
    pub fn of_values(channels: usize, values: &[f32]) -> Self {
        let mut own = Pool::default().take(values.len());
        own.copy_from_slice(values);
        Self { channels, values: own }
    }
    /// How many channels there are.
    pub fn channel_count(&self) -> usize {
        self.channels
    }
    /// All numbers: block by block, plane by plane.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
    /// The gradient of one channel of one Gaussian: by linearity the sum over all pixels of the pixel's gradient, times
    /// the share that the Gaussian has of the pixel.
    pub fn of_channel(&self, gaussian: usize, channel: usize) -> f32 {
        self.block(gaussian / BLOCK)[(GEOMETRY + channel) * BLOCK + gaussian % BLOCK]
    }
    /// The planes of a block.
    pub(crate) fn block(&self, block: usize) -> &[f32] {
        let len = BLOCK * (GEOMETRY + self.channels);
        &self.values[block * len..(block + 1) * len]
    }
}

/// The most channels that a splat can have.
pub(crate) const CHANNELS_MAX: usize = Channels::Layers.count();

/// Calls a function that is generic over the number of channels.
macro_rules! with_channels {
    ($count:expr, $function:ident($($argument:expr),*)) => {
        match $count {
            3 => $function::<3>($($argument),*),
            8 => $function::<8>($($argument),*),
            10 => $function::<10>($($argument),*),
            12 => $function::<12>($($argument),*),
            _ => $function::<CHANNELS_MAX>($($argument),*),
        }
    };
}

pub(crate) fn blend_all(
    machine: &Machine,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
    cutoffs: &Cutoffs,
) -> Frame {
    match &splats.in_perspective {
        None => {
            with_channels!(colors.channels, blend_channels(machine, &splats.records, colors, tiles, camera, cutoffs))
        }
        Some(splats) => {
            with_channels!(colors.channels, blend_channels(machine, splats, colors, tiles, camera, cutoffs))
        }
    }
}

fn blend_channels<const C: usize>(
    machine: &Machine,
    splats: &[impl SplatBatch],
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
    cutoffs: &Cutoffs,
) -> Frame {
    let cover = tiles.cover.clone();
    let count = cover.tiles.len();
    let mut blended = machine.quads.take(count * tile_len(C));
    let mut seen = machine.bits.take(tiles.intersection_count());
    let (pixels_of, splats_of) = (|slot: usize| slot * tile_len(C), |slot: usize| tiles.start_of_covered(slot));
    let parts = (Pieces::new(&mut blended, &pixels_of), Pieces::new(&mut seen, &splats_of));
    each_part(count, parts, &|slot, (pixels, seen): (Pieces<'_, Quad>, Pieces<'_, u16>)| {
        let list = tiles.of_covered(slot);
        let origin = cover.origin(slot);
        dispatch!(machine.level, simd => {
            let (pixels, seen) = (pixels.only(), seen.only());
            blend_tile::<_, C, _>(simd, splats, &colors.values, list, origin, cutoffs, pixels, seen);
        });
    });
    let (width, height) = (camera.width as usize, camera.height as usize);
    Frame { width, height, channels: C, cover, blended, shaded: None, exposed: None, seen }
}

/// Visits the quads whose bits are set.
#[inline(always)]
fn for_each_bit(mut quads: u16, mut visit: impl FnMut(usize)) {
    while quads != 0 {
        visit(quads.trailing_zeros() as usize % QUADS);
        quads &= quads - 1;
    }
}

#[inline(always)]
fn blend_tile<S: Simd, const C: usize, T: SplatBatch>(
    simd: S,
    splats: &[T],
    colors: &[f32],
    list: &[AtomicU32],
    origin: [f32; 2],
    cutoffs: &Cutoffs,
    pixels: &mut [Quad],
    seen: &mut [u16],
) {
    let (channels, left) = pixels.split_at_mut(QUADS * C);
    channels.as_flattened_mut().fill(0.0);
    left.as_flattened_mut().fill(1.0);
    let (channels, left) = (channels.as_chunks_mut::<C>().0, &mut left[..QUADS]);
    let mut transmittance = [[1.0; BLOCK]; QUADS];
    let (mut stamps, mut near) = (T::Stamps::NONE, [[0.0; C]; SPLATS_AT_ONCE]);
    for (list, seen) in list.chunks(SPLATS_AT_ONCE).zip(seen.chunks_mut(SPLATS_AT_ONCE)) {
        if transmittance.iter().all(|quad| cutoffs.is_active(Lanes::load(simd, quad)).bits() == 0) {
            seen.fill(0);
            continue;
        }
        read_colors(&mut near, colors, list);
        let mut seen_by_quad = [0; QUADS];
        for (quad, splats) in stamps.read(simd, splats, origin, list, cutoffs).into_iter().enumerate() {
            let passage = [&mut transmittance[quad], &mut left[quad]];
            seen_by_quad[quad] = blend_quad(simd, &stamps, &near, quad, splats, cutoffs, &mut channels[quad], passage);
        }
        transpose_back(simd, &seen_by_quad, seen);
    }
}

/// Blends some splats into a quad, one after the other; returns a bit for each that was seen by a pixel that had not
/// ended. The quad stays in registers meanwhile.
#[inline(always)]
fn blend_quad<S: Simd, const C: usize>(
    simd: S,
    stamps: &impl Stamps,
    colors: &[[f32; C]; SPLATS_AT_ONCE],
    quad: usize,
    mut splats: u64,
    cutoffs: &Cutoffs,
    channels: &mut [Quad; C],
    [transmittance, left]: [&mut Quad; 2],
) -> u64 {
    let front = Lanes::load(simd, transmittance);
    let mut alive = cutoffs.is_active(front);
    if splats == 0 || alive.bits() == 0 {
        return 0;
    }
    // Pixels that have ended let nothing through: a product that is never looked at would become denormal, and slow.
    let mut passage = PixelState { transmittance: front.keep(alive), left: Lanes::load(simd, left) };
    let mut sums = [front; C];
    for c in 0..C {
        sums[c] = Lanes::load(simd, &channels[c]);
    }
    let centers = centers_of(simd, quad);
    let mut seen = 0;
    while splats != 0 {
        let k = splats.trailing_zeros() as usize % SPLATS_AT_ONCE;
        splats &= splats - 1;
        let strength = stamps.log2_strength(simd, k, centers);
        let Composite { weight, behind } = cutoffs.step(cutoffs.alpha(strength), passage);
        // Without a branch: whether a quad is touched is hard to foretell.
        seen |= u64::from((alive & cutoffs.passes_alpha_test(strength)).bits() != 0) << k;
        alive = cutoffs.is_active(behind.transmittance);
        passage = behind;
        for c in 0..C {
            sums[c] = weight.mul_add(Lanes::splat(simd, colors[k][c]), sums[c]);
        }
    }
    passage.transmittance.store(transmittance);
    passage.left.store(left);
    for c in 0..C {
        sums[c].store(&mut channels[c]);
    }
    seen
}

/// For each splat a bit for each quad, from a bit for each splat of each quad.
#[inline(always)]
fn transpose_back<S: Simd>(simd: S, splats: &[u64; QUADS], quads: &mut [u16]) {
    let zero = u32x16::splat(simd, 0);
    for (half, quads) in quads.chunks_mut(HALF_BITS).enumerate() {
        let splats = splats.map(|splats| (splats >> (half * HALF_BITS)) as u32);
        let splats = u32x16::from_slice(simd, &splats);
        for (k, quads) in quads.iter_mut().enumerate() {
            *quads = (splats & u32x16::splat(simd, 1 << k)).simd_gt(zero).to_bitmask() as u16;
        }
    }
}

/// Bits that a lane holds.
const HALF_BITS: usize = 32;

/// Some splats of a tile and their channels, side by side. Reading them all before the first is used lets the waits
/// for memory overlap.
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

#[inline(always)]
fn read_colors<const C: usize>(near: &mut [[f32; C]], colors: &[f32], list: &[AtomicU32]) {
    for (gaussian, color) in list.iter().zip(near) {
        let gaussian = gaussian.load(Relaxed) as usize;
        color.copy_from_slice(&colors[gaussian * C..(gaussian + 1) * C]);
    }
}

pub(crate) fn blend_all_vjp(
    machine: &Machine,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
) -> SplatGrads {
    with_channels!(colors.channels, blend_channels_vjp(machine, splats, colors, tiles, frame, grad))
}

fn blend_channels_vjp<const C: usize>(
    machine: &Machine,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
) -> SplatGrads {
    let width = GEOMETRY + C;
    let mut slots = machine.numbers.take(tiles.intersection_count() * width);
    let slots_of = |slot: usize| tiles.start_of_covered(slot) * width;
    each_part(frame.cover.tiles.len(), Pieces::new(&mut slots, &slots_of), &|slot, out: Pieces<'_, f32>| {
        let list = tiles.of_covered(slot);
        let seen = &frame.seen[tiles.start_of_covered(slot)..][..list.len()];
        let origin = frame.cover.origin(slot);
        let grad = &grad.values[slot * tile_len(C)..][..tile_len(C)];
        let pixels = frame.tile(slot);
        dispatch!(machine.level, simd => {
            blend_tile_vjp::<_, C>(simd, &splats.records, &colors.values, list, seen, origin, pixels, grad, out.only());
        });
    });
    SplatGrads { channels: C, values: sum_slots::<C>(machine, &slots, tiles) }
}

/// Each Gaussian sums the slots of its own intersections, in the order of their emission.
fn sum_slots<const C: usize>(machine: &Machine, slots: &[f32], tiles: &Tiles) -> Buffer<f32> {
    const BLOCKS_AT_ONCE: usize = 16;
    let count = tiles.emissions.len() - 1;
    let block_len = BLOCK * (GEOMETRY + C);
    let mut sums = machine.numbers.take(count.div_ceil(BLOCK) * block_len);
    sums.par_chunks_mut(BLOCKS_AT_ONCE * block_len).enumerate().for_each(|(part, sums)| {
        let blocks = part * BLOCKS_AT_ONCE..;
        dispatch!(machine.level, _simd => {
            for (block, sums) in blocks.zip(sums.chunks_exact_mut(block_len)) {
                for lane in 0..BLOCK {
                    sum_slots_of::<C>(block * BLOCK + lane, count, slots, tiles, &mut sums[lane..]);
                }
            }
        });
    });
    sums
}

/// Sums of known size, so that they stay in registers, into every [`BLOCK`]th place; zeros for what is not there.
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

/// Writes the slots of all splats: zeros for those that were not seen, so that nobody has to ask.
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

/// Replays one splat over the quads in which it was seen and writes its gradient. `weights` is memory to work in.
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
    let stamp = stamp_on_tile(simd, record, origin);
    let of_corner = offset_of_origin(&stamp);
    let color = color_lanes(simd, color);
    let zero = Lanes::splat(simd, 0.0);
    let mut moments = OffsetMoments::zero(zero);
    for_each_bit(seen, |index| {
        let offset = offset_from(of_corner, stamp.root, centers_of(simd, index));
        let quad = &mut replays[index];
        let along = dot_channels(simd, &color, &grad[index]);
        let replay = Replay {
            transmittance: Lanes::load(simd, &quad.transmittance),
            remaining: Lanes::load(simd, &quad.remaining),
        };
        let StepGrad { log_strength, weight, behind } =
            step_vjp(log2_strength(stamp.log2_opacity, offset), replay, along);
        behind.transmittance.store(&mut quad.transmittance);
        behind.remaining.store(&mut quad.remaining);
        weight.store(&mut weights[index]);
        moments = moments.with(log_strength, offset);
    });
    // Channels in a loop of their own: there are too many sums to keep all of them in registers at once.
    let mut grad_colors = [zero; C];
    for_each_bit(seen, |index| {
        let weight = Lanes::load(simd, &weights[index]);
        for c in 0..C {
            grad_colors[c] = weight.mul_add(Lanes::load(simd, &grad[index][c]), grad_colors[c]);
        }
    });
    let OffsetMoments { first, second, sum } = moments;
    let mut sums = [zero; GEOMETRY + CHANNELS_MAX];
    sums[..GEOMETRY].copy_from_slice(&[first[0], first[1], second[0], second[1], second[2], sum]);
    sums[GEOMETRY..GEOMETRY + C].copy_from_slice(&grad_colors);
    sum_each(&sums[..GEOMETRY + C], out);
    let moments = OffsetMoments { first: [out[0], out[1]], second: [out[2], out[3], out[4]], sum: out[5] };
    let stamp = Splat2d::new(record.mean2d, record.root_conic, record.log2_opacity);
    write_geometry(&moments_vjp(&stamp, record.opacity, &moments), out);
}

/// A splat's stamp in every lane, its mean from the tile's corner.
#[inline(always)]
fn stamp_on_tile<S: Simd>(simd: S, record: &SplatRecord, origin: [f32; 2]) -> Splat2d<Lanes<S>> {
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

/// What the pixels of a quad know while their splats are replayed.
#[derive(Clone, Copy)]
struct ReplayQuad {
    transmittance: Quad,
    remaining: Quad,
}

/// Pixels before their first splat: Σ g · C + g_T · T is what [`Replay::remaining`] starts with.
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
