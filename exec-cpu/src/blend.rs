//! Tiles to a picture and back, a quad of four by four pixels at a time: most splats are small and round.

use crate::{
    bin::Tiles,
    lanes::{Lanes, sum_each},
    project::{SplatRecord, Splats},
    shade::Colors,
};
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    bin::TILE_SIZE,
    blend::{Moments, Replay, Stamp, alpha, falloff, may_be_seen, moments_vjp, stamp, step, step_vjp},
    camera::Camera,
    plan::Channels,
    project::SplatGrad,
    real::Real,
    scene::{BLOCK, Image},
};

/// Pixels along an edge of a tile.
const SIZE: usize = TILE_SIZE as usize;
/// Pixels along an edge of a quad, which has a pixel for each lane.
const QUAD: usize = 4;
/// Quads along an edge of a tile.
const QUADS: usize = SIZE / QUAD;
/// Splats that a tile takes from memory at once, before it looks again whether all its pixels have ended.
const SPLATS_AT_ONCE: usize = 16;

/// A blended picture: its channels, premultiplied, and the transmittance behind them.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Channels, then the transmittance as the last one.
    pub image: Image<Vec<f32>>,
}

impl Frame {
    /// Blended channels, without the transmittance.
    pub fn channel_count(&self) -> usize {
        self.image.channels - 1
    }
    /// The light that passes all splats, pixel by pixel.
    pub fn transmittance(&self) -> &[f32] {
        self.image.plane(self.image.channels - 1)
    }
}

/// Gradient of a [`Frame`], in the same planes.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameGrad {
    pub(crate) image: Image<Vec<f32>>,
}

/// Gradient of each splat and of its channels.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatGrads {
    pub(crate) channels: usize,
    /// `GEOMETRY + channels` numbers for each Gaussian: mean2d, root of the conic, opacity; channels.
    pub(crate) values: Vec<f32>,
}

/// Numbers of a splat's gradient before its channels.
pub(crate) const GEOMETRY: usize = 6;

impl SplatGrads {
    /// Numbers for each Gaussian.
    pub(crate) fn width(&self) -> usize {
        GEOMETRY + self.channels
    }
}

/// Four by four pixels of a tile, row by row.
#[derive(Clone, Copy)]
struct Quad<const C: usize> {
    channels: [[f32; BLOCK]; C],
    /// Transmittance; in a gradient, that of the transmittance.
    last: [f32; BLOCK],
}

impl<const C: usize> Quad<C> {
    fn new(transmittance: f32) -> Self {
        Self { channels: [[0.0; BLOCK]; C], last: [transmittance; BLOCK] }
    }
}

/// The pixels of one tile, quads in the order of rows.
type TilePixels<const C: usize> = [Quad<C>; QUADS * QUADS];

/// What a tile is blended into, out of the stack.
fn empty_tile<const C: usize>() -> Box<TilePixels<C>> {
    let quads = vec![Quad::new(1.0); QUADS * QUADS].into_boxed_slice();
    quads.try_into().unwrap_or_else(|_| unreachable!("there are as many"))
}

/// The most channels that a splat can have.
pub(crate) const CHANNELS_MAX: usize = Channels::Layers.count();

/// Calls a function that is generic over the number of channels.
macro_rules! with_channels {
    ($count:expr, $function:ident($($argument:expr),*)) => {
        match $count {
            3 => $function::<3>($($argument),*),
            8 => $function::<8>($($argument),*),
            12 => $function::<12>($($argument),*),
            _ => $function::<CHANNELS_MAX>($($argument),*),
        }
    };
}

