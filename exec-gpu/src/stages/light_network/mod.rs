//! A light's network, evaluated in the texels of all levels, and the gradient of its weights.

use crate::{
    codegen::{source::Source, uniform::uniform},
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
        light::{
            LightGrad, LightLayout, TEXEL_LEN,
            matrix::{Matrix, Out},
            texel_words,
        },
        prefilter::formulas::RadianceOf,
        prefilter_vjp::formulas::RadianceVjp,
    },
};
use bytemuck::Zeroable;
use formulas::{BoundedNumber, BoundedNumberVjp, BoundedWeight, BoundedWeightVjp, Rectify, RectifyVjp};
use specula_core::{
    light_network::{CHANNELS, ENCODING, LAYER_STARTS, WEIGHT_COUNT, WIDTH},
    pack::Storage,
    prefilter::LevelRange,
    scene::{Environment, RadianceActivation},
};
use specula_prefilter::encoded::EncodedTexels;
use std::sync::{Arc, OnceLock};

pub mod formulas;

/// Texels with products that are summed sequentially.
const PART: usize = 512;
/// Texels with records at the same time: 32 MiB.
const TEXELS_AT_ONCE: usize = 64 * PART;
/// Offsets in a texel's record: outputs of both hidden layers, gradients of their sums, and of the
/// last sums.
const NEAR: usize = 0;
const FAR: usize = NEAR + WIDTH;
const OF_NEAR: usize = FAR + WIDTH;
const OF_FAR: usize = OF_NEAR + WIDTH;
const OF_SUMS: usize = OF_FAR + WIDTH;
const RECORD: usize = OF_SUMS + CHANNELS + 1;

const ACTIVATION: RadianceActivation = RadianceActivation::Network;

/// Texels of a network on the device.
#[derive(Debug)]
pub(crate) struct NetworkTexels {
    encoded: EncodedTexels,
    encodings: Array,
    aprons: Matrix,
    /// Transposed matrix, uploaded for the first gradient.
    transposed: OnceLock<Matrix>,
    /// Split-sum table, uploaded for the first physical material.
    pub(crate) split_sum: OnceLock<Array>,
}

uniform! {
    /// Texels that a network is evaluated in.
    struct Texels {
        /// Texels of the dispatch, and the first of them.
        count: u32,
        first: u32,
        /// Encoded texels of the base, the node of the first of them, and that of the first behind
        /// them.
        base_count: u32,
        base_first: u32,
        row_first: u32,
        /// The first part of the dispatch, and all parts.
        part_first: u32,
        part_count: u32,
    }
}

fn network(source: Source) -> Source {
    let [_, second, third, _] = LAYER_STARTS;
    let counts = [
        ("ENCODING", ENCODING),
        ("WIDTH", WIDTH),
        ("CHANNELS", CHANNELS),
        ("SECOND", second),
        ("THIRD", third),
        ("WEIGHT_COUNT", WEIGHT_COUNT),
        ("PART", PART),
        ("NEAR", NEAR),
        ("FAR", FAR),
        ("OF_NEAR", OF_NEAR),
        ("OF_FAR", OF_FAR),
        ("OF_SUMS", OF_SUMS),
        ("RECORD", RECORD),
    ];
    let source = counts.into_iter().fold(source, |source, (name, value)| source.count(name, value));
    let source = source.real().formula(&RadianceOf { activation: ACTIVATION });
    source
        .formula(&BoundedWeight)
        .formula(&BoundedNumber)
        .formula(&Rectify)
        .uniform::<Texels>()
        .with(include_str!("network.wgsl"))
}

fn evaluate_source() -> String {
    Source::new().part(network).with(include_str!("evaluate.wgsl")).text()
}

fn evaluate_vjp_source() -> String {
    let source = Source::new().part(network).formula(&RadianceVjp { activation: ACTIVATION });
    source.formula(&BoundedNumberVjp).formula(&RectifyVjp).with(include_str!("evaluate_vjp.wgsl")).text()
}

fn weights_vjp_source() -> String {
    Source::new().part(network).with(include_str!("weights_vjp.wgsl")).text()
}

fn sum_parts_source() -> String {
    Source::new().part(network).formula(&BoundedWeightVjp).with(include_str!("sum_parts.wgsl")).text()
}

