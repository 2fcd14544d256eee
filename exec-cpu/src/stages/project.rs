//! Gaussians to splats, sixteen at a time.

use crate::{block::BlockPlanes, buffer::Buffer, context::Context, lanes::Lanes};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    attributes::AttributePlanes,
    bin::{footprint_within, half_extent},
    camera::Camera,
    cutoffs::{BlendOrder, Cutoffs, ProjectionModel},
    order::{ResponseDepth, response_depth},
    perspective::{Perspective, footprint_in_perspective, perspective},
    project::project,
    real::Real,
    scene::{BLOCK, Gaussians, Layout},
    splat::Splat,
};

/// A Gaussian on the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatRecord {
    /// Centre, in pixels.
    pub mean2d: [f32; 2],
    /// Root of the conic.
    pub root_conic: [f32; 3],
    /// Opacity.
    pub opacity: f32,
    /// Its logarithm to base two.
    pub log2_opacity: f32,
    /// Depth.
    pub depth: f32,
    /// Reach of the splat, in standard deviations; negative if it is not drawn.
    pub reach: f32,
    /// Half width and half height, in pixels.
    pub half_extent: [f32; 2],
}

/// A Gaussian on the screen with its perspective.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PerspectiveRecord {
    /// Centre, in pixels.
    pub(crate) mean2d: [f32; 2],
    /// Root of the conic.
    pub(crate) root_conic: [f32; 3],
    /// Logarithm of the opacity to base two.
    pub(crate) log2_opacity: f32,
    /// l, in 1/px.
    pub(crate) slope: [f32; 2],
    /// κ.
    pub(crate) curvature: f32,
}

/// Numbers of a [`ResponseDepth`]: mean, slope, root, depth.
pub(crate) const RESPONSE_LEN: usize = 8;

/// Depth of a Gaussian's largest response as a function of the pixel.
pub(crate) type ResponseRecord = [f32; RESPONSE_LEN];

/// All Gaussians on the screen, in their order.
#[derive(Clone, Debug, PartialEq)]
pub struct Splats {
    /// Records of all splats. If the projection is not affine, centre, root and half extent are
    /// those of the footprint.
    pub(crate) records: Buffer<SplatRecord>,
    /// Splats for blending, if the projection is not affine.
    pub(crate) in_perspective: Option<Buffer<PerspectiveRecord>>,
    /// Depths of their largest responses, if they are not blended by the depths of their means.
    pub(crate) responses: Option<Buffer<ResponseRecord>>,
    /// For each block a bit for each Gaussian that is drawn.
    drawn: Buffer<u16>,
}

impl Splats {
    /// One record for each Gaussian.
    pub fn records(&self) -> &[SplatRecord] {
        &self.records
    }
    /// True if the projection was affine for all splats.
    pub fn are_affine(&self) -> bool {
        self.in_perspective.is_none()
    }
    /// Share of perspective splats among the drawn ones.
    pub fn share_in_perspective(&self) -> f64 {
        let Some(splats) = &self.in_perspective else { return 0.0 };
        let drawn = || splats.iter().zip(self.records.iter()).filter(|(_, record)| record.reach > 0.0);
        let count = drawn().filter(|(splat, _)| splat.slope != [0.0; 2] || splat.curvature != 0.0).count();
        count as f64 / drawn().count().max(1) as f64
    }
    /// Whether any Gaussian of a block is drawn.
    pub(crate) fn block_is_drawn(&self, block: usize) -> bool {
        self.drawn[block] != 0
    }
    /// Blocks task by task.
    pub(crate) fn par_chunks_mut(&mut self) -> impl IndexedParallelIterator<Item = SplatBlocks<'_>> {
        let records = self.records.par_chunks_mut(BLOCKS_AT_ONCE * BLOCK);
        let blocks = records.zip(self.drawn.par_chunks_mut(BLOCKS_AT_ONCE));
        blocks.map(|(records, drawn)| SplatBlocks { records, drawn })
    }
    /// Whether a Gaussian of a block is drawn.
    pub(crate) fn is_drawn(&self, block: usize, lane: usize) -> bool {
        self.drawn[block] >> lane & 1 != 0
    }
}

/// The splats of some blocks.
pub(crate) struct SplatBlocks<'a> {
    records: &'a mut [SplatRecord],
    drawn: &'a mut [u16],
}

