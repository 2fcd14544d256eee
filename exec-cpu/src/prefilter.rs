//! Light into roughness levels: a sparse linear operator, built once for a resolution and applied at every step.

use crate::{buffer::Buffer, machine::Machine};
use fearless_simd::{Level as SimdLevel, Simd, dispatch, f32x4, prelude::*};
use rayon::prelude::*;
use specula_core::{
    cubemap::{FACE_COUNT, apron_sources, padded_len, texel_direction, texel_index, texel_solid_angle},
    double::Double,
    prefilter::{
        IRRADIANCE_RESOLUTION, Level, LevelRange, Levels, Node, PrefilterScheme, lobe_weight_of_quarters, must_open,
        official_cut_cosine, official_irradiance_weight, official_lobe_weight, official_texel_weight,
    },
    scene::{Environment, RadianceActivation},
    vector::{Vec3, vec3},
};
use std::sync::Arc;

/// Red, green, blue and nothing: a texel as wide as a small vector.
pub type Texel = [f32; 4];

/// Coarsest resolution of the light's pyramid.
const COARSEST: usize = 4;
/// Operators with more weights than this are computed anew at each use instead of being kept.
const STORED_WEIGHTS_MAX: usize = 1 << 26;

/// A light filtered into levels, each with its apron.
#[derive(Clone, Debug)]
pub struct Light {
    operator: Arc<Operator>,
    /// All levels, one after the other; then the irradiance map, if there is one.
    pub(crate) texels: Buffer<Texel>,
    /// What they were made of: the radiance of the base, coarser and coarser, then the filtered rows.
    nodes: Buffer<Texel>,
}

/// Gradient of a [`Light`], texel by texel.
#[derive(Clone, Debug)]
pub struct LightGrad {
    pub(crate) texels: Buffer<Texel>,
}

impl Light {
    /// The levels.
    pub fn levels(&self) -> &[Level] {
        self.operator.levels.as_slice()
    }
    /// Texels along an edge of a level; the irradiance map comes after the last level.
    #[inline(always)]
    pub(crate) fn resolution(&self, level: usize) -> usize {
        self.operator.blocks[level].resolution
    }
    /// First texel of each level, and of the irradiance map behind them.
    #[inline(always)]
    pub(crate) fn offsets(&self) -> &[usize] {
        &self.operator.padded_offsets
    }
    /// Filters an environment. The operator fits its resolution.
    pub(crate) fn new(machine: &Machine, operator: Arc<Operator>, environment: &Environment<Vec<f32>>) -> Self {
        let mut nodes = machine.texels.take(operator.node_count() + operator.row_count());
        for (node, rgb) in nodes.iter_mut().zip(environment.values.chunks_exact(3)) {
            *node = activate(environment.activation, rgb);
        }
        operator.filter(&mut nodes);
        let mut texels = machine.texels.take(operator.padded_count());
        operator.aprons.forward.apply(operator.level, &nodes, &mut texels, false);
        Self { operator, texels, nodes }
    }
    /// Gradient with respect to the environment's numbers.
    pub(crate) fn vjp(&self, machine: &Machine, activation: RadianceActivation, grad: &LightGrad) -> Vec<f32> {
        let mut nodes = machine.texels.take(self.nodes.len());
        self.operator.aprons.transposed.apply(self.operator.level, &grad.texels, &mut nodes, false);
        self.operator.filter_vjp(&mut nodes);
        let resolution = self.operator.resolution;
        let mut out = machine.numbers.take(3 * FACE_COUNT * resolution * resolution);
        for ((out, grad), radiance) in out.chunks_exact_mut(3).zip(nodes.iter()).zip(self.nodes.iter()) {
            out.copy_from_slice(&activate_vjp(activation, grad, radiance));
        }
        out.into_vec()
    }
}

fn activate(activation: RadianceActivation, rgb: &[f32]) -> Texel {
    let of = |x: f32| match activation {
        RadianceActivation::Identity => x,
        RadianceActivation::Exponential => x.exp(),
    };
    [of(rgb[0]), of(rgb[1]), of(rgb[2]), 0.0]
}

fn activate_vjp(activation: RadianceActivation, grad: &Texel, radiance: &Texel) -> [f32; 3] {
    core::array::from_fn(|c| match activation {
        RadianceActivation::Identity => grad[c],
        RadianceActivation::Exponential => grad[c] * radiance[c],
    })
}

