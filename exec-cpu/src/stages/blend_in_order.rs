//! Tiles to a picture, each pixel in its own order ([`specula_core::cutoffs::BlendOrder`]).
//!
//! A tile's list is in the order of means. For a batch of its splats at a time, a vector holds the
//! alphas and the depths of a splat in a quad; each pixel inserts its visible splats into a sorted
//! buffer. Splats are released from the front of a buffer: within a window as soon as it is full;
//! in the exact order, if they are in front of a lower bound of all remaining depths, so pixels end
//! as early as possible. Released splats are composited side by side in the lanes of the quad.
//! Their weights are kept, and channels are summed in the order of the list, one vector for a
//! splat, as in [`mod@crate::stages::blend`]: a window of one gives the same bits.

use crate::{
    frame::{Bits, QUADS, Quad},
    lanes::Lanes,
    stages::{
        project::ResponseRecord,
        response_batch::ResponseBatch,
        splat_batch::{BatchedSplat, SPLATS_AT_ONCE, SplatBatch, centers_of},
    },
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::{Level, Simd, dispatch};
use specula_core::{
    blend::{Composite, PixelState},
    cutoffs::Cutoffs,
    occlusion::is_hidden,
    real::Real,
    scene::BLOCK,
};

/// Splats of a tile, in a different order for each pixel.
pub(crate) struct Ordered<'a, T> {
    pub(crate) splats: &'a [T],
    pub(crate) responses: &'a [ResponseRecord],
    /// Channels of all Gaussians, and their number.
    pub(crate) colors: &'a [f32],
    pub(crate) channels: usize,
    /// Gaussians of the tile, by the depths of their means.
    pub(crate) list: &'a [AtomicU32],
    /// Corner of the tile.
    pub(crate) origin: [f32; 2],
    /// Depths of surfaces in front of splats, quad by quad.
    pub(crate) surfaces: Option<[Quad; QUADS]>,
    pub(crate) cutoffs: &'a Cutoffs,
}

/// Some splats of a list, relative to the tile.
struct Batch<B> {
    splats: B,
    responses: ResponseBatch,
    /// For each quad a bit for each splat that may touch it.
    near: [u64; QUADS],
}

impl<T: BatchedSplat> Ordered<'_, T> {
    #[inline(always)]
    fn batch<S: Simd>(&self, simd: S, index: usize) -> Batch<T::Batch> {
        let list = self.list.chunks(SPLATS_AT_ONCE).nth(index).unwrap_or_default();
        let mut splats = T::Batch::EMPTY;
        let near = splats.read(simd, self.splats, self.origin, list, self.cutoffs);
        Batch { splats, responses: ResponseBatch::read(self.responses, self.origin, list), near }
    }
}

/// Visible splat of a pixel.
#[derive(Clone, Copy)]
struct Hit {
    /// Depth of its largest response.
    depth: f32,
    alpha: f32,
    /// Position in the tile's list.
    position: u32,
}

/// Waiting and released splats of a pixel.
#[derive(Default)]
struct Waiting {
    /// Sorted in a window, otherwise in the order of the list.
    hits: Vec<Hit>,
    /// Lower bound of their depths.
    nearest: f32,
    /// Next splats to blend, nearest first.
    released: Vec<Hit>,
}

