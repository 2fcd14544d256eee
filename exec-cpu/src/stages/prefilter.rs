//! Light into roughness levels: a sparse linear operator, built once for a resolution and applied
//! at every step.

use super::{
    illuminate::Lamps,
    light_network::{evaluate_all, evaluate_all_vjp},
};
use crate::{buffer::Buffer, context::Context};
use fearless_simd::{Level as SimdLevel, Simd, dispatch, f32x4, f32x8, prelude::*};
use rayon::prelude::*;
use specula_core::{
    cubemap::{FACE_COUNT, padded_index},
    environment::{radiance, radiance_vjp},
    light_view::TexelMap,
    near_field::NearField,
    pack::Storage,
    prefilter::Level,
    scene::{Environment, RadianceActivation},
};
use specula_prefilter::{Operator, Rows, encoded::EncodedTexels, sparse::Sparse};
use std::sync::Arc;

pub use crate::texel::Texel;

/// A light filtered into levels, each with its apron.
#[derive(Clone, Debug)]
pub struct Light {
    operator: Arc<Operator>,
    /// All levels, one after the other; then the irradiance map, if there is one.
    pub(crate) texels: Buffer<Texel>,
    /// Inputs of the texels: the pyramid of the base's radiance, finest first, then the filtered
    /// rows.
    nodes: Buffer<Texel>,
    /// Texels of a network, which replaces the pyramid; `None` for a cube map.
    encoded: Option<Arc<EncodedTexels>>,
    /// Surface of the scene that reflected rays may hit.
    pub(crate) near_field: Option<Arc<NearField<Vec<f32>>>>,
    /// Lamps in addition to the distant light.
    pub(crate) lamps: Option<Arc<Lamps>>,
}

/// Gradient of a [`Light`], texel by texel.
#[derive(Clone, Debug)]
pub struct LightGrad {
    pub(crate) texels: Buffer<Texel>,
}

#[cfg(feature = "testing")]
impl LightGrad {
    /// The gradient of each texel, in the order of [`Light::texels`].
    pub fn texels(&self) -> &[Texel] {
        &self.texels
    }
}

