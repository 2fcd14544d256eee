//! The prefilter's operator: light into roughness levels is linear, and its weights depend only on
//! the resolution. They are computed here once, from core's formulas; executors keep them and apply
//! them.
//!
//! A light is a pyramid of means over 2 × 2 texels, finest first (*nodes*), followed by the
//! filtered texels (*rows*); lookups read levels with aprons.
//!
//! A row is a cut through the pyramid: fine in the core of the lobe, coarse in its tail, and
//! truncated at 99.5 % of the energy. Gradients use the transposed matrix, built on first use. Rows
//! of all faces have the weights of the first ([`symmetry`]), except in the official scheme, whose
//! texel weights are half a texel off.
//! Every face of a level has an apron of its neighbours' texels, so a bilinear footprint never
//! leaves a face and lookups are continuous across edges. Levels are data: specula's, those of the
//! authors' code, or the mip chain of `specula prefilter`. `specula_oracle::independent::lobe`
//! measures their distance from the integral, without sharing a formula with core.
#![forbid(unsafe_code)]

pub mod encoded;
pub mod sparse;
pub mod symmetry;

use crate::{
    sparse::{Linear, Sparse},
    symmetry::{SideBySide, node_seen_from},
};
use rayon::prelude::*;
use specula_core::{
    cubemap::{FACE_COUNT, apron_sources, solid_angles, texel_direction, texel_index, texel_of_index},
    double::Double,
    light_view::TexelMap,
    prefilter::{
        IRRADIANCE_RESOLUTION, Level, LevelRange, Levels, Lobe, Node, PrefilterScheme, official_cut_cosine,
        official_irradiance_weight, official_lobe_weight, official_texel_weight,
    },
    split_sum::{HalfVector, RESOLUTION, integrate_over},
    vector::{Vec3, vec3},
};
use std::{
    borrow::Cow,
    sync::{Arc, LazyLock, Mutex, PoisonError},
};

/// Coarsest resolution of the light's pyramid.
const COARSEST: usize = 4;
/// Operators with more weights are not stored but computed again at each use.
const STORED_WEIGHTS_MAX: usize = 1 << 26;

/// Scheme, resolution of the base and kept levels of an operator.
type OperatorKey = (PrefilterScheme, usize, LevelRange);

/// Last used operators of small bases, the newest at the end.
static SHARED: Mutex<Vec<(OperatorKey, Arc<Operator>)>> = Mutex::new(Vec::new());
/// Operators in [`SHARED`].
const SHARED_MAX: usize = 4;
/// Finest base of an operator in [`SHARED`]: the default light's.
const SHARED_RESOLUTION_MAX: usize = 64;

/// Table of the authors' shading, computed on first use: n·v across, roughness down.
pub static SPLIT_SUM: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    const SAMPLES: u32 = 1024;
    let centre = |k: usize| (k as f64 + 0.5) / RESOLUTION as f64;
    let row = |roughness: f64| {
        let half_vectors: Vec<HalfVector> =
            (0..SAMPLES).map(|k| HalfVector::of_sample(k, roughness, SAMPLES)).collect();
        (0..RESOLUTION).map(move |column| {
            integrate_over(half_vectors.iter().copied(), centre(column), roughness).map(|f| f as f32)
        })
    };
    (0..RESOLUTION).into_par_iter().flat_map_iter(|k| row(centre(k))).collect()
});

/// The map from a light's pyramid to its levels.
#[derive(Debug)]
pub struct Operator {
    scheme: PrefilterScheme,
    resolution: usize,
    levels: Levels,
    /// Resolution and first node of each pyramid level, finest first.
    pyramid: Vec<(usize, usize)>,
    /// Filtered levels, and the irradiance map: each a block of rows.
    blocks: Vec<RowBlock>,
    maps: Vec<TexelMap>,
    nodes: NodeTable,
    /// The official scheme's weights of one face's texels, level by level.
    official_weights: Vec<f64>,
    /// From each level of the pyramid to the next coarser one.
    reductions: Vec<Linear>,
    /// From the pyramid to the rows, of the first face only if those serve all.
    stored: Option<Linear>,
    /// Nodes and rows of all faces, if the stored rows serve them all.
    faces: Option<SideBySide>,
    /// From the pyramid and the rows to levels with aprons.
    aprons: Linear,
}