impl Waiting {
    /// Inserts a splat into a window, and releases the nearest of a full one.
    #[inline(always)]
    fn insert(&mut self, hit: Hit, window: usize) {
        let before = self.hits.iter().rev().take_while(|other| other.depth > hit.depth).count();
        self.hits.insert(self.hits.len() - before, hit);
        if self.hits.len() >= window {
            self.released.push(self.hits.remove(0));
        }
    }
    #[inline(always)]
    fn push(&mut self, hit: Hit) {
        self.nearest = if self.hits.is_empty() { hit.depth } else { self.nearest.min(hit.depth) };
        self.hits.push(hit);
    }
    /// Releases all splats that are not behind `depth`, a lower bound of the remaining depths.
    #[inline(always)]
    fn release_before(&mut self, depth: f32) {
        if self.hits.is_empty() || self.nearest > depth {
            return;
        }
        self.nearest = f32::INFINITY;
        let (released, nearest) = (&mut self.released, &mut self.nearest);
        self.hits.retain(|hit| {
            let stays = hit.depth > depth;
            if stays {
                *nearest = nearest.min(hit.depth);
            } else {
                released.push(*hit);
            }
            stays
        });
        self.released.sort_unstable_by(|a, b| a.depth.total_cmp(&b.depth).then(a.position.cmp(&b.position)));
    }
    /// Releases the rest.
    #[inline(always)]
    fn release_all(&mut self) {
        self.nearest = f32::NEG_INFINITY;
        self.release_before(f32::INFINITY);
    }
}

/// Blends the splats of a tile; writes to `seen`, splat by splat, a bit for each quad in which it
/// is visible.
pub(crate) fn blend_in_order<T: BatchedSplat>(
    level: Level,
    ordered: &Ordered<'_, T>,
    pixels: &mut [Quad],
    seen: &mut [u16],
) {
    dispatch!(level, simd => blend_tile(simd, ordered, pixels, seen));
}

#[inline(always)]
fn blend_tile<S: Simd, T: BatchedSplat>(simd: S, ordered: &Ordered<'_, T>, pixels: &mut [Quad], seen: &mut [u16]) {
    let (channels, last) = pixels.split_at_mut(QUADS * ordered.channels);
    let count = ordered.list.len().div_ceil(SPLATS_AT_ONCE);
    let window = ordered.cutoffs.order().window();
    let mut batches = Vec::with_capacity(count);
    let mut least_after = Vec::new();
    if window.is_none() {
        for index in 0..count {
            batches.push(ordered.batch(simd, index));
        }
        least_after = least_after_batches(simd, &batches, ordered.list.len());
    }
    let mut weights = vec![[0.0; BLOCK]; ordered.list.len()];
    let mut waiting: [Waiting; BLOCK] = core::array::from_fn(|_| Waiting::default());
    seen.fill(0);
    for quad in 0..QUADS {
        let mut turn = Turn { quad, weights: &mut weights, seen, state: PixelState::open(Lanes::splat(simd, 1.0)) };
        for index in 0..count {
            let alive = ordered.cutoffs.is_active(turn.state.transmittance);
            if alive.bits() == 0 {
                break;
            }
            // As in `blend_quad`: products of pixels that have ended would become denormal.
            turn.state.transmittance = turn.state.transmittance.keep(alive);
            if index == batches.len() {
                batches.push(ordered.batch(simd, index));
            }
            let batch = &batches[index];
            let centers = centers_of(simd, quad);
            let mut splats = batch.near[quad];
            while splats != 0 {
                let k = splats.trailing_zeros() as usize % SPLATS_AT_ONCE;
                splats &= splats - 1;
                let strength = batch.splats.log2_strength(simd, k, centers);
                let hits = (alive & ordered.cutoffs.passes_alpha_test(strength)).bits();
                if hits == 0 {
                    continue;
                }
                let alphas = ordered.cutoffs.alpha(strength).to_array();
                let depths = batch.responses.depth(simd, k, centers).to_array();
                let position = index * SPLATS_AT_ONCE + k;
                turn.weights[position] = [0.0; BLOCK];
                for lane in Bits(hits as u16) {
                    if ordered.surfaces.as_ref().is_some_and(|surfaces| is_hidden(depths[lane], surfaces[quad][lane])) {
                        continue;
                    }
                    let hit = Hit { depth: depths[lane], alpha: alphas[lane], position: position as u32 };
                    match window {
                        Some(window) => waiting[lane].insert(hit, window),
                        None => waiting[lane].push(hit),
                    }
                }
            }
            if let Some(least) = least_after.get(index) {
                waiting.iter_mut().for_each(|waiting| waiting.release_before(*least));
            }
            turn.blend(simd, &mut waiting, ordered.cutoffs);
        }
        waiting.iter_mut().for_each(Waiting::release_all);
        turn.blend(simd, &mut waiting, ordered.cutoffs);
        turn.state.final_transmittance.store(&mut last[quad]);
        let channels = &mut channels[quad * ordered.channels..][..ordered.channels];
        sum_channels(simd, ordered, quad, &weights, seen, channels);
    }
}

