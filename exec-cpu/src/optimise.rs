//! Adam over all planes of all Gaussians, and over a light.

use crate::lanes::Lanes;
use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    optimise::{Moment, adam, corrected_epsilon, corrected_rate},
    real::Real,
    scene::BLOCK,
};

/// One step for numbers in blocks of `rates.len()` planes; counts gradients that were not finite and were left out.
pub(crate) fn adam_blocks(
    level: Level,
    values: &mut [f32],
    mean: &mut [f32],
    square: &mut [f32],
    grad: &[f32],
    rates: &[f32],
    step: u32,
) -> usize {
    const BLOCKS_AT_ONCE: usize = 16;
    let rates: Vec<f32> = rates.iter().map(|rate| corrected_rate(*rate, step)).collect();
    let epsilon = corrected_epsilon(step);
    let chunk = BLOCKS_AT_ONCE * BLOCK * rates.len();
    values
        .par_chunks_mut(chunk)
        .zip(mean.par_chunks_mut(chunk).zip(square.par_chunks_mut(chunk)))
        .zip(grad.par_chunks(chunk))
        .map(|((values, (mean, square)), grad)| {
            dispatch!(level, simd => adam_chunk(simd, values, mean, square, grad, &rates, epsilon))
        })
        .sum()
}

#[inline(always)]
fn adam_chunk<S: Simd>(
    simd: S,
    values: &mut [f32],
    mean: &mut [f32],
    square: &mut [f32],
    grad: &[f32],
    rates: &[f32],
    epsilon: f32,
) -> usize {
    let mut nonfinite = 0;
    let epsilon = Lanes::splat(simd, epsilon);
    let vectors = values.chunks_exact_mut(BLOCK).zip(mean.chunks_exact_mut(BLOCK)).zip(square.chunks_exact_mut(BLOCK));
    for ((((value, mean), square), grad), rate) in vectors.zip(grad.chunks_exact(BLOCK)).zip(rates.iter().cycle()) {
        let grad = Lanes::load(simd, grad);
        let is_finite = grad.abs().less_or_equal(grad.constant(f32::MAX));
        nonfinite += BLOCK - grad.constant(1.0).keep(is_finite).sum() as usize;
        let moment = Moment {
            value: Lanes::load(simd, value),
            mean: Lanes::load(simd, mean),
            square: Lanes::load(simd, square),
        };
        let next = adam(moment, grad.keep(is_finite), Lanes::splat(simd, *rate), epsilon);
        Lanes::select(is_finite, next.value, moment.value).store(value);
        Lanes::select(is_finite, next.mean, moment.mean).store(mean);
        Lanes::select(is_finite, next.square, moment.square).store(square);
    }
    nonfinite
}

/// One step for numbers that all have the same rate, however many there are.
pub(crate) fn adam_all(
    level: Level,
    values: &mut [f32],
    mean: &mut [f32],
    square: &mut [f32],
    grad: &[f32],
    rate: f32,
    step: u32,
) -> usize {
    let whole = values.len() / BLOCK * BLOCK;
    let (rate_now, epsilon) = (corrected_rate(rate, step), corrected_epsilon(step));
    let mut nonfinite = 0;
    for k in whole..values.len() {
        if !grad[k].is_finite() {
            nonfinite += 1;
            continue;
        }
        let next = adam(Moment { value: values[k], mean: mean[k], square: square[k] }, grad[k], rate_now, epsilon);
        (values[k], mean[k], square[k]) = (next.value, next.mean, next.square);
    }
    let rest = adam_blocks(
        level,
        &mut values[..whole],
        &mut mean[..whole],
        &mut square[..whole],
        &grad[..whole],
        &[rate],
        step,
    );
    nonfinite + rest
}