impl Light {
    /// The levels.
    pub fn levels(&self) -> &[Level] {
        self.operator.levels()
    }
    /// Map of each level, and of the irradiance behind them, if there is one.
    #[inline(always)]
    pub(crate) fn maps(&self) -> &[TexelMap] {
        self.operator.maps()
    }
    /// All levels, one after the other, each with its apron; then the irradiance map, if there is
    /// one.
    pub fn texels(&self) -> &[Texel] {
        &self.texels
    }
    /// Red, green and blue of a level's texels, without the apron: face by face, rows from the top.
    pub fn faces(&self, level: usize) -> Vec<f32> {
        let TexelMap { first, resolution } = self.maps()[level];
        let texels = &self.texels[first..];
        let texel = |index: usize| {
            let (face, row, column) =
                (index / resolution / resolution, index / resolution % resolution, index % resolution);
            texels[padded_index(face, column as isize, row as isize, resolution)]
        };
        (0..FACE_COUNT * resolution * resolution).flat_map(|index| texel(index).into_iter().take(3)).collect()
    }
    /// Writes externally filtered texels to a level: with the apron, in the order of
    /// [`specula_core::cubemap::padded_index`].
    pub fn set_level(&mut self, level: usize, texels: impl IntoIterator<Item = [f32; 3]>) {
        let first = self.maps()[level].first;
        for (texel, [red, green, blue]) in self.texels[first..].iter_mut().zip(texels) {
            *texel = [red, green, blue, 0.0];
        }
    }
    #[cfg(feature = "testing")]
    /// The gradient of this light from that of its texels.
    pub fn grad(&self, grads: &[Texel]) -> LightGrad {
        let mut texels = self.texels.clone();
        texels.copy_from_slice(grads);
        LightGrad { texels }
    }
    /// Texels of all levels.
    pub fn texel_count(&self) -> usize {
        self.texels.len()
    }
    /// Number of products of a weight and a texel; zero if there were too many weights to store.
    pub fn weight_count(&self) -> usize {
        self.operator.product_count().unwrap_or(0)
    }
    /// Rounds every texel to a storage format, like other executors.
    pub fn round(&mut self, storage: Storage) {
        self.texels.iter_mut().for_each(|texel| *texel = storage.texel(*texel));
    }
    /// Attaches a near field.
    pub(crate) fn around(self, near_field: &Arc<NearField<Vec<f32>>>) -> Self {
        Self { near_field: Some(near_field.clone()), ..self }
    }
    /// Attaches lamps.
    pub(crate) fn with_lamps(self, lamps: Lamps) -> Self {
        Self { lamps: Some(Arc::new(lamps)), ..self }
    }
    /// Filters an environment with an operator for its resolution.
    pub(crate) fn new(context: &Context, operator: Arc<Operator>, environment: &Environment<Vec<f32>>) -> Self {
        let mut nodes = context.take::<Texel>(operator.node_count() + operator.row_count());
        let values = environment.values.par_chunks_exact(3).with_min_len(TEXELS_AT_ONCE);
        nodes.par_iter_mut().zip(values).for_each(|(node, rgb)| *node = activate(environment.activation, rgb));
        filter(context, &operator, &mut nodes);
        let mut texels = context.take::<Texel>(operator.padded_count());
        apply(context.level, &operator.aprons().forward, &nodes, &mut texels, false);
        Self { operator, texels, nodes, encoded: None, near_field: None, lamps: None }
    }
    /// Evaluates a light's network in every texel.
    pub(crate) fn of_network(context: &Context, encoded: &Arc<EncodedTexels>, values: &[f32]) -> Self {
        let operator = encoded.operator().clone();
        let mut nodes = context.take_cleared::<Texel>(operator.node_count() + operator.row_count());
        evaluate_all(context, encoded, values, &mut nodes);
        let mut texels = context.take::<Texel>(operator.padded_count());
        apply(context.level, &operator.aprons().forward, &nodes, &mut texels, false);
        Self { operator, texels, nodes, encoded: Some(encoded.clone()), near_field: None, lamps: None }
    }
    /// Gradient with respect to the environment's numbers.
    pub(crate) fn vjp(&self, context: &Context, environment: &Environment<Vec<f32>>, grad: &LightGrad) -> Vec<f32> {
        let activation = environment.activation;
        let mut nodes = context.take::<Texel>(self.nodes.len());
        apply(context.level, self.operator.aprons().transposed(), &grad.texels, &mut nodes, false);
        if let Some(encoded) = &self.encoded {
            return evaluate_all_vjp(context, encoded, &environment.values, &self.nodes, &nodes);
        }
        filter_vjp(context, &self.operator, &mut nodes);
        let resolution = self.operator.base_resolution();
        let mut out = context.take::<f32>(3 * FACE_COUNT * resolution * resolution);
        let texels = out.par_chunks_exact_mut(3).with_min_len(TEXELS_AT_ONCE);
        texels.zip(nodes.par_iter()).zip(self.nodes.par_iter()).for_each(|((out, grad), radiance)| {
            out.copy_from_slice(&activate_vjp(activation, grad, radiance));
        });
        out.into_vec()
    }
}

fn activate(activation: RadianceActivation, rgb: &[f32]) -> Texel {
    [radiance(activation, rgb[0]), radiance(activation, rgb[1]), radiance(activation, rgb[2]), 0.0]
}

fn activate_vjp(activation: RadianceActivation, grad: &Texel, radiance: &Texel) -> [f32; 3] {
    core::array::from_fn(|c| radiance_vjp(activation, radiance[c], grad[c]))
}

