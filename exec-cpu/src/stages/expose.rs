//! Exposure of pictures, sixteen pixels at a time.

use crate::{
    context::Context,
    frame::{Frame, FrameGrad, QUADS, Quad, RGB, at, tile_len},
    lanes::Lanes,
};
use core::array;
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    expose::{self, Exposure},
    vector::{Vec3, vec3},
};

pub(crate) fn expose(context: &Context, mut frame: Frame, exposure: &Exposure<f32>) -> Frame {
    let mut exposed = context.take::<Quad>(frame.cover.tiles.len() * QUADS * RGB);
    exposed.par_chunks_mut(QUADS * RGB).enumerate().for_each(|(slot, exposed)| {
        dispatch!(context.level, simd => expose_tile(simd, &frame, slot, exposure, exposed));
    });
    frame.exposed = Some(exposed);
    frame
}

/// Gradient of the picture before exposure, and of the exposure: sums over tiles, in their order.
pub(crate) fn expose_vjp(
    context: &Context,
    frame: &Frame,
    exposure: &Exposure<f32>,
    mut grad: FrameGrad,
) -> (FrameGrad, Exposure<f64>) {
    let mut sums = context.take::<[f64; 4]>(RGB * frame.cover.tiles.len());
    let tiles = grad.values.par_chunks_mut(tile_len(frame.channels)).zip(sums.par_chunks_mut(RGB));
    tiles.enumerate().for_each(|(slot, (grad, sums))| {
        dispatch!(context.level, simd => sums.copy_from_slice(&tile_vjp(simd, frame, slot, exposure, grad)));
    });
    let add = |sum: Exposure<f64>, part: &[[f64; 4]]| array::from_fn(|c| array::from_fn(|k| sum[c][k] + part[c][k]));
    let exposure_grad = sums.chunks_exact(RGB).fold([[0.0; 4]; 3], add);
    (grad, exposure_grad)
}

/// The same exposure for every lane.
#[inline(always)]
fn lift<S: Simd>(simd: S, exposure: &Exposure<f32>) -> Exposure<Lanes<S>> {
    let [red, green, blue] = exposure;
    let row = |[r, g, b, offset]: &[f32; 4]| {
        [Lanes::splat(simd, *r), Lanes::splat(simd, *g), Lanes::splat(simd, *b), Lanes::splat(simd, *offset)]
    };
    [row(red), row(green), row(blue)]
}

/// Colour of a quad before exposure, and its coverage.
#[inline(always)]
fn color_and_coverage<S: Simd>(simd: S, frame: &Frame, slot: usize, quad: usize) -> (Vec3<Lanes<S>>, Lanes<S>) {
    let channel = |c: usize| Lanes::load(simd, frame.color_before_exposure(slot, quad, c));
    let passed = Lanes::load(simd, &frame.tile(slot)[at(frame.channels, quad, frame.channels)]);
    (vec3(channel(0), channel(1), channel(2)), -passed + 1.0)
}

#[inline(always)]
fn expose_tile<S: Simd>(simd: S, frame: &Frame, slot: usize, exposure: &Exposure<f32>, exposed: &mut [Quad]) {
    let exposure = lift(simd, exposure);
    for quad in 0..QUADS {
        let (color, coverage) = color_and_coverage(simd, frame, slot, quad);
        let shown = expose::expose(&exposure, color, coverage);
        let out = &mut exposed[quad * RGB..(quad + 1) * RGB];
        shown.x.store(&mut out[0]);
        shown.y.store(&mut out[1]);
        shown.z.store(&mut out[2]);
    }
}

/// Converts the gradient of a tile of the photograph to that of the picture; returns that of the
/// exposure.
#[inline(always)]
fn tile_vjp<S: Simd>(
    simd: S,
    frame: &Frame,
    slot: usize,
    exposure: &Exposure<f32>,
    grad: &mut [Quad],
) -> Exposure<f64> {
    let channels = frame.channels;
    let exposure = lift(simd, exposure);
    let mut sums = lift(simd, &[[0.0; 4]; 3]);
    for quad in 0..QUADS {
        let (color, coverage) = color_and_coverage(simd, frame, slot, quad);
        let channel = |c: usize| Lanes::load(simd, &grad[at(channels, quad, c)]);
        let (grad_photograph, grad_passed) = (vec3(channel(0), channel(1), channel(2)), channel(channels));
        let (grad_exposure, grad_color, grad_coverage) =
            expose::expose_vjp(&exposure, color, coverage, grad_photograph);
        for (sum, grad) in sums.as_flattened_mut().iter_mut().zip(grad_exposure.as_flattened()) {
            *sum = *sum + *grad;
        }
        grad_color.x.store(&mut grad[at(channels, quad, 0)]);
        grad_color.y.store(&mut grad[at(channels, quad, 1)]);
        grad_color.z.store(&mut grad[at(channels, quad, 2)]);
        (grad_passed - grad_coverage).store(&mut grad[at(channels, quad, channels)]);
    }
    sums.map(|row| row.map(|sum| f64::from(sum.sum())))
}