/// Map from the pyramid to the rows of an operator.
#[derive(Clone, Copy, Debug)]
pub enum Rows<'a> {
    /// All rows.
    All(&'a Linear),
    /// Rows of the first face, level by level, which serve all faces.
    FirstFace(&'a Linear, &'a SideBySide),
}

/// Rows of one level of the result.
#[derive(Clone, Copy, Debug)]
struct RowBlock {
    resolution: usize,
    first_row: usize,
    kind: RowKind,
    /// True if the level is looked up; otherwise its rows are zero.
    is_kept: bool,
}

#[derive(Clone, Copy, Debug)]
enum RowKind {
    /// The base itself: no rows.
    Base,
    Exact {
        alpha_ggx: f64,
    },
    Official {
        alpha_ggx: f64,
        cut_cosine: f64,
        source: usize,
    },
    OfficialIrradiance {
        source: usize,
    },
}

/// A cone of light around a direction, over the texels of one pyramid level.
struct Cone {
    axis: Vec3<Double>,
    resolution: usize,
    /// Cosine below which a node is entirely outside, by the number of times its resolution is
    /// halved.
    least_cosine: [f64; MAX_HALVINGS],
    /// First of the official texel weights of this level.
    weights: usize,
}

/// Levels of the largest pyramid.
const MAX_HALVINGS: usize = 12;

/// Direction and solid angle of every node, down to twice the base's resolution.
#[derive(Debug)]
struct NodeTable {
    levels: Vec<(usize, Vec<(Vec3<Double>, f64)>)>,
}

impl NodeTable {
    fn new(finest: usize) -> Self {
        let mut levels = Vec::new();
        let mut resolution = finest;
        while resolution >= COARSEST {
            // They are the same on each face.
            let angles: Vec<f64> = solid_angles(resolution).take(resolution * resolution).collect();
            let texels = each_texel(resolution)
                .map(|(face, column, row)| {
                    let [x, y, z] = texel_direction(face, column, row, resolution).map(Double);
                    (vec3(x, y, z), angles[row * resolution + column])
                })
                .collect();
            levels.push((resolution, texels));
            resolution /= 2;
        }
        Self { levels }
    }
    fn get(&self, node: &Node) -> (Vec3<Double>, f64) {
        let level = (self.levels[0].0 / node.resolution).ilog2() as usize;
        self.levels[level].1[texel_index(node.face, node.column, node.row, node.resolution)]
    }
}

fn each_texel(resolution: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..FACE_COUNT).flat_map(move |face| {
        (0..resolution).flat_map(move |row| (0..resolution).map(move |column| (face, column, row)))
    })
}

impl Operator {
    /// The operator for a base of this resolution, a power of two; rows of levels that are not kept
    /// are zero.
    pub fn new(scheme: PrefilterScheme, resolution: usize, kept: LevelRange) -> Self {
        Self::of_levels(scheme, Levels::new(scheme, resolution), kept)
    }

