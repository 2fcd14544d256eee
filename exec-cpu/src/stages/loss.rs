//! Losses of a picture against its target, and their gradients: colour, structure, normals
//! and their smoothness, coverage.

mod comparison;
mod normals;
mod pixels;
mod smoothness;
mod structure;

use crate::{
    context::Context,
    frame::{Frame, FrameGrad, Quad, tile_len},
};
pub use comparison::Target;
use comparison::{Comparison, distances};
use normals::normal_loss;
use smoothness::smoothness_loss;
use specula_core::{
    camera::Camera,
    loss::{LossReport, LossWeights},
    rules::{Channels, channel},
};
use structure::structure_loss;

pub(crate) fn loss_all(
    context: &Context,
    frame: &Frame,
    target: &Target,
    camera: &Camera,
    weights: &LossWeights,
    background: [f32; 3],
) -> (LossReport, FrameGrad) {
    let has_geometry = Channels::of_count(frame.channels).contain(channel::DEPTH);
    let weights = weights.where_possible(target.has_alpha, has_geometry);
    let distance = distances(context, frame, target);
    let white = weights.white(target.is_clipped());
    let comparison = Comparison { context, frame, target, camera, weights, white, background, distance };
    let mut grad = context.take::<Quad>(frame.cover.tiles.len() * tile_len(frame.channels));
    let (mut report, planes) = comparison.pixel_losses(&mut grad);
    if weights.dssim != 0.0 {
        report.ssim = structure_loss(&comparison, &planes, &mut grad);
    }
    comparison.background_vjp(&mut grad);
    if weights.normal != 0.0 {
        report.normal = normal_loss(&comparison, &planes, &mut grad);
    }
    if weights.smoothness != 0.0 {
        report.smoothness = smoothness_loss(&comparison, &planes, &mut grad);
    }
    (report.with_total(&weights), FrameGrad { channels: frame.channels, values: grad })
}