/// The map from a light's pyramid to its levels.
#[derive(Debug)]
pub(crate) struct Operator {
    level: SimdLevel,
    scheme: PrefilterScheme,
    resolution: usize,
    levels: Levels,
    /// Resolution and first node of each pyramid level, finest first.
    pyramid: Vec<(usize, usize)>,
    /// Filtered levels, and the irradiance map: each a block of rows.
    blocks: Vec<RowBlock>,
    padded_offsets: Vec<usize>,
    nodes: NodeTable,
    /// The official scheme's weights of one face's texels, level by level.
    official_weights: Vec<f64>,
    /// From each level of the pyramid to the next coarser one.
    reductions: Vec<Stored>,
    /// From the pyramid to the rows.
    stored: Option<Stored>,
    /// From the pyramid and the rows to levels with aprons.
    aprons: Stored,
}

/// Rows of one level of the result.
#[derive(Clone, Copy, Debug)]
struct RowBlock {
    resolution: usize,
    first_row: usize,
    kind: RowKind,
    /// Whether it is looked up; else its rows are zero.
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
    /// Cosine below which a node lies wholly outside, by how many times its resolution is halved.
    least_cosine: [f64; MAX_HALVINGS],
    /// First of the official texel weights of this level.
    weights: usize,
}

/// Levels of the largest pyramid.
const MAX_HALVINGS: usize = 12;

/// Weights by row, and the same by column.
#[derive(Debug, Default)]
struct Stored {
    forward: Sparse,
    transposed: Sparse,
}