    /// [`Operator::new`], shared within the process: weights of small bases are computed once for
    /// all executors.
    pub fn shared(scheme: PrefilterScheme, resolution: usize, kept: LevelRange) -> Arc<Self> {
        let key = (scheme, resolution, kept);
        let operators = || SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, operator)) = operators().iter().find(|(of, _)| *of == key) {
            return operator.clone();
        }
        // Not under the lock: a waiting thread of rayon may take work that needs other weights.
        let operator = Arc::new(Self::new(scheme, resolution, kept));
        if resolution <= SHARED_RESOLUTION_MAX {
            let mut operators = operators();
            operators.retain(|(of, _)| *of != key);
            if operators.len() == SHARED_MAX {
                operators.remove(0);
            }
            operators.push((key, operator.clone()));
        }
        operator
    }

    /// The operator for a base as fine as the first of these levels, with the weights of a scheme.
    pub fn of_levels(scheme: PrefilterScheme, levels: Levels, kept: LevelRange) -> Self {
        let resolution = levels.as_slice()[0].resolution;
        let mut pyramid = Vec::new();
        let (mut size, mut offset) = (resolution, 0);
        while size >= COARSEST.min(resolution) {
            pyramid.push((size, offset));
            offset += FACE_COUNT * size * size;
            size /= 2;
        }
        let blocks = Self::row_blocks(scheme, &levels, kept, &pyramid);
        let maps = TexelMap::side_by_side(blocks.iter().map(|block| block.resolution)).collect();
        let nodes = NodeTable::new(2 * resolution);
        let level_weights =
            |size: usize| (0..size * size).map(move |k| official_texel_weight(k % size, k / size, size));
        let official_weights = pyramid.iter().flat_map(|(size, _)| level_weights(*size)).collect();
        let mut operator = Self {
            scheme,
            resolution,
            levels,
            pyramid,
            blocks,
            maps,
            nodes,
            official_weights,
            reductions: Vec::new(),
            stored: None,
            faces: None,
            aprons: Linear::default(),
        };
        operator.stored = operator.store();
        if operator.stored.is_some() && operator.is_symmetric() {
            let levels = operator.filtered_blocks().map(|block| (block.resolution, block.first_row));
            operator.faces = Some(SideBySide::new(&operator.pyramid, levels));
        }
        operator.reductions =
            operator.pyramid.windows(2).map(|pair| operator.reduction(pair[0].0, pair[1].0)).collect();
        operator.aprons = operator.make_aprons();
        operator
    }

    fn row_blocks(
        scheme: PrefilterScheme,
        levels: &Levels,
        kept: LevelRange,
        pyramid: &[(usize, usize)],
    ) -> Vec<RowBlock> {
        let mut first_row = 0;
        let mut blocks: Vec<RowBlock> = Vec::new();
        let source = |resolution: usize| pyramid.iter().position(|(size, _)| *size == resolution).unwrap_or(0);
        for (number, level) in levels.as_slice().iter().enumerate() {
            let alpha_ggx = f64::from(level.roughness) * f64::from(level.roughness);
            let kind = match scheme {
                PrefilterScheme::Exact if level.roughness == 0.0 => RowKind::Base,
                PrefilterScheme::Exact => RowKind::Exact { alpha_ggx },
                PrefilterScheme::Official => RowKind::Official {
                    alpha_ggx,
                    cut_cosine: official_cut_cosine(alpha_ggx),
                    source: source(level.resolution),
                },
            };
            blocks.push(RowBlock { resolution: level.resolution, first_row, kind, is_kept: kept.contains(number) });
            if !matches!(kind, RowKind::Base) {
                first_row += FACE_COUNT * level.resolution * level.resolution;
            }
        }
        if scheme == PrefilterScheme::Official {
            let kind = RowKind::OfficialIrradiance { source: source(IRRADIANCE_RESOLUTION) };
            blocks.push(RowBlock { resolution: IRRADIANCE_RESOLUTION, first_row, kind, is_kept: true });
        }
        blocks
    }

    /// The levels, sharpest first.
    pub fn levels(&self) -> &[Level] {
        self.levels.as_slice()
    }
    /// Texels along an edge of a face of the base.
    pub fn base_resolution(&self) -> usize {
        self.resolution
    }
    /// Map of each level, and of the irradiance behind them, if there is one.
    #[inline(always)]
    pub fn maps(&self) -> &[TexelMap] {
        &self.maps
    }
    /// From each level of the pyramid to the next coarser one: first node of either, and the map.
    pub fn reductions(&self) -> impl DoubleEndedIterator<Item = ([usize; 2], &Linear)> {
        self.pyramid.windows(2).map(|pair| [pair[0].1, pair[1].1]).zip(&self.reductions)
    }
    /// From the pyramid to the rows; `None` if there are too many weights to keep.
    pub fn rows(&self) -> Option<Rows<'_>> {
        let stored = self.stored.as_ref()?;
        Some(self.faces.as_ref().map_or(Rows::All(stored), |faces| Rows::FirstFace(stored, faces)))
    }
    /// [`Operator::rows`] of all faces; those that are not stored are written out at each call.
    pub fn all_rows(&self) -> Option<Cow<'_, Linear>> {
        let (first_face, faces) = match self.rows()? {
            Rows::All(rows) => return Some(Cow::Borrowed(rows)),
            Rows::FirstFace(rows, faces) => (&rows.forward, faces),
        };
        let mut rows = Sparse { starts: vec![0], ..Sparse::default() };
        for place in &faces.places_of_rows {
            let (row, face) = (*place as usize / FACE_COUNT, *place as usize % FACE_COUNT);
            let taps = first_face.starts[row]..first_face.starts[row + 1];
            let columns = first_face.columns[taps.clone()].iter();
            rows.columns.extend(columns.map(|node| faces.nodes[FACE_COUNT * *node as usize + face]));
            rows.weights.extend(&first_face.weights[taps]);
            rows.end_row();
        }
        Some(Cow::Owned(Linear::new(rows, self.node_count())))
    }
    /// Number of products of a weight and a texel; `None` if there are too many weights to keep.
    pub fn product_count(&self) -> Option<usize> {
        Some(match self.rows()? {
            Rows::All(rows) => rows.forward.weights.len(),
            Rows::FirstFace(rows, _) => FACE_COUNT * rows.forward.weights.len(),
        })
    }
    /// Drops the stored rows, as if there were too many weights to keep.
    pub fn forget_rows(&mut self) {
        self.stored = None;
    }
    /// Rows piece by piece, each with the number of its first, to limit memory. A piece has about
    /// `weights_at_once` weights, and is computed on demand.
    pub fn pieces(&self, weights_at_once: usize) -> impl Iterator<Item = (usize, Sparse)> + '_ {
        const ROWS_AT_ONCE: usize = 512;
        const ROWS_OF_A_TASK: usize = 16;
        let mut next = 0;
        core::iter::from_fn(move || {
            let first = next;
            let mut parts = Vec::new();
            let mut weights = 0;
            while next < self.row_count() && weights < weights_at_once {
                let rows: Vec<usize> = (next..(next + ROWS_AT_ONCE).min(self.row_count())).collect();
                let chunks: Vec<Sparse> = rows.par_chunks(ROWS_OF_A_TASK).map(|rows| self.sparse_rows(rows)).collect();
                weights += chunks.iter().map(|part| part.weights.len()).sum::<usize>();
                parts.extend(chunks);
                next += rows.len();
            }
            (first < next).then(|| (first, Sparse::join(&parts)))
        })
    }
    /// From nodes and rows to levels with aprons. Columns are the nodes of the pyramid, then the
    /// filtered texels; rows are the texels of the levels, in the order of their maps.
    pub fn aprons(&self) -> &Linear {
        &self.aprons
    }
    /// Filtered texels.
    pub fn row_count(&self) -> usize {
        let last = self.blocks[self.blocks.len() - 1];
        last.first_row + FACE_COUNT * last.resolution * last.resolution
    }
    /// Texels of all levels with their aprons.
    pub fn padded_count(&self) -> usize {
        self.maps[self.maps.len() - 1].end()
    }
    /// Texels of the pyramid.
    pub fn node_count(&self) -> usize {
        let (size, offset) = self.pyramid[self.pyramid.len() - 1];
        offset + FACE_COUNT * size * size
    }
    fn node_index(&self, node: &Node) -> usize {
        let level = (self.resolution / node.resolution).ilog2() as usize;
        self.pyramid[level].1 + texel_index(node.face, node.column, node.row, node.resolution)
    }

    fn block_of_row(&self, row: usize) -> &RowBlock {
        let block = self.blocks.iter().rev().find(|b| b.first_row <= row && !matches!(b.kind, RowKind::Base));
        block.expect("every row belongs to a block")
    }

    /// Nodes and weights of one row, if its level is kept; else nothing.
    pub fn kept_row(&self, row: usize, taps: &mut Vec<(u32, f64)>) {
        taps.clear();
        if self.block_of_row(row).is_kept {
            if !self.is_symmetric() {
                return self.row(row, taps);
            }
            let (first, face) = self.row_of_first_face(row);
            self.row(first, taps);
            taps.iter_mut().for_each(|(node, _)| *node = node_seen_from(face, *node, &self.pyramid));
        }
    }

    /// Whether rows of the first face serve all faces.
    fn is_symmetric(&self) -> bool {
        self.scheme == PrefilterScheme::Exact
    }

    fn filtered_blocks(&self) -> impl Iterator<Item = &RowBlock> {
        self.blocks.iter().filter(|block| !matches!(block.kind, RowKind::Base))
    }

    /// Row of the first face with the weights of a row, and the face of that row.
    fn row_of_first_face(&self, row: usize) -> (usize, usize) {
        let RowBlock { first_row, resolution, .. } = *self.block_of_row(row);
        let (area, place) = (resolution * resolution, row - first_row);
        (first_row + place % area, place / area)
    }

    /// Weights of one row into `taps`, normalised unless they are the official irradiance's.
    fn row(&self, row: usize, taps: &mut Vec<(u32, f64)>) {
        taps.clear();
        let block = self.block_of_row(row);
        let (face, column, row) = texel_of_index(row - block.first_row, block.resolution);
        let [x, y, z] = texel_direction(face, column, row, block.resolution).map(Double);
        let direction = vec3(x, y, z);
        match block.kind {
            RowKind::Base => {}
            RowKind::Exact { alpha_ggx } => {
                let lobe = Lobe::new(direction, alpha_ggx);
                self.roots().for_each(|root| self.cut(root, &lobe, taps));
            }
            RowKind::Official { alpha_ggx, cut_cosine, source } => {
                let cone = self.cone_around(direction, cut_cosine, source);
                let weigh =
                    |light_dir, weight| official_lobe_weight(direction, light_dir, weight, alpha_ggx, cut_cosine);
                self.roots().for_each(|root| self.cone(root, &cone, &weigh, taps));
            }
            RowKind::OfficialIrradiance { source } => {
                let cone = self.cone_around(direction, 0.0, source);
                let weigh = |light_dir, weight| official_irradiance_weight(direction, light_dir, weight);
                self.roots().for_each(|root| self.cone(root, &cone, &weigh, taps));
                return;
            }
        }
        let sum: f64 = taps.iter().map(|(_, weight)| weight).sum();
        taps.iter_mut().for_each(|(_, weight)| *weight /= sum);
    }

    fn roots(&self) -> impl Iterator<Item = Node> + '_ {
        let resolution = self.pyramid[self.pyramid.len() - 1].0;
        each_texel(resolution).map(move |(face, column, row)| Node { face, column, row, resolution })
    }

    /// specula's rows: nodes inside the lobe's cut, small enough for the lobe at their position.
    fn cut(&self, node: Node, lobe: &Lobe, taps: &mut Vec<(u32, f64)>) {
        let (node_dir, _) = self.nodes.get(&node);
        if !lobe.sees(node_dir, node.resolution) {
            return;
        }
        if node.resolution < self.resolution && lobe.must_open(node_dir, node.resolution) {
            return node.children().into_iter().for_each(|child| self.cut(child, lobe, taps));
        }
        let weight = lobe.weight(&node.children().map(|child| self.nodes.get(&child)));
        if weight > 0.0 {
            taps.push((self.node_index(&node) as u32, weight));
        }
    }

    /// The official scheme's rows: every texel of one pyramid level inside a cone.
    fn cone(&self, node: Node, cone: &Cone, weigh: &dyn Fn(Vec3<Double>, f64) -> f64, taps: &mut Vec<(u32, f64)>) {
        let (direction, _) = self.nodes.get(&node);
        let level = (cone.resolution / node.resolution).ilog2() as usize;
        if direction.dot(cone.axis).0 < cone.least_cosine[level] {
            return;
        }
        if node.resolution < cone.resolution {
            return node.children().into_iter().for_each(|child| self.cone(child, cone, weigh, taps));
        }
        let texel_weight = self.official_weights[texel_index(0, node.column, node.row, node.resolution) + cone.weights];
        let weight = weigh(direction, texel_weight);
        if weight > 0.0 {
            taps.push((self.node_index(&node) as u32, weight));
        }
    }

    fn cone_around(&self, axis: Vec3<Double>, cut_cosine: f64, source: usize) -> Cone {
        let resolution = self.pyramid[source].0;
        let cut = cut_cosine.acos();
        let mut least_cosine = [-1.0; MAX_HALVINGS];
        for (halvings, least) in least_cosine.iter_mut().enumerate() {
            // Half the diagonal of a texel is √2 / resolution at most.
            let reach = cut + 1.5 * (1 << halvings) as f64 / resolution as f64;
            *least = if reach < core::f64::consts::PI { reach.cos() } else { -1.0 };
        }
        let weights = self.pyramid[..source].iter().map(|(size, _)| size * size).sum();
        Cone { axis, resolution, least_cosine, weights }
    }

    /// Weights by row, unless there are too many for all faces. The decision must not depend on the
    /// kept levels, because the sums are rounded in another order.
    fn store(&self) -> Option<Linear> {
        const ROWS_AT_ONCE: usize = 128;
        let first_face = |block: &RowBlock| block.first_row..block.first_row + block.resolution.pow(2);
        let rows: Vec<usize> = if self.is_symmetric() {
            self.filtered_blocks().flat_map(first_face).collect()
        } else {
            (0..self.row_count()).collect()
        };
        let sample: usize = rows.iter().step_by(97).take(512).map(|row| self.tap_count(*row)).sum();
        if sample / rows.len().div_ceil(97).clamp(1, 512) * self.row_count() > STORED_WEIGHTS_MAX {
            return None;
        }
        let parts: Vec<Sparse> = rows.par_chunks(ROWS_AT_ONCE).map(|rows| self.sparse_rows(rows)).collect();
        Some(Linear::new(Sparse::join(&parts), self.node_count()))
    }

    fn tap_count(&self, row: usize) -> usize {
        let mut taps = Vec::new();
        self.row(row, &mut taps);
        taps.len()
    }

    fn sparse_rows(&self, rows: &[usize]) -> Sparse {
        let mut sparse = Sparse { starts: vec![0], ..Sparse::default() };
        let mut taps = Vec::new();
        for row in rows {
            self.kept_row(*row, &mut taps);
            sparse.columns.extend(taps.iter().map(|(column, _)| *column));
            sparse.weights.extend(taps.iter().map(|(_, weight)| *weight as f32));
            sparse.starts.push(sparse.columns.len());
        }
        sparse
    }

    /// Means over 2×2 texels: weighted by solid angle, or plain in the official scheme.
    fn reduction(&self, fine: usize, coarse: usize) -> Linear {
        let mut sparse = Sparse { starts: vec![0], ..Sparse::default() };
        for (face, column, row) in each_texel(coarse) {
            let children = Node { face, column, row, resolution: coarse }.children();
            let shares = match self.scheme {
                PrefilterScheme::Exact => children.map(|c| self.nodes.get(&c).1),
                PrefilterScheme::Official => [1.0; 4],
            };
            let sum: f64 = shares.iter().sum();
            for (child, share) in children.iter().zip(shares) {
                let index = texel_index(child.face, child.column, child.row, fine);
                sparse.push(index, (share / sum) as f32);
            }
            sparse.end_row();
        }
        Linear::new(sparse, FACE_COUNT * fine * fine)
    }

    /// Levels with their aprons. A level equal to the base takes its texels from there.
    fn make_aprons(&self) -> Linear {
        let mut sparse = Sparse { starts: vec![0], ..Sparse::default() };
        for block in &self.blocks {
            let first = match block.kind {
                RowKind::Base => 0,
                _ => self.node_count() + block.first_row,
            };
            each_padded(block.resolution, |texels, weight| {
                texels.iter().for_each(|texel| sparse.push(first + texel, weight));
                sparse.end_row();
            });
        }
        Linear::new(sparse, self.node_count() + self.row_count())
    }
}

