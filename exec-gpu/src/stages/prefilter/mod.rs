//! Prefiltering of a light into roughness levels.

use crate::{
    codegen::{source::Source, uniform::Count},
    device::{
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        illuminate::Lamps,
        light::{
            LightLayout, TEXEL_LEN,
            matrix::{Matrix, Out},
            texel_words,
        },
        light_network::{NetworkTexels, evaluate},
    },
};
use formulas::RadianceOf;
use specula_core::{
    cubemap::FACE_COUNT,
    near_field::NearField,
    pack::Storage,
    prefilter::{LevelRange, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_prefilter::{
    Operator, SPLIT_SUM,
    sparse::{Linear, Sparse},
};
use std::sync::{Arc, OnceLock};

pub mod formulas;

/// Appends the numbers of an environment, and their radiance.
pub(crate) fn radiance(source: Source, activation: RadianceActivation) -> Source {
    source.real().formula(&RadianceOf { activation }).uniform::<Count>().with(include_str!("radiance.wgsl"))
}

pub(crate) fn activation_source(activation: RadianceActivation) -> String {
    Source::new().part(|source| radiance(source, activation)).with(include_str!("activate.wgsl")).text()
}

/// Light, filtered into roughness levels.
#[derive(Debug)]
pub struct Light {
    pub(crate) layout: LightLayout,
    /// Texels of all levels with their aprons, level after level.
    pub(crate) texels: Array,
    /// Split-sum table of the authors' shading; one entry in other schemes, in which physical
    /// materials use [`LightSource::split_sum`].
    pub(crate) split_sum: Array,
    /// Source of its texels.
    pub(crate) source: LightSource,
    /// Surface of the scene that reflected rays may hit.
    pub(crate) near_field: Option<Arc<NearField<Array>>>,
    /// Lamps in addition to the distant light.
    pub(crate) lamps: Option<Arc<Lamps>>,
}

impl Light {
    /// Attaches a near field.
    pub(crate) fn around(self, near_field: &Arc<NearField<Array>>) -> Self {
        Self { near_field: Some(near_field.clone()), ..self }
    }
    /// Attaches lamps.
    pub(crate) fn with_lamps(self, lamps: Lamps) -> Self {
        Self { lamps: Some(Arc::new(lamps)), ..self }
    }
}

/// Source of a light's texels.
#[derive(Clone, Debug)]
pub(crate) enum LightSource {
    /// Weights of the prefilter.
    Weights(Arc<Weights>),
    /// Texels in which a network is evaluated.
    Network(Arc<NetworkTexels>),
}

/// The weights of a prefilter on the device.
#[derive(Debug)]
pub(crate) struct Weights {
    /// Scheme, resolution and levels.
    pub(crate) key: (PrefilterScheme, usize, LevelRange),
    pub(crate) operator: Arc<Operator>,
    forward: Matrices,
    /// Transposed matrices, uploaded for the first gradient.
    transposed: OnceLock<Matrices>,
    /// Split-sum table, uploaded for the first physical material.
    split_sum: OnceLock<Array>,
}

impl LightSource {
    /// Split-sum table of physical materials.
    ///
    /// # Errors
    ///
    /// See [`Context::upload`].
    pub(crate) fn split_sum(&self, context: &mut Context) -> Result<&Array, GpuError> {
        let uploaded = match self {
            Self::Weights(weights) => &weights.split_sum,
            Self::Network(texels) => &texels.split_sum,
        };
        if let Some(split_sum) = uploaded.get() {
            return Ok(split_sum);
        }
        let split_sum = context.upload("split sums", &SPLIT_SUM)?;
        Ok(uploaded.get_or_init(|| split_sum))
    }
}

/// Matrices of a prefilter, or all of them transposed.
#[derive(Debug)]
pub(crate) struct Matrices {
    /// Reductions from each level of the pyramid to the next.
    pub(crate) reductions: Vec<Matrix>,
    /// Rows of the filter; `None` if there are too many weights to store, which are then computed
    /// at each use.
    pub(crate) rows: Option<Matrix>,
    pub(crate) aprons: Matrix,
}

impl Matrices {
    fn new(context: &mut Context, operator: &Operator, of: fn(&Linear) -> &Sparse) -> Result<Self, GpuError> {
        let reductions: Result<Vec<Matrix>, GpuError> =
            operator.reductions().map(|(_, reduction)| Matrix::new(context, of(reduction))).collect();
        Ok(Self {
            reductions: reductions?,
            rows: operator.all_rows().map(|rows| Matrix::new(context, of(&rows))).transpose()?,
            aprons: Matrix::new(context, of(operator.aprons()))?,
        })
    }
}

/// Weights on the device at a time, if not all are stored.
const WEIGHTS_AT_ONCE: usize = 1 << 22;

/// Applies rows that are not stored, part by part: `apply` receives the index of each part's first
/// row, and the part. Blocks after each part, so that one is on the device at a time.
pub(crate) fn apply_parts(
    context: &mut Context,
    operator: &Operator,
    mut apply: impl FnMut(&mut Context, usize, &Sparse) -> Result<(), GpuError>,
) -> Result<(), GpuError> {
    for (first_row, part) in operator.pieces(WEIGHTS_AT_ONCE) {
        apply(context, first_row, &part)?;
        context.finish()?;
    }
    Ok(())
}

impl Weights {
    pub(crate) fn new(context: &mut Context, key: (PrefilterScheme, usize, LevelRange)) -> Result<Arc<Self>, GpuError> {
        let (scheme, resolution, kept) = key;
        Self::of(context, key, Operator::shared(scheme, resolution, kept))
    }

    fn of(
        context: &mut Context,
        key: (PrefilterScheme, usize, LevelRange),
        operator: Arc<Operator>,
    ) -> Result<Arc<Self>, GpuError> {
        let forward = Matrices::new(context, &operator, |linear| &linear.forward)?;
        Ok(Arc::new(Self { key, forward, operator, transposed: OnceLock::new(), split_sum: OnceLock::new() }))
    }

    pub(crate) fn transposed(&self, context: &mut Context) -> Result<&Matrices, GpuError> {
        if let Some(transposed) = self.transposed.get() {
            return Ok(transposed);
        }
        let transposed = Matrices::new(context, &self.operator, Linear::transposed)?;
        Ok(self.transposed.get_or_init(|| transposed))
    }
}

/// Filters an environment into levels.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn prefilter(
    context: &mut Context,
    weights: &Arc<Weights>,
    environment: &Environment<&Array>,
    storage: Storage,
) -> Result<Light, GpuError> {
    let operator = &weights.operator;
    let texel_count = texel_count(environment);
    let nodes = context.allocate("texels of a light", TEXEL_LEN * (operator.node_count() + operator.row_count()))?;
    let size = Count::new(texel_count);
    let bindings = [Uniform(size.bytes()), Buffer(environment.values), Buffer(&nodes)];
    let activation = environment.activation;
    let (key, source) = (format!("{activation:?}"), || activation_source(activation));
    context.dispatch(&key, "activate_texels", &source, &bindings, Dispatch::Invocations(texel_count))?;
    for (([fine, coarse], _), matrix) in operator.reductions().zip(&weights.forward.reductions) {
        matrix.apply(context, &nodes, fine, Out::Texels(coarse))?;
    }
    let first_row = operator.node_count();
    match &weights.forward.rows {
        Some(rows) => rows.apply(context, &nodes, 0, Out::Texels(first_row))?,
        None => apply_parts(context, operator, |context, first, part| {
            Matrix::new(context, part)?.apply(context, &nodes, 0, Out::Texels(first_row + first))
        })?,
    }
    let texels = context.allocate("levels of a light", texel_words(storage) * operator.padded_count())?;
    weights.forward.aprons.apply(context, &nodes, 0, Out::Other(&texels, storage))?;
    let split_sum = match weights.key.0 {
        PrefilterScheme::Official => context.upload("split sums", &SPLIT_SUM)?,
        PrefilterScheme::Exact => context.upload("split sums", &[[0.0_f32; 2]])?,
    };
    let (layout, source) = (LightLayout::of(operator, storage), LightSource::Weights(weights.clone()));
    Ok(Light { layout, texels, split_sum, source, near_field: None, lamps: None })
}

/// Evaluates a network in the texels of all kept levels.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn evaluated(
    context: &mut Context,
    network: &Arc<NetworkTexels>,
    environment: &Environment<&Array>,
    storage: Storage,
) -> Result<Light, GpuError> {
    let (layout, texels) = evaluate(context, network, environment, storage)?;
    let split_sum = context.upload("split sums", &[[0.0_f32; 2]])?;
    let source = LightSource::Network(network.clone());
    Ok(Light { layout, texels, split_sum, source, near_field: None, lamps: None })
}

