//! Tiles to a picture and back, a quad of four by four pixels at a time: most splats are small and round.

use crate::{
    bin::Tiles,
    buffer::Buffer,
    frame::{Frame, FrameGrad, QUAD, QUADS, QUADS_ACROSS, Quad, SIZE, tile_len},
    lanes::{Lanes, sum_each},
    machine::Machine,
    parts::{Pieces, each_part},
    project::{SplatRecord, Splats},
    shade::Colors,
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    blend::{Moments, Replay, Stamp, alpha, falloff, may_be_seen, moments_vjp, stamp, step, step_vjp},
    camera::Camera,
    plan::Channels,
    project::SplatGrad,
    real::Real,
    scene::BLOCK,
};

/// Splats that a tile takes from memory at once, before it looks again whether all its pixels have ended.
const SPLATS_AT_ONCE: usize = 16;

/// Gradient of each splat and of its channels.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatGrads {
    pub(crate) channels: usize,
    /// `GEOMETRY + channels` numbers for each Gaussian: mean2d, root of the conic, opacity; channels.
    pub(crate) values: Buffer<f32>,
}

/// Numbers of a splat's gradient before its channels.
pub(crate) const GEOMETRY: usize = 6;

impl SplatGrads {
    /// Numbers for each Gaussian.
    pub(crate) fn width(&self) -> usize {
        GEOMETRY + self.channels
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

pub(crate) fn blend_all(machine: &Machine, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Frame {
    with_channels!(colors.channels, blend_channels(machine, splats, colors, tiles, camera))
}

fn blend_channels<const C: usize>(
    machine: &Machine,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
) -> Frame {
    let cover = tiles.cover.clone();
    let count = cover.tiles.len();
    let mut blended = machine.quads.take(count * tile_len(C));
    let mut seen = machine.bits.take(tiles.intersection_count());
    let (pixels_of, splats_of) = (|slot: usize| slot * tile_len(C), |slot: usize| tiles.start_of_covered(slot));
    let parts = (Pieces::new(&mut blended, &pixels_of), Pieces::new(&mut seen, &splats_of));
    each_part(count, parts, &|slot, (pixels, seen): (Pieces<'_, Quad>, Pieces<'_, u16>)| {
        let list = tiles.of_covered(slot);
        let origin = cover.place(slot).map(|tile| (tile * SIZE) as f32);
        dispatch!(machine.level, simd => {
            blend_tile::<_, C>(simd, &splats.records, &colors.values, list, origin, pixels.only(), seen.only());
        });
    });
    let (width, height) = (camera.width as usize, camera.height as usize);
    Frame { width, height, channels: C, cover, blended, shaded: None, seen }
}

/// A splat as the quads of a tile see it.
struct Stamped<S: Simd> {
    stamp: Stamp<f32>,
    lanes: Stamp<Lanes<S>>,
    /// From the splat's centre to the pixels of the tile's first quad.
    offset: [Lanes<S>; 2],
    /// From there to the first pixel of each quad.
    first: [Lanes<S>; 2],
}

impl<S: Simd> Stamped<S> {
    /// A bit for each quad that the splat may touch.
    #[inline(always)]
    fn quads_to_try(&self) -> u16 {
        const ACROSS: f32 = (QUAD - 1) as f32;
        let [x, y] = self.first;
        may_be_seen(&self.lanes, [x, x + ACROSS], [y, y + ACROSS]).bits() as u16
    }
    /// Visits some quads, each with the offsets of its pixels.
    #[inline(always)]
    fn for_each_quad(&self, mut quads: u16, mut visit: impl FnMut(usize, [Lanes<S>; 2])) {
        const OFFSETS: [f32; QUADS_ACROSS] = [0.0, QUAD as f32, 2.0 * QUAD as f32, 3.0 * QUAD as f32];
        while quads != 0 {
            let quad = quads.trailing_zeros() as usize % QUADS;
            quads &= quads - 1;
            visit(quad, [self.offset[0] + OFFSETS[quad % QUADS_ACROSS], self.offset[1] + OFFSETS[quad / QUADS_ACROSS]]);
        }
    }
}

#[inline(always)]
fn stamp_on_tile<S: Simd>(simd: S, record: &SplatRecord, origin: [f32; 2]) -> Stamped<S> {
    // Centres of the pixels of a quad, and of the first pixel of each quad.
    const X: [f32; BLOCK] = [0.5, 1.5, 2.5, 3.5, 0.5, 1.5, 2.5, 3.5, 0.5, 1.5, 2.5, 3.5, 0.5, 1.5, 2.5, 3.5];
    const Y: [f32; BLOCK] = [0.5, 0.5, 0.5, 0.5, 1.5, 1.5, 1.5, 1.5, 2.5, 2.5, 2.5, 2.5, 3.5, 3.5, 3.5, 3.5];
    const FIRST_X: [f32; BLOCK] = [0.5, 4.5, 8.5, 12.5, 0.5, 4.5, 8.5, 12.5, 0.5, 4.5, 8.5, 12.5, 0.5, 4.5, 8.5, 12.5];
    const FIRST_Y: [f32; BLOCK] = [0.5, 0.5, 0.5, 0.5, 4.5, 4.5, 4.5, 4.5, 8.5, 8.5, 8.5, 8.5, 12.5, 12.5, 12.5, 12.5];
    let stamp = stamp(record.mean2d, record.root_conic, record.log2_opacity);
    let splat = |value: f32| Lanes::splat(simd, value);
    let lanes = Stamp {
        mean2d: [splat(stamp.mean2d[0]), splat(stamp.mean2d[1])],
        root: [splat(stamp.root[0]), splat(stamp.root[1]), splat(stamp.root[2])],
        log2_opacity: splat(stamp.log2_opacity),
    };
    let center = [record.mean2d[0] - origin[0], record.mean2d[1] - origin[1]];
    Stamped {
        stamp,
        lanes,
        offset: [Lanes::from_array(simd, X) - center[0], Lanes::from_array(simd, Y) - center[1]],
        first: [Lanes::from_array(simd, FIRST_X) - center[0], Lanes::from_array(simd, FIRST_Y) - center[1]],
    }
}

#[inline(always)]
fn blend_tile<S: Simd, const C: usize>(
    simd: S,
    records: &[SplatRecord],
    colors: &[f32],
    list: &[AtomicU32],
    origin: [f32; 2],
    pixels: &mut [Quad],
    seen: &mut [u16],
) {
    let (channels, passed) = pixels.split_at_mut(QUADS * C);
    channels.as_flattened_mut().fill(0.0);
    passed.as_flattened_mut().fill(1.0);
    let (channels, passed) = (channels.as_chunks_mut::<C>().0, &mut passed[..QUADS]);
    let mut near = Near::<C>::none();
    for (list, seen) in list.chunks(SPLATS_AT_ONCE).zip(seen.chunks_mut(SPLATS_AT_ONCE)) {
        if !passed.iter().any(|quad| Lanes::load(simd, quad).any_positive()) {
            seen.fill(0);
            continue;
        }
        near.read(records, colors, list);
        for ((record, color), seen) in near.records.iter().zip(&near.colors).zip(seen) {
            *seen = blend_splat(simd, record, color, origin, channels, passed);
        }
    }
    // An ended pixel kept its transmittance with a minus sign.
    passed.as_flattened_mut().iter_mut().for_each(|passed| *passed = passed.abs());
}

/// Blends a splat into a tile; returns a bit for each quad in which it was seen.
#[inline(always)]
fn blend_splat<S: Simd, const C: usize>(
    simd: S,
    record: &SplatRecord,
    color: &[f32; C],
    origin: [f32; 2],
    channels: &mut [[Quad; C]],
    passed: &mut [Quad],
) -> u16 {
    let splat = stamp_on_tile(simd, record, origin);
    let color = color_lanes(simd, color);
    let mut seen = 0;
    splat.for_each_quad(splat.quads_to_try(), |quad, [dx, dy]| {
        let (pixels, passed) = (&mut channels[quad], &mut passed[quad]);
        let strength = falloff(&splat.lanes, dx, dy).strength;
        let transmittance = Lanes::load(simd, passed);
        let alpha = alpha(strength, transmittance);
        if !alpha.any_positive() {
            return;
        }
        seen |= 1 << quad;
        let step = step(alpha, transmittance);
        step.transmittance.store(passed);
        for c in 0..C {
            step.weight.mul_add(color[c], Lanes::load(simd, &pixels[c])).store(&mut pixels[c]);
        }
    });
    seen
}

/// Some splats of a tile and their channels, side by side. Reading them all before the first is used lets the waits
/// for memory overlap.
struct Near<const C: usize> {
    records: [SplatRecord; SPLATS_AT_ONCE],
    colors: [[f32; C]; SPLATS_AT_ONCE],
}

impl<const C: usize> Near<C> {
    #[inline(always)]
    fn none() -> Self {
        Self { records: [SplatRecord::default(); SPLATS_AT_ONCE], colors: [[0.0; C]; SPLATS_AT_ONCE] }
    }
    #[inline(always)]
    fn read(&mut self, records: &[SplatRecord], colors: &[f32], list: &[AtomicU32]) {
        for ((gaussian, record), color) in list.iter().zip(&mut self.records).zip(&mut self.colors) {
            let gaussian = gaussian.load(Relaxed) as usize;
            *record = records[gaussian];
            color.copy_from_slice(&colors[gaussian * C..(gaussian + 1) * C]);
        }
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
        let origin = frame.cover.place(slot).map(|tile| (tile * SIZE) as f32);
        let grad = &grad.values[slot * tile_len(C)..][..tile_len(C)];
        let pixels = frame.tile(slot);
        dispatch!(machine.level, simd => {
            blend_tile_vjp::<_, C>(simd, &splats.records, &colors.values, list, seen, origin, pixels, grad, out.only());
        });
    });
    SplatGrads { channels: C, values: sum_slots::<C>(machine, &slots, &frame.seen, tiles) }
}

/// Each Gaussian sums the slots of its own intersections, in the order of their emission.
fn sum_slots<const C: usize>(machine: &Machine, slots: &[f32], seen: &[u16], tiles: &Tiles) -> Buffer<f32> {
    let width = GEOMETRY + C;
    let mut sums = machine.numbers.take((tiles.emissions.len() - 1) * width);
    sums.par_chunks_mut(width).enumerate().with_min_len(256).for_each(|(gaussian, sum)| {
        sum.fill(0.0);
        for position in tiles.positions_of(gaussian) {
            if seen[position] != 0 {
                sum.iter_mut().zip(&slots[position * width..][..width]).for_each(|(sum, slot)| *sum += slot);
            }
        }
    });
    sums
}

/// Writes the slots of the splats that were seen.
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
    let out = out.chunks_mut(SPLATS_AT_ONCE * (GEOMETRY + C));
    for ((list, seen), out) in list.chunks(SPLATS_AT_ONCE).zip(seen.chunks(SPLATS_AT_ONCE)).zip(out) {
        if seen.iter().all(|quads| *quads == 0) {
            continue;
        }
        near.read(records, colors, list);
        let splats = near.records.iter().zip(&near.colors).zip(seen);
        for (((record, color), seen), out) in splats.zip(out.chunks_exact_mut(GEOMETRY + C)) {
            if *seen != 0 {
                splat_vjp(simd, record, color, *seen, origin, grad, &mut replays, out);
            }
        }
    }
}

/// Replays one splat over the quads in which it was seen and writes its gradient.
#[inline(always)]
fn splat_vjp<S: Simd, const C: usize>(
    simd: S,
    record: &SplatRecord,
    color: &[f32; C],
    seen: u16,
    origin: [f32; 2],
    grad: &[[Quad; C]],
    replays: &mut [ReplayQuad; QUADS],
    out: &mut [f32],
) {
    let splat = stamp_on_tile(simd, record, origin);
    let color = color_lanes(simd, color);
    let zero = Lanes::splat(simd, 0.0);
    // Moments, then the gradients of the channels.
    let mut sums = [zero; GEOMETRY + CHANNELS_MAX];
    splat.for_each_quad(seen, |index, [dx, dy]| {
        let (quad, pixels) = (&mut replays[index], &grad[index]);
        let falloff = falloff(&splat.lanes, dx, dy);
        let mut along = zero;
        for c in 0..C {
            along = color[c].mul_add(Lanes::load(simd, &pixels[c]), along);
        }
        let replay = Replay {
            transmittance: Lanes::load(simd, &quad.transmittance),
            remaining: Lanes::load(simd, &quad.remaining),
        };
        let (h, step, replay) = step_vjp(falloff.strength, replay, along);
        replay.transmittance.store(&mut quad.transmittance);
        replay.remaining.store(&mut quad.remaining);

        let (hu, hw) = (h * falloff.offset[0], h * falloff.offset[1]);
        sums[0] = sums[0] + hu;
        sums[1] = sums[1] + hw;
        sums[2] = hu.mul_add(dx, sums[2]);
        sums[3] = hw.mul_add(dx, sums[3]);
        sums[4] = hw.mul_add(dy, sums[4]);
        sums[5] = sums[5] + h;
        for c in 0..C {
            let sum = &mut sums[GEOMETRY + c];
            *sum = step.weight.mul_add(Lanes::load(simd, &pixels[c]), *sum);
        }
    });
    sum_each(&sums[..GEOMETRY + C], out);
    let moments = Moments { offset: [out[0], out[1]], root: [out[2], out[3], out[4]], strength: out[5] };
    write_geometry(&moments_vjp(&splat.stamp, record.opacity, &moments), out);
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