impl SplatBlocks<'_> {
    /// Whether any Gaussian of a block is drawn.
    pub(crate) fn block_is_drawn(&self, block: usize) -> bool {
        self.drawn[block] != 0
    }
    /// Marks Gaussians of a block, a bit for each, as not drawn.
    pub(crate) fn leave_out(&mut self, block: usize, lanes: u16) {
        let lanes = lanes & self.drawn[block];
        if lanes != 0 {
            self.drawn[block] &= !lanes;
            let records = self.records[block * BLOCK..].iter_mut().take(BLOCK).enumerate();
            records.filter(|(lane, _)| lanes >> lane & 1 != 0).for_each(|(_, record)| record.reach = -1.0);
        }
    }
}

/// Blocks per task.
pub(crate) const BLOCKS_AT_ONCE: usize = 16;

pub(crate) fn project_all(
    context: &Context,
    gaussians: &Gaussians<Vec<f32>>,
    camera: &Camera,
    cutoffs: &Cutoffs,
) -> Splats {
    let mut records = context.take::<SplatRecord>(gaussians.count);
    let mut drawn = context.take::<u16>(gaussians.count.div_ceil(BLOCK));
    let responses = project_responses(context, gaussians, camera, cutoffs.order());
    let (layout, block_len) = (gaussians.layout, gaussians.block_len());
    let parts = gaussians.values.par_chunks(BLOCKS_AT_ONCE * block_len);
    let parts = parts.zip(records.par_chunks_mut(BLOCKS_AT_ONCE * BLOCK).zip(drawn.par_chunks_mut(BLOCKS_AT_ONCE)));
    if cutoffs.projection() == ProjectionModel::Affine {
        parts.for_each(|(blocks, (records, drawn))| {
            dispatch!(context.level, simd => project_blocks(simd, blocks, layout, camera, cutoffs, records, drawn));
        });
        return Splats { records, in_perspective: None, responses, drawn };
    }
    let mut splats = context.take::<PerspectiveRecord>(gaussians.count);
    parts.zip(splats.par_chunks_mut(BLOCKS_AT_ONCE * BLOCK)).for_each(|((blocks, (records, drawn)), splats)| {
        dispatch!(context.level, simd => {
            project_in_perspective(simd, blocks, layout, camera, cutoffs, records, splats, drawn);
        });
    });
    Splats { records, in_perspective: Some(splats), responses, drawn }
}

#[inline(always)]
fn project_blocks<S: Simd>(
    simd: S,
    blocks: &[f32],
    layout: Layout,
    camera: &Camera,
    cutoffs: &Cutoffs,
    records: &mut [SplatRecord],
    drawn: &mut [u16],
) {
    let camera = camera.lift(Lanes::splat(simd, 0.0));
    let blocks = blocks.chunks_exact(BLOCK * layout.plane_count()).zip(records.chunks_mut(BLOCK));
    for ((block, records), drawn) in blocks.zip(drawn) {
        let splat = project(&BlockPlanes { simd, values: block }.shape(layout), &camera);
        let reach = reach_of(simd, &splat, cutoffs, records.len(), drawn);
        store_records(&splat, reach, half_extent(&splat, reach), records);
    }
}

#[inline(always)]
fn project_in_perspective<S: Simd>(
    simd: S,
    blocks: &[f32],
    layout: Layout,
    camera: &Camera,
    cutoffs: &Cutoffs,
    records: &mut [SplatRecord],
    splats: &mut [PerspectiveRecord],
    drawn: &mut [u16],
) {
    let camera = camera.lift(Lanes::splat(simd, 0.0)).for_projection(cutoffs.projection());
    let records = records.chunks_mut(BLOCK).zip(splats.chunks_mut(BLOCK));
    for ((block, (records, splats)), drawn) in blocks.chunks_exact(BLOCK * layout.plane_count()).zip(records).zip(drawn)
    {
        let shape = BlockPlanes { simd, values: block }.shape(layout);
        let splat = project(&shape, &camera);
        let reach = reach_of(simd, &splat, cutoffs, records.len(), drawn);
        let perspective = perspective(cutoffs.projection(), &shape, &splat, &camera);
        store_in_perspective(&splat, &perspective, splats);
        let (footprint, variance) = footprint_in_perspective(&splat, &perspective, reach);
        let splat = Splat { mean2d: footprint.mean2d, root_conic: footprint.root_conic, variance, ..splat };
        store_records(&splat, reach, half_extent(&splat, reach), records);
    }
}