/// A sparse matrix by rows.
#[derive(Debug, Default)]
struct Sparse {
    starts: Vec<usize>,
    columns: Vec<u32>,
    weights: Vec<f32>,
}

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
            let texels = each_texel(resolution)
                .map(|(face, column, row)| {
                    let [x, y, z] = texel_direction(face, column, row, resolution).map(Double);
                    (vec3(x, y, z), texel_solid_angle(column, row, resolution))
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

fn texel_of_index(index: usize, resolution: usize) -> (usize, usize, usize) {
    let area = resolution * resolution;
    (index / area, index % resolution, index % area / resolution)
}

impl Operator {
    pub(crate) fn new(level: SimdLevel, scheme: PrefilterScheme, resolution: usize, kept: LevelRange) -> Self {
        let levels = Levels::new(scheme, resolution);
        let mut pyramid = Vec::new();
        let (mut size, mut offset) = (resolution, 0);
        while size >= COARSEST.min(resolution) {
            pyramid.push((size, offset));
            offset += FACE_COUNT * size * size;
            size /= 2;
        }
        let blocks = Self::row_blocks(scheme, &levels, kept, &pyramid);
        let mut padded_offsets = vec![0];
        for block in &blocks {
            padded_offsets.push(padded_offsets[padded_offsets.len() - 1] + padded_len(block.resolution));
        }
        let nodes = NodeTable::new(2 * resolution);
        let of_level = |size: usize| (0..size * size).map(move |k| official_texel_weight(k % size, k / size, size));
        let official_weights = pyramid.iter().flat_map(|(size, _)| of_level(*size)).collect();
        let mut operator = Self {
            level,
            scheme,
            resolution,
            levels,
            pyramid,
            blocks,
            padded_offsets,
            nodes,
            official_weights,
            reductions: Vec::new(),
            stored: None,
            aprons: Stored::default(),
        };
        operator.stored = operator.store();
        operator.reductions =
            operator.pyramid.windows(2).map(|pair| operator.reduction(pair[0].0, pair[1].0)).collect();
        operator.aprons = operator.aprons();
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

    fn row_count(&self) -> usize {
        let last = self.blocks[self.blocks.len() - 1];
        last.first_row + FACE_COUNT * last.resolution * last.resolution
    }
    fn padded_count(&self) -> usize {
        self.padded_offsets[self.blocks.len()]
    }
    fn node_count(&self) -> usize {
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

    /// [`Self::row`], if its level is looked up; else nothing.
    fn kept_row(&self, row: usize, taps: &mut Vec<(u32, f64)>) {
        taps.clear();
        if self.block_of_row(row).is_kept {
            self.row(row, taps);
        }
    }

    /// Weights of one row, normalised, into `taps`.
    fn row(&self, row: usize, taps: &mut Vec<(u32, f64)>) {
        taps.clear();
        let block = self.block_of_row(row);
        let (face, column, row) = texel_of_index(row - block.first_row, block.resolution);
        let [x, y, z] = texel_direction(face, column, row, block.resolution).map(Double);
        let direction = vec3(x, y, z);
        let mut normalised = true;
        for root in self.roots() {
            match block.kind {
                RowKind::Base => {}
                RowKind::Exact { alpha_ggx } => self.cut(root, direction, alpha_ggx, taps),
                RowKind::Official { alpha_ggx, cut_cosine, source } => {
                    let cone = self.cone_around(direction, cut_cosine, source);
                    let weigh =
                        |light_dir, weight| official_lobe_weight(direction, light_dir, weight, alpha_ggx, cut_cosine);
                    self.cone(root, &cone, &weigh, taps);
                }
                RowKind::OfficialIrradiance { source } => {
                    normalised = false;
                    let cone = self.cone_around(direction, 0.0, source);
                    let weigh = |light_dir, weight| official_irradiance_weight(direction, light_dir, weight);
                    self.cone(root, &cone, &weigh, taps);
                }
            }
        }
        if normalised {
            let sum: f64 = taps.iter().map(|(_, weight)| weight).sum();
            taps.iter_mut().for_each(|(_, weight)| *weight /= sum);
        }
    }

    fn roots(&self) -> impl Iterator<Item = Node> + '_ {
        let resolution = self.pyramid[self.pyramid.len() - 1].0;
        each_texel(resolution).map(move |(face, column, row)| Node { face, column, row, resolution })
    }

    /// Our rows: nodes small enough for the lobe where they lie.
    fn cut(&self, node: Node, direction: Vec3<Double>, alpha_ggx: f64, taps: &mut Vec<(u32, f64)>) {
        let must_open = || must_open(self.nodes.get(&node).0, node.resolution, direction, alpha_ggx);
        if node.resolution < self.resolution && must_open() {
            return node.children().into_iter().for_each(|child| self.cut(child, direction, alpha_ggx, taps));
        }
        let weight = lobe_weight_of_quarters(&node.children().map(|c| self.nodes.get(&c)), direction, alpha_ggx);
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

    /// The weights by row, unless there are too many. Which of the two it is must not depend on the levels that are kept:
    /// their sums are rounded in another order.
    fn store(&self) -> Option<Stored> {
        const ROWS_AT_ONCE: usize = 512;
        let rows: Vec<usize> = (0..self.row_count()).collect();
        let sample: usize = rows.iter().step_by(97).take(512).map(|row| self.tap_count(*row)).sum();
        if sample / rows.len().div_ceil(97).clamp(1, 512) * rows.len() > STORED_WEIGHTS_MAX {
            return None;
        }
        let parts: Vec<Sparse> = rows.par_chunks(ROWS_AT_ONCE).map(|rows| self.sparse_rows(rows)).collect();
        Some(Stored::new(Sparse::join(&parts), self.node_count()))
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
    fn reduction(&self, fine: usize, coarse: usize) -> Stored {
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
        Stored::new(sparse, FACE_COUNT * fine * fine)
    }

    /// Levels with their aprons. A level that is the base takes its texels from there.
    fn aprons(&self) -> Stored {
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
        Stored::new(sparse, self.node_count() + self.row_count())
    }

    /// From the radiance of the base, at the front, to the pyramid and the rows behind it.
    fn filter(&self, nodes: &mut [Texel]) {
        let (nodes, rows) = nodes.split_at_mut(self.node_count());
        for (pair, reduction) in self.pyramid.windows(2).zip(&self.reductions) {
            let (fine, coarse) = nodes.split_at_mut(pair[1].1);
            let count = reduction.forward.starts.len() - 1;
            reduction.forward.apply(self.level, &fine[pair[0].1..], &mut coarse[..count], false);
        }
        match &self.stored {
            Some(stored) => stored.forward.apply(self.level, nodes, rows, false),
            None => rows.par_iter_mut().enumerate().for_each_init(Vec::new, |taps, (row, sum)| {
                self.kept_row(row, taps);
                *sum = [0.0; 4];
                taps.iter().for_each(|(node, weight)| add_scaled(sum, *weight as f32, &nodes[*node as usize]));
            }),
        }
    }

    /// From the gradients of pyramid and rows to that of the base, at the front.
    fn filter_vjp(&self, nodes: &mut [Texel]) {
        let (nodes, rows) = nodes.split_at_mut(self.node_count());
        if let Some(stored) = &self.stored {
            stored.transposed.apply(self.level, rows, nodes, true);
        } else {
            let mut taps = Vec::new();
            for (row, grad) in rows.iter().enumerate() {
                self.kept_row(row, &mut taps);
                taps.iter().for_each(|(node, weight)| add_scaled(&mut nodes[*node as usize], *weight as f32, grad));
            }
        }
        for (pair, reduction) in self.pyramid.windows(2).zip(&self.reductions).rev() {
            let (fine, coarse) = nodes.split_at_mut(pair[1].1);
            let count = reduction.forward.starts.len() - 1;
            reduction.transposed.apply(self.level, &coarse[..count], &mut fine[pair[0].1..], true);
        }
    }
}

/// Calls `visit` for every texel of a padded map in order, with the texels that it shows and the weight of each.
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

#[inline(always)]
fn add_scaled(sum: &mut Texel, factor: f32, texel: &Texel) {
    for (sum, value) in sum.iter_mut().zip(texel) {
        *sum += factor * value;
    }
}

impl Stored {
    fn new(forward: Sparse, column_count: usize) -> Self {
        let transposed = forward.transpose(column_count);
        Self { forward, transposed }
    }
}

impl Sparse {
    fn push(&mut self, column: usize, weight: f32) {
        self.columns.push(column as u32);
        self.weights.push(weight);
    }
    fn end_row(&mut self) {
        self.starts.push(self.columns.len());
    }
    fn join(parts: &[Self]) -> Self {
        let mut whole = Self { starts: vec![0], ..Self::default() };
        for part in parts {
            let offset = whole.columns.len();
            whole.starts.extend(part.starts[1..].iter().map(|start| start + offset));
            whole.columns.extend(&part.columns);
            whole.weights.extend(&part.weights);
        }
        whole
    }

    fn transpose(&self, column_count: usize) -> Self {
        let mut starts = vec![0; column_count + 1];
        self.columns.iter().for_each(|column| starts[*column as usize + 1] += 1);
        (0..column_count).for_each(|column| starts[column + 1] += starts[column]);
        let mut next = starts.clone();
        let (mut columns, mut weights) = (vec![0; self.columns.len()], vec![0.0; self.columns.len()]);
        for row in 0..self.starts.len() - 1 {
            for tap in self.starts[row]..self.starts[row + 1] {
                let place = &mut next[self.columns[tap] as usize];
                columns[*place] = row as u32;
                weights[*place] = self.weights[tap];
                *place += 1;
            }
        }
        Self { starts, columns, weights }
    }

    /// The matrix times `source`; added to what is there, if that is wanted.
    fn apply(&self, level: SimdLevel, source: &[Texel], out: &mut [Texel], adds: bool) {
        const ROWS_AT_ONCE: usize = 256;
        out.par_chunks_mut(ROWS_AT_ONCE).enumerate().for_each(|(chunk, out)| {
            dispatch!(level, simd => self.apply_rows(simd, chunk * ROWS_AT_ONCE, source, out, adds));
        });
    }

    #[inline(always)]
    fn apply_rows<S: Simd>(&self, simd: S, first: usize, source: &[Texel], out: &mut [Texel], adds: bool) {
        for (row, out) in (first..).zip(out) {
            let taps = self.starts[row]..self.starts[row + 1];
            let before = if adds { *out } else { [0.0; 4] };
            *out = weighted_sum(simd, before, &self.columns[taps.clone()], &self.weights[taps], source);
        }
    }
}

/// `before` + Σ weight · source\[column\], four sums side by side that are added at the end.
#[inline(always)]
fn weighted_sum<S: Simd>(simd: S, before: Texel, columns: &[u32], weights: &[f32], source: &[Texel]) -> Texel {
    let at = |column: u32| f32x4::simd_from(simd, source[column as usize]);
    let zero = f32x4::splat(simd, 0.0);
    let (mut a, mut b, mut c, mut d) = (f32x4::simd_from(simd, before), zero, zero, zero);
    let (columns, columns_rest) = columns.as_chunks::<4>();
    let (weights, weights_rest) = weights.as_chunks::<4>();
    for (columns, weights) in columns.iter().zip(weights) {
        a = at(columns[0]).mul_add(f32x4::splat(simd, weights[0]), a);
        b = at(columns[1]).mul_add(f32x4::splat(simd, weights[1]), b);
        c = at(columns[2]).mul_add(f32x4::splat(simd, weights[2]), c);
        d = at(columns[3]).mul_add(f32x4::splat(simd, weights[3]), d);
    }
    for (column, weight) in columns_rest.iter().zip(weights_rest) {
        a = at(*column).mul_add(f32x4::splat(simd, *weight), a);
    }
    ((a + b) + (c + d)).into()
}