/// Texels of an environment.
pub(crate) fn texel_count<A>(environment: &Environment<A>) -> usize {
    FACE_COUNT * environment.resolution * environment.resolution
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::{light::LightGrad, prefilter_vjp::prefilter_vjp};
    use specula_core::random::uniform;

    /// A light and the gradient of its environment, from random numbers.
    fn there_and_back(context: &mut Context, weights: &Arc<Weights>) -> [Vec<f32>; 2] {
        let (_, resolution, _) = weights.key;
        let mut draw = |stream: u64, len: usize| {
            let numbers: Vec<f32> = (0..len).map(|k| uniform(3, stream, k as u64)).collect();
            context.upload("numbers", &numbers).expect("numbers fit")
        };
        let values = draw(0, 3 * FACE_COUNT * resolution * resolution);
        let grad = LightGrad { texels: draw(1, TEXEL_LEN * weights.operator.padded_count()) };
        let environment = Environment { resolution, activation: RadianceActivation::Identity, values };
        let environment = environment.with_values(&environment.values);
        let light = prefilter(context, weights, &environment, Storage::F32).expect("the device filters");
        let back = prefilter_vjp(context, &environment, &light, &grad).expect("the device goes back");
        [light.texels, back].map(|array| {
            let mut numbers = vec![0.0; array.len()];
            context.download(&array, 0, &mut numbers).expect("the length is that of the array");
            numbers
        })
    }

    #[test]
    fn stored_and_recomputed_rows_filter_equally() {
        let Some(mut context) = Context::for_tests() else { return };
        let key = (PrefilterScheme::Official, 64, LevelRange::ALL);
        let kept = Weights::new(&mut context, key).expect("weights fit");
        let mut operator = Operator::new(key.0, key.1, key.2);
        operator.forget_rows();
        let forgotten = Weights::of(&mut context, key, Arc::new(operator)).expect("weights fit");
        assert!(kept.forward.rows.is_some() && forgotten.forward.rows.is_none(), "both ways are taken");
        let [light, grad] = there_and_back(&mut context, &kept);
        let [same_light, same_grad] = there_and_back(&mut context, &forgotten);
        assert!(light == same_light, "the sum of a row does not depend on its part");
        // Sums over all rows are the sums of the parts.
        let largest = grad.iter().fold(0.0, |most: f32, x| most.max(x.abs()));
        let apart = grad.iter().zip(&same_grad).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest > 0.0 && apart <= 1e-6 * largest, "{apart:e} of {largest:e} apart");
    }
}