pub(crate) fn blend_all(level: Level, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Frame {
    with_channels!(colors.channels, blend_channels(level, splats, colors, tiles, camera))
}

fn blend_channels<const C: usize>(
    level: Level,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    camera: &Camera,
) -> Frame {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut values = vec![0.0; (C + 1) * width * height];
    let columns = tiles.columns as usize;
    bands(&mut values, width * height, SIZE * width).into_par_iter().enumerate().for_each(|(row, mut band)| {
        let blend_one = |column: usize| {
            let list = &tiles.gaussians[tiles.of(row * columns + column)];
            let mut pixels = empty_tile::<C>();
            let origin = [column * SIZE, row * SIZE].map(|x| x as f32);
            dispatch!(level, simd => blend_tile(simd, &splats.records, &colors.values, list, origin, &mut pixels));
            pixels
        };
        let blended: Vec<_> = (0..columns).into_par_iter().map(blend_one).collect();
        for (column, pixels) in blended.iter().enumerate() {
            write_tile(pixels, column, width, &mut band);
        }
    });
    Frame { image: Image { width, height, channels: C + 1, values } }
}

/// Planes of `size` numbers cut into bands of `len`; each band with its share of every plane.
pub(crate) fn bands(values: &mut [f32], size: usize, len: usize) -> Vec<Vec<&mut [f32]>> {
    let mut bands: Vec<Vec<&mut [f32]>> = (0..size.div_ceil(len)).map(|_| Vec::new()).collect();
    for plane in values.chunks_mut(size.max(1)) {
        bands.iter_mut().zip(plane.chunks_mut(len)).for_each(|(band, part)| band.push(part));
    }
    bands
}

fn write_tile<const C: usize>(pixels: &TilePixels<C>, column: usize, width: usize, band: &mut [&mut [f32]]) {
    let start = column * SIZE;
    let len = SIZE.min(width - start);
    for (channel, rows) in band.iter_mut().enumerate() {
        for (y, row) in rows.chunks_exact_mut(width).enumerate() {
            for (column, to) in row[start..start + len].chunks_mut(QUAD).enumerate() {
                let quad = &pixels[y / QUAD * QUADS + column];
                let from = if channel < C { &quad.channels[channel] } else { &quad.last };
                let from = &from[y % QUAD * QUAD..];
                // An ended pixel keeps its transmittance with a minus sign; channels keep theirs.
                to.iter_mut().zip(from).for_each(|(to, x)| *to = if channel < C { *x } else { x.abs() });
            }
        }
    }
}

/// The pixels of a tile from a picture's planes; what lies outside the picture stays as it is.
fn read_tile<const C: usize>(image: &Image<Vec<f32>>, tile_column: usize, tile_row: usize, pixels: &mut TilePixels<C>) {
    let start = tile_column * SIZE;
    let len = SIZE.min(image.width - start);
    let rows = SIZE.min(image.height - tile_row * SIZE);
    for channel in 0..=C {
        let plane = image.plane(channel);
        for row in 0..rows {
            let from = (tile_row * SIZE + row) * image.width + start;
            for (column, from) in plane[from..from + len].chunks(QUAD).enumerate() {
                let quad = &mut pixels[row / QUAD * QUADS + column];
                let to = if channel < C { &mut quad.channels[channel] } else { &mut quad.last };
                to[row % QUAD * QUAD..][..from.len()].copy_from_slice(from);
            }
        }
    }
}

/// A splat as the quads of a tile see it.
struct Stamped<S: Simd> {
    stamp: Stamp<f32>,
    lanes: Stamp<Lanes<S>>,
    /// From the splat's centre to the pixels of the tile's first quad.
    offset: [Lanes<S>; 2],
    /// A bit for each quad that the splat may touch.
    quads: u64,
}

impl<S: Simd> Stamped<S> {
    /// The quads that the splat may touch, each with the offsets of its pixels.
    #[inline(always)]
    fn for_each_quad(&self, mut visit: impl FnMut(usize, [Lanes<S>; 2])) {
        const OFFSETS: [f32; QUADS] = [0.0, QUAD as f32, 2.0 * QUAD as f32, 3.0 * QUAD as f32];
        let mut quads = self.quads;
        while quads != 0 {
            let quad = quads.trailing_zeros() as usize % (QUADS * QUADS);
            quads &= quads - 1;
            visit(quad, [self.offset[0] + OFFSETS[quad % QUADS], self.offset[1] + OFFSETS[quad / QUADS]]);
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
    const ACROSS: f32 = (QUAD - 1) as f32;
    let stamp = stamp(record.mean2d, record.root_conic, record.log2_opacity);
    let splat = |value: f32| Lanes::splat(simd, value);
    let lanes = Stamp {
        mean2d: [splat(stamp.mean2d[0]), splat(stamp.mean2d[1])],
        root: [splat(stamp.root[0]), splat(stamp.root[1]), splat(stamp.root[2])],
        log2_opacity: splat(stamp.log2_opacity),
    };
    let center = [record.mean2d[0] - origin[0], record.mean2d[1] - origin[1]];
    let first = [Lanes::from_array(simd, FIRST_X) - center[0], Lanes::from_array(simd, FIRST_Y) - center[1]];
    let seen = may_be_seen(&lanes, [first[0], first[0] + ACROSS], [first[1], first[1] + ACROSS]);
    Stamped {
        stamp,
        lanes,
        offset: [Lanes::from_array(simd, X) - center[0], Lanes::from_array(simd, Y) - center[1]],
        quads: seen.bits(),
    }
}

#[inline(always)]
fn blend_tile<S: Simd, const C: usize>(
    simd: S,
    records: &[SplatRecord],
    colors: &[f32],
    list: &[u32],
    origin: [f32; 2],
    pixels: &mut TilePixels<C>,
) {
    let mut near = Near::<C>::none();
    for list in list.chunks(SPLATS_AT_ONCE) {
        if !pixels.iter().any(|quad| Lanes::load(simd, &quad.last).any_positive()) {
            break;
        }
        near.read(records, colors, list);
        for (record, color) in near.records.iter().zip(&near.colors).take(list.len()) {
            blend_splat(simd, record, color, origin, pixels);
        }
    }
}

#[inline(always)]
fn blend_splat<S: Simd, const C: usize>(
    simd: S,
    record: &SplatRecord,
    color: &[f32; C],
    origin: [f32; 2],
    pixels: &mut TilePixels<C>,
) {
    let splat = stamp_on_tile(simd, record, origin);
    let color = color_lanes(simd, color);
    splat.for_each_quad(|index, [dx, dy]| {
        let quad = &mut pixels[index];
        let strength = falloff(&splat.lanes, dx, dy).strength;
        let transmittance = Lanes::load(simd, &quad.last);
        let alpha = alpha(strength, transmittance);
        if !alpha.any_positive() {
            return;
        }
        let step = step(alpha, transmittance);
        step.transmittance.store(&mut quad.last);
        for c in 0..C {
            let pixel = &mut quad.channels[c];
            step.weight.mul_add(color[c], Lanes::load(simd, pixel)).store(pixel);
        }
    });
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
    fn read(&mut self, records: &[SplatRecord], colors: &[f32], list: &[u32]) {
        for ((gaussian, record), color) in list.iter().zip(&mut self.records).zip(&mut self.colors) {
            let gaussian = *gaussian as usize;
            *record = records[gaussian];
            color.copy_from_slice(&colors[gaussian * C..(gaussian + 1) * C]);
        }
    }
}

/// `slots` is memory to work in: a slot for each intersection. Whatever it holds before is overwritten.
pub(crate) fn blend_all_vjp(
    level: Level,
    slots: &mut Vec<f32>,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
) -> SplatGrads {
    with_channels!(colors.channels, blend_channels_vjp(level, slots, splats, colors, tiles, frame, grad))
}

fn blend_channels_vjp<const C: usize>(
    level: Level,
    slots: &mut Vec<f32>,
    splats: &Splats,
    colors: &Colors,
    tiles: &Tiles,
    frame: &Frame,
    grad: &FrameGrad,
) -> SplatGrads {
    let width = GEOMETRY + C;
    let columns = tiles.columns as usize;
    slots.resize(tiles.intersection_count() * width, 0.0);
    let mut by_tile: Vec<(usize, &mut [f32])> = Vec::with_capacity(tiles.starts.len() - 1);
    let mut rest = &mut slots[..];
    for tile in 0..tiles.starts.len() - 1 {
        let (own, others) = rest.split_at_mut(tiles.of(tile).len() * width);
        by_tile.push((tile, own));
        rest = others;
    }
    by_tile.into_par_iter().filter(|(_, out)| !out.is_empty()).for_each(|(tile, out)| {
        let (column, row) = (tile % columns, tile / columns);
        let list = &tiles.gaussians[tiles.of(tile)];
        let mut pixels = [[Quad::<C>::new(0.0); QUADS * QUADS]; 2];
        let [frame_pixels, grad_pixels] = &mut pixels;
        read_tile(&frame.image, column, row, frame_pixels);
        read_tile(&grad.image, column, row, grad_pixels);
        let origin = [column * SIZE, row * SIZE].map(|x| x as f32);
        dispatch!(level, simd => blend_tile_vjp(simd, &splats.records, &colors.values, list, origin, frame_pixels, grad_pixels, out));
    });
    SplatGrads { channels: C, values: sum_slots::<C>(slots, tiles) }
}

/// Each Gaussian sums the slots of its own intersections, in the order of their emission.
fn sum_slots<const C: usize>(slots: &[f32], tiles: &Tiles) -> Vec<f32> {
    let width = GEOMETRY + C;
    let mut sums = vec![0.0; (tiles.emissions.len() - 1) * width];
    sums.par_chunks_mut(width).enumerate().with_min_len(256).for_each(|(gaussian, sum)| {
        let own = tiles.emissions[gaussian] as usize..tiles.emissions[gaussian + 1] as usize;
        for position in &tiles.positions[own] {
            let start = *position as usize * width;
            sum.iter_mut().zip(&slots[start..start + width]).for_each(|(sum, slot)| *sum += slot);
        }
    });
    sums
}

#[inline(always)]
fn blend_tile_vjp<S: Simd, const C: usize>(
    simd: S,
    records: &[SplatRecord],
    colors: &[f32],
    list: &[u32],
    origin: [f32; 2],
    frame: &TilePixels<C>,
    grad: &TilePixels<C>,
    out: &mut [f32],
) {
    let mut replays = replays_at_start(simd, frame, grad);
    let mut near = Near::<C>::none();
    for (list, out) in list.chunks(SPLATS_AT_ONCE).zip(out.chunks_mut(SPLATS_AT_ONCE * (GEOMETRY + C))) {
        if !replays.iter().any(|quad| Lanes::load(simd, &quad.transmittance).any_positive()) {
            out.fill(0.0);
            continue;
        }
        near.read(records, colors, list);
        for ((record, color), out) in near.records.iter().zip(&near.colors).zip(out.chunks_exact_mut(GEOMETRY + C)) {
            splat_vjp(simd, record, color, origin, grad, &mut replays, out);
        }
    }
}

/// Replays one splat over the quads of a tile and writes its gradient.
#[inline(always)]
fn splat_vjp<S: Simd, const C: usize>(
    simd: S,
    record: &SplatRecord,
    color: &[f32; C],
    origin: [f32; 2],
    grad: &TilePixels<C>,
    replays: &mut [ReplayQuad; QUADS * QUADS],
    out: &mut [f32],
) {
    let splat = stamp_on_tile(simd, record, origin);
    let color = color_lanes(simd, color);
    let zero = Lanes::splat(simd, 0.0);
    // Moments, then the gradients of the channels.
    let mut sums = [zero; GEOMETRY + CHANNELS_MAX];
    splat.for_each_quad(|index, [dx, dy]| {
        let (quad, pixels) = (&mut replays[index], &grad[index]);
        let falloff = falloff(&splat.lanes, dx, dy);
        let before = Lanes::load(simd, &quad.transmittance);
        if !alpha(falloff.strength, before).any_positive() {
            return;
        }
        let mut along = zero;
        for c in 0..C {
            along = color[c].mul_add(Lanes::load(simd, &pixels.channels[c]), along);
        }
        let replay = Replay { transmittance: before, remaining: Lanes::load(simd, &quad.remaining) };
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
            *sum = step.weight.mul_add(Lanes::load(simd, &pixels.channels[c]), *sum);
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
    transmittance: [f32; BLOCK],
    remaining: [f32; BLOCK],
}

/// Pixels before their first splat: Σ g · C + g_T · T is what [`Replay::remaining`] starts with.
#[inline(always)]
fn replays_at_start<S: Simd, const C: usize>(
    simd: S,
    frame: &TilePixels<C>,
    grad: &TilePixels<C>,
) -> [ReplayQuad; QUADS * QUADS] {
    let mut replays = [ReplayQuad { transmittance: [1.0; BLOCK], remaining: [0.0; BLOCK] }; QUADS * QUADS];
    for ((replay, frame), grad) in replays.iter_mut().zip(frame).zip(grad) {
        let mut sum = Lanes::load(simd, &frame.last) * Lanes::load(simd, &grad.last);
        for c in 0..C {
            sum = Lanes::load(simd, &frame.channels[c]).mul_add(Lanes::load(simd, &grad.channels[c]), sum);
        }
        sum.store(&mut replay.remaining);
    }
    replays
}
