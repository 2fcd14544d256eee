//! Adam over all planes of all Gaussians, and over a light; sums of gradients.
//!
//! The gradient of sixteen Gaussians and their step of Adam are computed together, so that
//! gradients are never stored.

use crate::{buffer::Buffer, context::Context, lanes::Lanes};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    optimise::{Moment, adam, corrected_epsilon, corrected_rate, is_usable},
    real::Real,
    scene::BLOCK,
};

/// Corrected learning rates and ε of a step of Adam.
#[derive(Clone, Debug)]
pub(crate) struct StepSize {
    /// Learning rate of every plane, corrected for the start of a run.
    rates: Buffer<f32>,
    epsilon: f32,
}

impl StepSize {
    /// True if any of these planes has a learning rate.
    pub(crate) fn moves_any(&self, mut planes: core::ops::RangeInclusive<usize>) -> bool {
        planes.any(|plane| self.rates[plane] >= 0.0)
    }
    /// Step size of a step, counted from 1.
    pub(crate) fn new(context: &Context, rates: &[f32], step: u32) -> Self {
        let mut corrected = context.take::<f32>(rates.len());
        corrected.iter_mut().zip(rates).for_each(|(to, rate)| *to = corrected_rate(*rate, step));
        Self { rates: corrected, epsilon: corrected_epsilon(step) }
    }
}

/// Adds numbers to others, one by one.
pub(crate) fn add_all(sum: &mut [f32], terms: &[f32]) {
    const CHUNK: usize = 1 << 14;
    let add = |(sum, terms): (&mut [f32], &[f32])| sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
    sum.par_chunks_mut(CHUNK).zip(terms.par_chunks(CHUNK)).for_each(add);
}

/// One step for numbers in blocks with one rate per plane; counts gradients that were skipped
/// because they were not finite.
pub(crate) fn adam_blocks(
    context: &Context,
    values: &mut [f32],
    mean: &mut [f32],
    square: &mut [f32],
    grad: &[f32],
    size: &StepSize,
) -> usize {
    const BLOCKS_AT_ONCE: usize = 16;
    let chunk = BLOCKS_AT_ONCE * BLOCK * size.rates.len();
    values
        .par_chunks_mut(chunk)
        .zip(mean.par_chunks_mut(chunk).zip(square.par_chunks_mut(chunk)))
        .zip(grad.par_chunks(chunk))
        .map(|((values, (mean, square)), grad)| {
            dispatch!(context.level, simd => adam_chunk(simd, values, mean, square, grad, size))
        })
        .sum()
}

#[inline(always)]
pub(crate) fn adam_chunk<S: Simd>(
    simd: S,
    values: &mut [f32],
    mean: &mut [f32],
    square: &mut [f32],
    grad: &[f32],
    size: &StepSize,
) -> usize {
    let mut nonfinite = 0;
    let epsilon = Lanes::splat(simd, size.epsilon);
    let vectors = values.chunks_exact_mut(BLOCK).zip(mean.chunks_exact_mut(BLOCK)).zip(square.chunks_exact_mut(BLOCK));
    for ((((value, mean), square), grad), rate) in vectors.zip(grad.chunks_exact(BLOCK)).zip(size.rates.iter().cycle())
    {
        // At rest.
        if *rate < 0.0 {
            continue;
        }
        let grad = Lanes::load(simd, grad);
        let is_usable = is_usable(grad);
        nonfinite += BLOCK - is_usable.bits().count_ones() as usize;
        let moment = Moment {
            value: Lanes::load(simd, value),
            mean: Lanes::load(simd, mean),
            square: Lanes::load(simd, square),
        };
        let next = adam(moment, grad.keep(is_usable), Lanes::splat(simd, *rate), epsilon);
        Lanes::select(is_usable, next.value, moment.value).store(value);
        Lanes::select(is_usable, next.mean, moment.mean).store(mean);
        Lanes::select(is_usable, next.square, moment.square).store(square);
    }
    nonfinite
}

/// One step for numbers with the same rate.
pub(crate) fn adam_all(
    context: &Context,
    values: &mut [f32],
    mean: &mut [f32],
    square: &mut [f32],
    grad: &[f32],
    rate: f32,
    step: u32,
) -> usize {
    let whole = values.len() / BLOCK * BLOCK;
    let size = StepSize::new(context, &[rate], step);
    let mut nonfinite = 0;
    for k in whole..values.len() {
        if !is_usable(grad[k]) {
            nonfinite += 1;
            continue;
        }
        let moment = Moment { value: values[k], mean: mean[k], square: square[k] };
        let next = adam(moment, grad[k], size.rates[0], size.epsilon);
        (values[k], mean[k], square[k]) = (next.value, next.mean, next.square);
    }
    let rest =
        adam_blocks(context, &mut values[..whole], &mut mean[..whole], &mut square[..whole], &grad[..whole], &size);
    nonfinite + rest
}
