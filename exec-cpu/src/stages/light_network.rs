//! A light's network, evaluated in the texels of all levels, and the gradient of its weights.

use crate::{context::Context, texel::Texel};
use fearless_simd::dispatch;
use rayon::prelude::*;
use specula_core::{
    environment::{radiance, radiance_vjp, weights_of},
    light_network::{CHANNELS, ENCODING, WEIGHT_COUNT, WEIGHT_MAX, bounded_vjp, evaluate, evaluate_vjp},
    scene::RadianceActivation,
};
use specula_prefilter::encoded::EncodedTexels;

/// Texels of a task. Gradients of weights are summed over each part, then over the parts in order.
const PART: usize = 512;
/// Weights per task in sums of parts.
const WEIGHTS_AT_ONCE: usize = 512;

/// Radiance of every kept texel into the nodes of the operator; the other nodes keep their values.
pub(crate) fn evaluate_all(context: &Context, encoded: &EncodedTexels, values: &[f32], nodes: &mut [Texel]) {
    let weights = weights_of(values);
    let mut encodings = encoded.encodings();
    for range in encoded.nodes() {
        let range_encodings;
        (range_encodings, encodings) = encodings.split_at(range.len());
        nodes[range].par_chunks_mut(PART).zip(range_encodings.par_chunks(PART)).for_each(|(nodes, encodings)| {
            dispatch!(context.level, _simd => evaluate_part(&weights, encodings, nodes));
        });
    }
}

#[inline(always)]
fn evaluate_part(weights: &[f32; WEIGHT_COUNT], encodings: &[[f32; ENCODING]], nodes: &mut [Texel]) {
    for (node, encoding) in nodes.iter_mut().zip(encodings) {
        let numbers = evaluate(weights, encoding).numbers();
        let [red, green, blue] = numbers.map(|number| radiance(RadianceActivation::Network, number));
        *node = [red, green, blue, 0.0];
    }
}

/// Gradient of the weights from that of the operator's nodes.
pub(crate) fn evaluate_all_vjp(
    context: &Context,
    encoded: &EncodedTexels,
    values: &[f32],
    nodes: &[Texel],
    grads: &[Texel],
) -> Vec<f32> {
    let weights = weights_of(values);
    let mut encodings = encoded.encodings();
    let mut tasks: Vec<(&[[f32; ENCODING]], &[Texel], &[Texel])> = Vec::new();
    for range in encoded.nodes() {
        let range_encodings;
        (range_encodings, encodings) = encodings.split_at(range.len());
        let texels = nodes[range.clone()].chunks(PART).zip(grads[range].chunks(PART));
        tasks.extend(
            range_encodings.chunks(PART).zip(texels).map(|(encodings, (nodes, grads))| (encodings, nodes, grads)),
        );
    }
    let mut sums = context.take_cleared::<f32>(tasks.len() * WEIGHT_COUNT);
    sums.par_chunks_mut(WEIGHT_COUNT).zip(&tasks).for_each(|(sums, (encodings, nodes, grads))| {
        dispatch!(context.level, _simd => evaluate_part_vjp(&weights, encodings, nodes, grads, sums));
    });
    let mut out = context.take_cleared::<f32>(WEIGHT_COUNT);
    out.par_chunks_mut(WEIGHTS_AT_ONCE).enumerate().for_each(|(chunk, out)| {
        let first = chunk * WEIGHTS_AT_ONCE;
        for part in sums.chunks_exact(WEIGHT_COUNT) {
            out.iter_mut().zip(&part[first..]).for_each(|(out, sum)| *out += sum);
        }
        for (out, weight) in out.iter_mut().zip(&values[first..]) {
            *out = bounded_vjp(*weight, WEIGHT_MAX, *out);
        }
    });
    out.into_vec()
}

#[inline(always)]
fn evaluate_part_vjp(
    weights: &[f32; WEIGHT_COUNT],
    encodings: &[[f32; ENCODING]],
    nodes: &[Texel],
    grads: &[Texel],
    sums: &mut [f32],
) {
    for ((encoding, node), grad) in encodings.iter().zip(nodes).zip(grads) {
        // Most texels are not looked up by a picture.
        if grad[..CHANNELS] == [0.0; CHANNELS] {
            continue;
        }
        let grad_numbers = core::array::from_fn(|c| radiance_vjp(RadianceActivation::Network, node[c], grad[c]));
        evaluate_vjp(weights, encoding, &evaluate(weights, encoding), grad_numbers, sums);
    }
}