impl NetworkTexels {
    /// Encodes and uploads the texels of the kept levels of a base of this resolution.
    pub(crate) fn new(context: &mut Context, resolution: usize, kept: LevelRange) -> Result<Arc<Self>, GpuError> {
        let encoded = EncodedTexels::new(resolution, kept);
        // Arrays must not be empty.
        let no_encodings = [[0.0; ENCODING]];
        let encodings = if encoded.encodings().is_empty() { &no_encodings } else { encoded.encodings() };
        let encodings = context.upload("encoded directions of a light", encodings)?;
        let aprons = Matrix::new(context, &encoded.operator().aprons().forward)?;
        Ok(Arc::new(Self { encoded, encodings, aprons, transposed: OnceLock::new(), split_sum: OnceLock::new() }))
    }

    /// Resolution and kept levels.
    pub(crate) fn key(&self) -> (usize, LevelRange) {
        (self.encoded.resolution(), self.encoded.kept_levels())
    }

    fn transposed(&self, context: &mut Context) -> Result<&Matrix, GpuError> {
        if let Some(transposed) = self.transposed.get() {
            return Ok(transposed);
        }
        let transposed = Matrix::new(context, self.encoded.operator().aprons().transposed())?;
        Ok(self.transposed.get_or_init(|| transposed))
    }

    /// All texels, in one dispatch.
    fn texels(&self) -> Texels {
        let [base, rows] = self.encoded.nodes();
        Texels {
            count: self.encoded.encodings().len() as u32,
            base_count: base.len() as u32,
            base_first: base.start as u32,
            row_first: rows.start as u32,
            ..Texels::zeroed()
        }
    }

    fn node_len(&self) -> usize {
        let operator = self.encoded.operator();
        TEXEL_LEN * (operator.node_count() + operator.row_count())
    }
}

/// Evaluates a network in the texels of all kept levels, in a layout with their aprons.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn evaluate(
    context: &mut Context,
    network: &NetworkTexels,
    environment: &Environment<&Array>,
    storage: Storage,
) -> Result<(LightLayout, Array), GpuError> {
    let operator = network.encoded.operator();
    let nodes = context.zeros("texels of a light", network.node_len())?;
    let texels = network.texels();
    let uniform = Uniform(texels.bytes());
    let bindings = [uniform, Buffer(environment.values), Buffer(&network.encodings), Buffer(&nodes)];
    let invocations = Dispatch::Invocations(texels.count as usize);
    context.dispatch("light_network", "evaluate_network", &evaluate_source, &bindings, invocations)?;
    let texels = context.allocate("levels of a light", texel_words(storage) * operator.padded_count())?;
    network.aprons.apply(context, &nodes, 0, Out::Other(&texels, storage))?;
    Ok((LightLayout::of(operator, storage), texels))
}

/// Gradient of a network's weights from that of its filtered light.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn evaluate_vjp(
    context: &mut Context,
    network: &NetworkTexels,
    environment: &Environment<&Array>,
    grad: &LightGrad,
) -> Result<Array, GpuError> {
    let nodes = context.allocate("gradient of a light", network.node_len())?;
    network.transposed(context)?.apply(context, &grad.texels, 0, Out::Other(&nodes, Storage::F32))?;
    let all = network.texels();
    let count = all.count as usize;
    let part_count = count.div_ceil(PART);
    let parts = context.allocate("parts of a gradient", WEIGHT_COUNT * part_count.max(1))?;
    let records = context.allocate("answers of a network", RECORD * count.clamp(1, TEXELS_AT_ONCE))?;
    for first in (0..count).step_by(TEXELS_AT_ONCE) {
        let at_once = (count - first).min(TEXELS_AT_ONCE);
        let (first, part_first) = (first as u32, (first / PART) as u32);
        let texels = Texels { count: at_once as u32, first, part_first, ..all };
        let [weights, encodings] = [Buffer(environment.values), Buffer(&network.encodings)];
        let uniform = Uniform(texels.bytes());
        context.dispatch(
            "light_network",
            "evaluate_network_vjp",
            &evaluate_vjp_source,
            &[uniform, weights, encodings, Buffer(&nodes), Buffer(&records)],
            Dispatch::Invocations(at_once),
        )?;
        context.dispatch(
            "light_network",
            "network_weights_vjp",
            &weights_vjp_source,
            &[uniform, weights, encodings, Buffer(&records), Buffer(&parts)],
            Dispatch::Invocations(WEIGHT_COUNT * at_once.div_ceil(PART)),
        )?;
    }
    let out = context.allocate("gradient of an environment", WEIGHT_COUNT)?;
    let texels = Texels { part_count: part_count as u32, ..all };
    context.dispatch(
        "light_network",
        "sum_network_parts",
        &sum_parts_source,
        &[
            Uniform(texels.bytes()),
            Buffer(environment.values),
            Buffer(&network.encodings),
            Buffer(&parts),
            Buffer(&out),
        ],
        Dispatch::Invocations(WEIGHT_COUNT),
    )?;
    Ok(out)
}