/// Lower bound of the depths of all splats after each batch of a list; infinite after the last.
#[inline(always)]
fn least_after_batches<S: Simd, B>(simd: S, batches: &[Batch<B>], len: usize) -> Vec<f32> {
    let mut after = vec![f32::INFINITY; batches.len()];
    for index in (1..batches.len()).rev() {
        let count = SPLATS_AT_ONCE.min(len - index * SPLATS_AT_ONCE);
        let least = batches[index].responses.least(simd);
        after[index - 1] = least[..count].iter().fold(after[index], |most, depth| most.min(*depth));
    }
    after
}

/// A quad during blending.
struct Turn<'a, S: Simd> {
    quad: usize,
    /// Weights of each splat of the list in the quad.
    weights: &'a mut [Quad],
    seen: &'a mut [u16],
    state: PixelState<Lanes<S>>,
}

impl<S: Simd> Turn<'_, S> {
    /// Blends the released splats, one of each pixel at a time.
    #[inline(always)]
    fn blend(&mut self, simd: S, waiting: &mut [Waiting; BLOCK], cutoffs: &Cutoffs) {
        let rounds = waiting.iter().map(|waiting| waiting.released.len()).max().unwrap_or(0);
        for round in 0..rounds {
            let alive = cutoffs.is_active(self.state.transmittance).bits();
            if alive == 0 {
                break;
            }
            let mut alphas = [0.0; BLOCK];
            for (alpha, waiting) in alphas.iter_mut().zip(waiting.iter()) {
                *alpha = waiting.released.get(round).map_or(0.0, |hit| hit.alpha);
            }
            let Composite { weight, behind } = cutoffs.step(Lanes::from_array(simd, alphas), self.state);
            self.state = behind;
            let weights = weight.to_array();
            for lane in Bits(alive as u16) {
                if let Some(hit) = waiting[lane].released.get(round) {
                    self.weights[hit.position as usize][lane] = weights[lane];
                    self.seen[hit.position as usize] |= 1 << self.quad;
                }
            }
        }
        waiting.iter_mut().for_each(|waiting| waiting.released.clear());
    }
}

/// Channels that are summed at once, each in a register.
const CHANNELS_AT_ONCE: usize = 4;

/// Channels of a quad from the weights of its splats, in the order of the list.
#[inline(always)]
fn sum_channels<S: Simd, T>(
    simd: S,
    ordered: &Ordered<'_, T>,
    quad: usize,
    weights: &[Quad],
    seen: &[u16],
    channels: &mut [Quad],
) {
    for (part, channels) in channels.chunks_mut(CHANNELS_AT_ONCE).enumerate() {
        let mut sums = [Lanes::splat(simd, 0.0); CHANNELS_AT_ONCE];
        let visible = seen.iter().zip(weights).zip(ordered.list).filter(|((seen, _), _)| **seen >> quad & 1 != 0);
        for ((_, weights), gaussian) in visible {
            let weight = Lanes::load(simd, weights);
            let first = gaussian.load(Relaxed) as usize * ordered.channels + part * CHANNELS_AT_ONCE;
            let colors = &ordered.colors[first..first + channels.len()];
            for (sum, color) in sums.iter_mut().zip(colors) {
                *sum = weight.mul_add(Lanes::splat(simd, *color), *sum);
            }
        }
        for (sum, channel) in sums.into_iter().zip(channels) {
            sum.store(channel);
        }
    }
}