/// Reach of the splats of a block; sets a bit for each of the first `count` that is drawn.
#[inline(always)]
fn reach_of<S: Simd>(simd: S, splat: &Splat<Lanes<S>>, cutoffs: &Cutoffs, count: usize, drawn: &mut u16) -> Lanes<S> {
    let reach = footprint_within(splat, cutoffs).reach.min(Lanes::splat(simd, cutoffs.reach_max()));
    *drawn = reach.zero().less(reach).bits() as u16 & (u16::MAX >> (BLOCK - count));
    reach
}

#[inline(always)]
fn store_in_perspective<S: Simd>(
    splat: &Splat<Lanes<S>>,
    perspective: &Perspective<Lanes<S>>,
    records: &mut [PerspectiveRecord],
) {
    let [x, y] = [splat.mean2d[0].to_array(), splat.mean2d[1].to_array()];
    let [xx, yx, yy] = [splat.root_conic[0].to_array(), splat.root_conic[1].to_array(), splat.root_conic[2].to_array()];
    let [slope_x, slope_y] = [perspective.slope[0].to_array(), perspective.slope[1].to_array()];
    let (log2_opacity, curvature) = (splat.opacity.log2().to_array(), perspective.curvature.to_array());
    for (lane, record) in records.iter_mut().enumerate() {
        *record = PerspectiveRecord {
            mean2d: [x[lane], y[lane]],
            root_conic: [xx[lane], yx[lane], yy[lane]],
            log2_opacity: log2_opacity[lane],
            slope: [slope_x[lane], slope_y[lane]],
            curvature: curvature[lane],
        };
    }
}

#[inline(always)]
fn store_records<S: Simd>(splat: &Splat<Lanes<S>>, reach: Lanes<S>, half: [Lanes<S>; 2], records: &mut [SplatRecord]) {
    let [x, y] = [splat.mean2d[0].to_array(), splat.mean2d[1].to_array()];
    let [xx, yx, yy] = [splat.root_conic[0].to_array(), splat.root_conic[1].to_array(), splat.root_conic[2].to_array()];
    let [half_x, half_y] = [half[0].to_array(), half[1].to_array()];
    let (opacity, log2_opacity) = (splat.opacity.to_array(), splat.opacity.log2().to_array());
    let (depth, reach) = (splat.depth.to_array(), reach.to_array());
    for (lane, record) in records.iter_mut().enumerate() {
        *record = SplatRecord {
            mean2d: [x[lane], y[lane]],
            root_conic: [xx[lane], yx[lane], yy[lane]],
            opacity: opacity[lane],
            log2_opacity: log2_opacity[lane],
            depth: depth[lane],
            reach: reach[lane],
            half_extent: [half_x[lane], half_y[lane]],
        };
    }
}

/// Responses of all Gaussians; `None` for the order of means.
fn project_responses(
    context: &Context,
    gaussians: &Gaussians<Vec<f32>>,
    camera: &Camera,
    order: BlendOrder,
) -> Option<Buffer<ResponseRecord>> {
    if order == BlendOrder::Mean {
        return None;
    }
    let mut records = context.take::<ResponseRecord>(gaussians.count);
    let block_len = gaussians.block_len();
    let parts = gaussians.values.par_chunks(BLOCKS_AT_ONCE * block_len);
    parts.zip(records.par_chunks_mut(BLOCKS_AT_ONCE * BLOCK)).for_each(|(blocks, records)| {
        dispatch!(context.level, simd => {
            let camera = camera.lift(Lanes::splat(simd, 0.0));
            for (block, records) in blocks.chunks_exact(block_len).zip(records.chunks_mut(BLOCK)) {
                store_responses(&response_depth(&BlockPlanes { simd, values: block }.shape(gaussians.layout), &camera), records);
            }
        });
    });
    Some(records)
}

#[inline(always)]
fn store_responses<S: Simd>(response: &ResponseDepth<Lanes<S>>, records: &mut [ResponseRecord]) {
    let ResponseDepth { mean2d: [x, y], slope: [lx, ly], root: [xx, yx, yy], depth } = *response;
    let numbers = [x, y, lx, ly, xx, yx, yy, depth].map(Lanes::to_array);
    for (lane, record) in records.iter_mut().enumerate() {
        *record = numbers.each_ref().map(|lanes| lanes[lane]);
    }
}
