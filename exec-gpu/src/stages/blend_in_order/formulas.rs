//! Alpha and depth of a splat in a pixel, and its compositing in its turn.

use crate::{
    codegen::formula::formula,
    stages::blend::formulas::{BlendSplat, PixelBlock, color_fields},
};
use specula_core::{
    blend::{PixelState, alpha, falloff, step},
    occlusion::is_hidden,
    order::ResponseDepth,
    splat::Splat2d,
};

/// Pixels of an invocation: each has its own order.
pub(crate) const PIXEL: PixelBlock = PixelBlock { width: 1, height: 1 };

/// Alpha of a splat in a pixel ([`specula_core::blend::alpha`]); zero if it fails the alpha test.
#[derive(Clone, Copy, Debug)]
pub struct AlphaOf;

formula!(AlphaOf, |_, inputs| alpha_of(root: 3, log2_opacity: 1, delta: 2) -> (alpha: 1) {
    let (root, log2_opacity, [dx, dy]) = (inputs.array(), inputs.number(), inputs.array());
    let splat = Splat2d { mean2d: [dx.zero(); 2], root, log2_opacity };
    [alpha(falloff(&splat, dx, dy).log2_strength)]
});

/// Depth of a splat's largest response in a pixel ([`specula_core::order::ResponseDepth::at`]).
#[derive(Clone, Copy, Debug)]
pub struct DepthAt;

formula!(DepthAt, |_, inputs| depth_at(slope: 2, root: 3, mean_depth: 1, delta: 2) -> (depth: 1) {
    let (slope, root, depth, delta) = (inputs.array(), inputs.array(), inputs.number(), inputs.array());
    [ResponseDepth { mean2d: [depth.zero(); 2], slope, root, depth }.at(delta)]
});

/// Whether a surface hides a splat ([`specula_core::occlusion::is_hidden`]).
#[derive(Clone, Copy, Debug)]
pub struct IsHidden;

formula!(IsHidden, |_, inputs| hidden_by(depth: 1, surface: 1) -> (hidden: 1) {
    let [depth, surface] = inputs.array();
    [depth.constant(1.0).keep(is_hidden(depth, surface))]
});

/// Compositing of one splat over a pixel ([`specula_core::blend::step`]), given its alpha.
#[derive(Clone, Copy, Debug)]
pub struct BlendAlpha {
    /// Number of blended channels.
    pub channels: usize,
}

impl BlendAlpha {
    fn pixel(&self) -> BlendSplat {
        BlendSplat { block: PIXEL, channels: self.channels }
    }
}

formula!(BlendAlpha, |this, inputs| blend_alpha(
    alpha: 1,
    ..color_fields(this.channels),
    ..this.pixel().accumulators()
) -> (..this.pixel().accumulators()) {
    let alpha = inputs.number();
    let color = inputs.slice(this.channels);
    let front = PixelState { transmittance: inputs.number(), final_transmittance: inputs.number() };
    let step = step(alpha, front);
    let before = inputs.slice(this.channels);
    let sums: Vec<R> = color.iter().zip(before).map(|(color, sum)| step.weight.mul_add(*color, *sum)).collect();
    ([step.behind.transmittance, step.behind.final_transmittance], sums)
});