/// Computes the pyramid and the following rows from the radiance of the base at the front.
fn filter(context: &Context, operator: &Operator, nodes: &mut [Texel]) {
    let (nodes, rows) = nodes.split_at_mut(operator.node_count());
    for ([fine, coarse], reduction) in operator.reductions() {
        let (below, above) = nodes.split_at_mut(coarse);
        let count = reduction.forward.row_count();
        apply(context.level, &reduction.forward, &below[fine..], &mut above[..count], false);
    }
    match operator.rows() {
        Some(Rows::All(stored)) => apply(context.level, &stored.forward, nodes, rows, false),
        Some(Rows::FirstFace(stored, faces)) => {
            let seen = gathered(context, &faces.nodes, nodes);
            let mut filtered = context.take::<Texel>(faces.rows.len());
            apply_to_faces(context.level, &stored.forward, &seen, &mut filtered);
            gather(&faces.places_of_rows, &filtered, rows);
        }
        None => rows.par_iter_mut().enumerate().for_each_init(Vec::new, |taps, (row, sum)| {
            operator.kept_row(row, taps);
            *sum = [0.0; 4];
            taps.iter().for_each(|(node, weight)| add_scaled(sum, *weight as f32, &nodes[*node as usize]));
        }),
    }
}

/// Computes the gradient of the base, at the front, from those of pyramid and rows.
fn filter_vjp(context: &Context, operator: &Operator, nodes: &mut [Texel]) {
    let (nodes, rows) = nodes.split_at_mut(operator.node_count());
    match operator.rows() {
        Some(Rows::All(stored)) => apply(context.level, stored.transposed(), rows, nodes, true),
        Some(Rows::FirstFace(stored, faces)) => {
            let grads = gathered(context, &faces.rows, rows);
            let mut seen = context.take::<Texel>(faces.nodes.len());
            apply_to_faces(context.level, stored.transposed(), &grads, &mut seen);
            let places = faces.places_of_nodes.par_chunks_exact(FACE_COUNT).with_min_len(TEXELS_AT_ONCE);
            nodes.par_iter_mut().zip(places).for_each(|(node, places)| {
                places.iter().for_each(|place| add_scaled(node, 1.0, &seen[*place as usize]));
            });
        }
        None => {
            let mut taps = Vec::new();
            for (row, grad) in rows.iter().enumerate() {
                operator.kept_row(row, &mut taps);
                taps.iter().for_each(|(node, weight)| add_scaled(&mut nodes[*node as usize], *weight as f32, grad));
            }
        }
    }
    for ([fine, coarse], reduction) in operator.reductions().rev() {
        let (below, above) = nodes.split_at_mut(coarse);
        let count = reduction.forward.row_count();
        apply(context.level, reduction.transposed(), &above[..count], &mut below[fine..], true);
    }
}

/// Texels of a task that only copies them.
const TEXELS_AT_ONCE: usize = 1024;

/// The texels of these indices.
fn gathered(context: &Context, indices: &[u32], texels: &[Texel]) -> Buffer<Texel> {
    let mut found = context.take::<Texel>(indices.len());
    gather(indices, texels, &mut found);
    found
}

/// Copies the texels of these indices.
fn gather(indices: &[u32], texels: &[Texel], out: &mut [Texel]) {
    out.par_iter_mut().with_min_len(TEXELS_AT_ONCE).zip(indices).for_each(|(out, index)| {
        *out = texels[*index as usize];
    });
}

/// Matrix times the texels of all faces side by side: each weight serves six products.
fn apply_to_faces(level: SimdLevel, matrix: &Sparse, source: &[Texel], out: &mut [Texel]) {
    const ROWS_AT_ONCE: usize = 64;
    let (source, _) = source.as_chunks::<FACE_COUNT>();
    let (out, _) = out.as_chunks_mut::<FACE_COUNT>();
    out.par_chunks_mut(ROWS_AT_ONCE).enumerate().for_each(|(chunk, out)| {
        dispatch!(level, simd => apply_rows_to_faces(simd, matrix, chunk * ROWS_AT_ONCE, source, out));
    });
}