/// Calls `visit` for every texel of a padded map in order, with its source texels and the weight of
/// each.
fn each_padded(resolution: usize, mut visit: impl FnMut(&[usize], f32)) {
    let last = resolution as isize;
    for face in 0..FACE_COUNT {
        for row in -1..=last {
            for column in -1..=last {
                if (0..last).contains(&column) && (0..last).contains(&row) {
                    visit(&[texel_index(face, column as usize, row as usize, resolution)], 1.0);
                } else {
                    let apron = apron_sources(face, column, row, resolution);
                    visit(&apron.texels[..apron.count], 1.0 / apron.count as f32);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operators_are_shared_by_key_until_others_evict_them() {
        let shared_operator = |end: usize| Operator::shared(PrefilterScheme::Exact, 16, LevelRange { first: 0, end });
        let first = shared_operator(1);
        assert!(Arc::ptr_eq(&first, &shared_operator(1)), "weights are computed once");
        assert!(!Arc::ptr_eq(&first, &shared_operator(2)), "other levels have other weights");
        (2..2 + SHARED_MAX).for_each(|end| drop(shared_operator(end)));
        assert!(!Arc::ptr_eq(&first, &shared_operator(1)), "no more than {SHARED_MAX} are kept");
        let fine = || Operator::shared(PrefilterScheme::Exact, 2 * SHARED_RESOLUTION_MAX, LevelRange::NONE);
        assert!(!Arc::ptr_eq(&fine(), &fine()), "large ones belong to their executors");
    }

    #[test]
    fn rows_of_all_faces_are_those_of_their_directions() {
        /// Relative rounding of a weight: the same products are added in another order.
        const ROUNDING: f64 = 1e-11;
        let operator = Operator::new(PrefilterScheme::Exact, 16, LevelRange::ALL);
        let (mut own, mut kept) = (Vec::new(), Vec::new());
        for row in (0..operator.row_count()).step_by(37) {
            operator.row(row, &mut own);
            operator.kept_row(row, &mut kept);
            [&mut own, &mut kept].into_iter().for_each(|taps| taps.sort_unstable_by_key(|(node, _)| *node));
            assert_eq!(own.len(), kept.len(), "row {row}");
            for ((node, expected), (found_node, found)) in own.iter().zip(&kept) {
                assert_eq!(node, found_node, "row {row}");
                let off = (expected - found).abs();
                assert!(off <= ROUNDING * expected, "row {row}, node {node}: {found}, not {expected}");
            }
        }
    }

    #[test]
    fn pieces_are_the_rows_that_are_kept() {
        for (scheme, resolution) in [(PrefilterScheme::Exact, 32), (PrefilterScheme::Official, 64)] {
            let operator = Operator::new(scheme, resolution, LevelRange::ALL);
            let rows = operator.all_rows().expect("there are few").forward.clone();
            let pieces: Vec<(usize, Sparse)> = operator.pieces(10_000).collect();
            assert!(pieces.len() > 2, "{scheme:?} has several pieces");
            let firsts = pieces.iter().scan(0, |next, (_, piece)| {
                let first = *next;
                *next += piece.row_count();
                Some(first)
            });
            assert!(firsts.eq(pieces.iter().map(|(first, _)| *first)), "{scheme:?}: no row is left out");
            let joined = Sparse::join(&pieces.into_iter().map(|(_, piece)| piece).collect::<Vec<_>>());
            assert!(joined.starts == rows.starts && joined.columns == rows.columns, "{scheme:?}: the same taps");
            assert_eq!(joined.weights, rows.weights, "{scheme:?}: the same weights");
        }
    }
}
