//! Batches of splats, relative to a tile, as structures of arrays: a vector holds one number of
//! many splats.

use crate::{
    frame::{PIXEL_X, PIXEL_Y, QUAD, QUADS, QUADS_ACROSS, Quad, quad_origin},
    lanes::Lanes,
    stages::project::{PerspectiveRecord, SplatRecord},
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::Simd;
use specula_core::{
    blend::{column_of, log2_strength, offset_from, offset_of_origin},
    cutoffs::Cutoffs,
    perspective::{self, Perspective, may_overlap, ray_scale, ray_scale_of_origin, scaled_curvature},
    real::Real,
    scene::BLOCK,
    splat::Splat2d,
};

/// Splats per batch, one bit each; after a batch a tile tests whether all its pixels have ended.
pub(crate) const SPLATS_AT_ONCE: usize = u64::BITS as usize;

/// One number of each splat.
type Numbers = [f32; SPLATS_AT_ONCE];

/// Record of a splat for blending.
pub(crate) trait BatchedSplat: Sync {
    /// Batch of such records.
    type Batch: SplatBatch<Splat = Self>;
}

impl BatchedSplat for SplatRecord {
    type Batch = AffineBatch;
}

impl BatchedSplat for PerspectiveRecord {
    type Batch = PerspectiveBatch;
}

/// Batch of splats, relative to a tile.
pub(crate) trait SplatBatch {
    /// Record in memory.
    type Splat;
    /// Empty batch.
    const EMPTY: Self;

    /// Stores a splat, its mean relative to the tile's corner.
    fn set(&mut self, k: usize, splat: &Self::Splat, origin: [f32; 2]);

    /// Prepares a block of splats, and adds for each quad of the tile a bit for each of them that
    /// may touch it.
    fn prepare<S: Simd>(&mut self, simd: S, first: usize, cutoffs: &Cutoffs, splats: &mut [u64; QUADS]);

    /// log₂ of a splat's strength in some pixels.
    fn log2_strength<S: Simd>(&self, simd: S, k: usize, centers: [Lanes<S>; 2]) -> Lanes<S>;

    /// Reads the splats of a list; returns for each quad of the tile a bit for each that may touch
    /// it.
    #[inline(always)]
    fn read<S: Simd>(
        &mut self,
        simd: S,
        all: &[Self::Splat],
        origin: [f32; 2],
        list: &[AtomicU32],
        cutoffs: &Cutoffs,
    ) -> [u64; QUADS] {
        for (k, gaussian) in list.iter().enumerate() {
            self.set(k, &all[gaussian.load(Relaxed) as usize], origin);
        }
        let mut splats = [0; QUADS];
        for first in (0..list.len()).step_by(BLOCK) {
            self.prepare(simd, first, cutoffs, &mut splats);
        }
        let known = u64::MAX >> (SPLATS_AT_ONCE - list.len());
        for quad in 0..QUADS {
            splats[quad] &= known;
        }
        splats
    }
}

/// Batch of splats of the affine projection.
pub(crate) struct AffineBatch {
    /// Centre, relative to the tile's corner.
    mean2d: [Numbers; 2],
    root: [Numbers; 3],
    log2_opacity: Numbers,
    /// Scaled offset of the tile's corner.
    of_corner: [Numbers; 2],
}

impl AffineBatch {
    #[inline(always)]
    fn set(&mut self, k: usize, mean2d: [f32; 2], root: [f32; 3], log2_opacity: f32, origin: [f32; 2]) {
        for axis in 0..2 {
            self.mean2d[axis][k] = mean2d[axis] - origin[axis];
        }
        for entry in 0..3 {
            self.root[entry][k] = root[entry];
        }
        self.log2_opacity[k] = log2_opacity;
    }

    /// Scales the roots of a block of splats, and stores the offset of the tile's corner from each.
    #[inline(always)]
    fn scale<S: Simd>(&mut self, simd: S, first: usize) -> Splat2d<Lanes<S>> {
        let load = |numbers: &Numbers| Lanes::load(simd, &numbers[first..]);
        let root = [load(&self.root[0]), load(&self.root[1]), load(&self.root[2])];
        let splat = Splat2d::new([load(&self.mean2d[0]), load(&self.mean2d[1])], root, load(&self.log2_opacity));
        for entry in 0..3 {
            splat.root[entry].store(&mut self.root[entry][first..]);
        }
        let at_corner = offset_of_origin(&splat);
        for axis in 0..2 {
            at_corner[axis].store(&mut self.of_corner[axis][first..]);
        }
        splat
    }

    /// Scaled offset of some pixels from a splat.
    #[inline(always)]
    fn offset<S: Simd>(&self, simd: S, k: usize, centers: [Lanes<S>; 2]) -> [Lanes<S>; 2] {
        let splat = |numbers: &Numbers| Lanes::splat(simd, numbers[k]);
        let [of_u, of_w] = &self.of_corner;
        let [xx, yx, yy] = &self.root;
        offset_from([splat(of_u), splat(of_w)], [splat(xx), splat(yx), splat(yy)], centers)
    }
}

impl SplatBatch for AffineBatch {
    type Splat = SplatRecord;
    const EMPTY: Self = Self {
        mean2d: [[0.0; SPLATS_AT_ONCE]; 2],
        root: [[0.0; SPLATS_AT_ONCE]; 3],
        log2_opacity: [0.0; SPLATS_AT_ONCE],
        of_corner: [[0.0; SPLATS_AT_ONCE]; 2],
    };

    #[inline(always)]
    fn set(&mut self, k: usize, splat: &SplatRecord, origin: [f32; 2]) {
        self.set(k, splat.mean2d, splat.root_conic, splat.log2_opacity, origin);
    }

    #[inline(always)]
    fn prepare<S: Simd>(&mut self, simd: S, first: usize, cutoffs: &Cutoffs, splats: &mut [u64; QUADS]) {
        let splat = self.scale(simd, first);
        for across in 0..QUADS_ACROSS {
            let column = column_of(&splat, pixel_bounds(splat.mean2d[0], across));
            for down in 0..QUADS_ACROSS {
                let mask = cutoffs.may_overlap_column(&splat, &column, pixel_bounds(splat.mean2d[1], down));
                splats[down * QUADS_ACROSS + across] |= mask.bits() << first;
            }
        }
    }

    #[inline(always)]
    fn log2_strength<S: Simd>(&self, simd: S, k: usize, centers: [Lanes<S>; 2]) -> Lanes<S> {
        log2_strength(Lanes::splat(simd, self.log2_opacity[k]), self.offset(simd, k, centers))
    }
}

/// Batch of splats in perspective.
pub(crate) struct PerspectiveBatch {
    affine: AffineBatch,
    slope: [Numbers; 2],
    /// Scaled curvature.
    curvature: Numbers,
    /// Ray's scale at the tile's corner.
    of_corner: Numbers,
}

impl PerspectiveBatch {
    #[inline(always)]
    fn is_affine(&self, k: usize) -> bool {
        self.slope[0][k] == 0.0 && self.slope[1][k] == 0.0 && self.curvature[k] == 0.0
    }
}

impl SplatBatch for PerspectiveBatch {
    type Splat = PerspectiveRecord;
    const EMPTY: Self = Self {
        affine: AffineBatch::EMPTY,
        slope: [[0.0; SPLATS_AT_ONCE]; 2],
        curvature: [0.0; SPLATS_AT_ONCE],
        of_corner: [0.0; SPLATS_AT_ONCE],
    };

    #[inline(always)]
    fn set(&mut self, k: usize, splat: &PerspectiveRecord, origin: [f32; 2]) {
        self.affine.set(k, splat.mean2d, splat.root_conic, splat.log2_opacity, origin);
        for axis in 0..2 {
            self.slope[axis][k] = splat.slope[axis];
        }
        self.curvature[k] = splat.curvature;
    }

    #[inline(always)]
    fn prepare<S: Simd>(&mut self, simd: S, first: usize, cutoffs: &Cutoffs, splats: &mut [u64; QUADS]) {
        let splat = self.affine.scale(simd, first);
        let load = |numbers: &Numbers| Lanes::load(simd, &numbers[first..]);
        let slope = [load(&self.slope[0]), load(&self.slope[1])];
        let perspective = Perspective { slope, curvature: load(&self.curvature) };
        ray_scale_of_origin(splat.mean2d, perspective.slope).store(&mut self.of_corner[first..]);
        scaled_curvature(perspective.curvature).store(&mut self.curvature[first..]);
        for quad in 0..QUADS {
            let bounds = |axis: usize, index: usize| pixel_bounds(splat.mean2d[axis], index);
            let (dx, dy) = (bounds(0, quad % QUADS_ACROSS), bounds(1, quad / QUADS_ACROSS));
            splats[quad] |= may_overlap(cutoffs, &splat, &perspective, dx, dy).bits() << first;
        }
    }

    #[inline(always)]
    fn log2_strength<S: Simd>(&self, simd: S, k: usize, centers: [Lanes<S>; 2]) -> Lanes<S> {
        let offset = self.affine.offset(simd, k, centers);
        let splat = |numbers: &Numbers| Lanes::splat(simd, numbers[k]);
        let log2_opacity = splat(&self.affine.log2_opacity);
        if self.is_affine(k) {
            return log2_strength(log2_opacity, offset);
        }
        let squared = offset[0].mul_add(offset[0], offset[1] * offset[1]);
        let scale = ray_scale(splat(&self.of_corner), [splat(&self.slope[0]), splat(&self.slope[1])], centers);
        perspective::log2_strength(log2_opacity, squared, scale, splat(&self.curvature))
    }
}

/// Centres of the pixels of each quad, from the tile's corner.
const CENTERS: [[Quad; 2]; QUADS] = centers();

const fn centers() -> [[Quad; 2]; QUADS] {
    let mut centers = [[[0.0; BLOCK]; 2]; QUADS];
    let mut k = 0;
    while k < QUADS * BLOCK {
        let (quad, lane) = (k / BLOCK, k % BLOCK);
        let [x, y] = quad_origin(quad);
        centers[quad][0][lane] = x as f32 + PIXEL_X[lane];
        centers[quad][1][lane] = y as f32 + PIXEL_Y[lane];
        k += 1;
    }
    centers
}

#[inline(always)]
pub(crate) fn centers_of<S: Simd>(simd: S, quad: usize) -> [Lanes<S>; 2] {
    let [x, y] = &CENTERS[quad];
    [Lanes::load(simd, x), Lanes::load(simd, y)]
}

/// Offsets of the first and the last pixel of a quad from a splat's centre, along an axis.
#[inline(always)]
fn pixel_bounds<S: Simd>(mean: Lanes<S>, quad: usize) -> [Lanes<S>; 2] {
    let first = (quad * QUAD) as f32 + 0.5;
    [-mean + first, -mean + (first + (QUAD - 1) as f32)]
}