#[inline(always)]
fn apply_rows_to_faces<S: Simd>(
    simd: S,
    matrix: &Sparse,
    first: usize,
    source: &[[Texel; FACE_COUNT]],
    out: &mut [[Texel; FACE_COUNT]],
) {
    for (row, out) in (first..).zip(out) {
        let taps = matrix.starts[row]..matrix.starts[row + 1];
        sums_of_faces(simd, &matrix.columns[taps.clone()], &matrix.weights[taps], source, out);
    }
}

/// Numbers of the texels of all faces side by side, as vectors.
const LANES: usize = 8;
const VECTORS: usize = FACE_COUNT * size_of::<Texel>() / size_of::<f32>() / LANES;

/// Σ weight · source\[column\] of all faces, four sums side by side that are added at the end.
#[inline(always)]
fn sums_of_faces<S: Simd>(
    simd: S,
    columns: &[u32],
    weights: &[f32],
    source: &[[Texel; FACE_COUNT]],
    out: &mut [Texel; FACE_COUNT],
) {
    let mut sums = [[f32x8::splat(simd, 0.0); VECTORS]; 4];
    let (columns, columns_rest) = columns.as_chunks::<4>();
    let (weights, weights_rest) = weights.as_chunks::<4>();
    for (columns, weights) in columns.iter().zip(weights) {
        for k in 0..4 {
            sums[k] = add_to_faces(simd, sums[k], weights[k], &source[columns[k] as usize]);
        }
    }
    for (column, weight) in columns_rest.iter().zip(weights_rest) {
        sums[0] = add_to_faces(simd, sums[0], *weight, &source[*column as usize]);
    }
    let (out, _) = out.as_flattened_mut().as_chunks_mut::<LANES>();
    for (vector, out) in out.iter_mut().enumerate() {
        *out = ((sums[0][vector] + sums[1][vector]) + (sums[2][vector] + sums[3][vector])).into();
    }
}

/// Adds the texels of all faces times a weight.
#[inline(always)]
fn add_to_faces<S: Simd>(
    simd: S,
    mut sum: [f32x8<S>; VECTORS],
    weight: f32,
    texels: &[Texel; FACE_COUNT],
) -> [f32x8<S>; VECTORS] {
    let weight = f32x8::splat(simd, weight);
    let (texels, _) = texels.as_flattened().as_chunks::<LANES>();
    for (sum, texels) in sum.iter_mut().zip(texels) {
        *sum = f32x8::simd_from(simd, *texels).mul_add(weight, *sum);
    }
    sum
}

#[inline(always)]
fn add_scaled(sum: &mut Texel, factor: f32, texel: &Texel) {
    for (sum, value) in sum.iter_mut().zip(texel) {
        *sum += factor * value;
    }
}

/// Matrix times `source`, added to the present values if `adds` is set.
fn apply(level: SimdLevel, matrix: &Sparse, source: &[Texel], out: &mut [Texel], adds: bool) {
    const ROWS_AT_ONCE: usize = 256;
    out.par_chunks_mut(ROWS_AT_ONCE).enumerate().for_each(|(chunk, out)| {
        dispatch!(level, simd => apply_rows(simd, matrix, chunk * ROWS_AT_ONCE, source, out, adds));
    });
}

#[inline(always)]
fn apply_rows<S: Simd>(simd: S, matrix: &Sparse, first: usize, source: &[Texel], out: &mut [Texel], adds: bool) {
    for (row, out) in (first..).zip(out) {
        let taps = matrix.starts[row]..matrix.starts[row + 1];
        let before = if adds { *out } else { [0.0; 4] };
        *out = weighted_sum(simd, before, &matrix.columns[taps.clone()], &matrix.weights[taps], source);
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
