//! Gradient of compositing: splats are replayed over the pixels of an invocation.

use crate::{
    codegen::formula::{Field, call, formula, variable},
    stages::blend::formulas::{PixelBlock, channel_fields, color_fields},
};
use specula_core::{
    blend::{OffsetMoments, Replay, falloff, moments_vjp, step_vjp},
    real::Real,
    splat::Splat2d,
};

/// Numbers of a splat's gradient before those of its channels: mean2d (2), root of the conic (3),
/// opacity (1).
pub const GEOMETRY: usize = 6;
/// Moments of a splat over its pixels: the first numbers of a slot, before the gradients of the
/// channels.
pub const MOMENTS: usize = 6;

/// Gradients of the channels in each pixel of an invocation, constant while splats are replayed.
fn pixel_grad_fields(block: PixelBlock, channels: usize) -> impl Iterator<Item = Field> {
    let first = move |pixel: usize| pixel * channels.div_ceil(4);
    (0..block.count()).flat_map(move |pixel| channel_fields("pixel_grads", first(pixel), channels))
}

/// State of the pixels while splats are replayed ([`Replay`]), in variables of the shader.
fn state_fields(block: PixelBlock) -> [Field; 2] {
    ["transmittance", "remaining"].map(|name| variable(name, block.count()))
}

/// Initial state of the pixels: [`Replay::remaining`] starts with Σ g · C + g_T · T.
#[derive(Clone, Copy, Debug)]
pub struct ReplayStart {
    /// Pixels of the invocation.
    pub block: PixelBlock,
    /// Number of blended channels.
    pub channels: usize,
}

impl ReplayStart {
    /// Numbers of all pixels: channels and transmittance.
    const fn len(&self) -> usize {
        self.block.count() * (self.channels + 1)
    }
}

formula!(ReplayStart, |this, inputs| replay_start(..[
    call("initial_transmittance", this.block.count()), call("blended", this.len()), call("grad_of_blended", this.len())
]) -> (
    ..state_fields(this.block), ..pixel_grad_fields(this.block, this.channels)
) {
    let planes = this.channels + 1;
    let transmittances = inputs.slice(this.block.count()).to_vec();
    let (blended, grads) = (inputs.slice(this.len()), inputs.slice(this.len()));
    let product = |k: usize| blended[k] * grads[k];
    let numbers_of_pixel = |pixel: usize| (pixel * planes..(pixel + 1) * planes).rev();
    let remaining = |pixel: usize| numbers_of_pixel(pixel).map(product).reduce(|sum, x| sum + x).expect("there is T");
    let remaining: Vec<R> = (0..this.block.count()).map(remaining).collect();
    let pixel_grads: Vec<R> = grads.chunks(planes).flat_map(|grads| &grads[..this.channels]).copied().collect();
    (transmittances, remaining, pixel_grads)
});

/// State of the pixels in front of a segment.
#[derive(Clone, Copy, Debug)]
pub struct ReplayResume {
    /// Pixels of the invocation.
    pub block: PixelBlock,
}

formula!(ReplayResume, |this, inputs| replay_resume(
    ..[call("transmittance_in_front", this.block.count()), call("remaining_in_front", this.block.count())]
) -> (..state_fields(this.block)) {
    let count = this.block.count();
    (inputs.slice(count).to_vec(), inputs.slice(count).to_vec())
});

/// Gradients of the channels in each pixel of an invocation.
#[derive(Clone, Copy, Debug)]
pub struct PixelGrads {
    /// Pixels of the invocation.
    pub block: PixelBlock,
    /// Number of blended channels.
    pub channels: usize,
}

formula!(PixelGrads, |this, inputs| read_pixel_grads(
    ..[call("grad_of_blended", this.block.count() * (this.channels + 1))]
) -> (..pixel_grad_fields(this.block, this.channels)) {
    let planes = this.channels + 1;
    let grads = inputs.slice(this.block.count() * planes);
    grads.chunks(planes).flat_map(|grads| &grads[..this.channels]).copied().collect::<Vec<R>>()
});

/// Product of a splat's channels and a pixel's gradients.
fn dot<R: Real>(color: &[R], grads: &[R], zero: R) -> R {
    color.iter().zip(grads).fold(zero, |sum, (color, grad)| color.mul_add(*grad, sum))
}

/// State of a pixel behind one splat, without sums.
#[derive(Clone, Copy, Debug)]
pub struct ReplayState {
    /// Number of blended channels.
    pub channels: usize,
}

impl ReplayState {
    /// The pixel.
    pub(crate) const BLOCK: PixelBlock = PixelBlock { width: 1, height: 1 };
}

formula!(ReplayState, |this, inputs| replay_state(
    root: 3, log2_opacity: 1, delta: 2,
    ..state_fields(ReplayState::BLOCK),
    ..color_fields(this.channels),
    ..pixel_grad_fields(ReplayState::BLOCK, this.channels)
) -> (..state_fields(ReplayState::BLOCK)) {
    let (root, log2_opacity, [dx, dy]) = (inputs.array(), inputs.number(), inputs.array());
    let splat = Splat2d { mean2d: [dx.zero(); 2], root, log2_opacity };
    let replay = Replay { transmittance: inputs.number(), remaining: inputs.number() };
    let along = dot(inputs.slice(this.channels), inputs.slice(this.channels), dx.zero());
    let behind = step_vjp(falloff(&splat, dx, dy).log2_strength, replay, along).behind;
    ([behind.transmittance], [behind.remaining])
});

/// Replay of one splat over the pixels of an invocation, and the sums over them
/// ([`specula_core::blend::step_vjp`]). The weight of the splat shows whether it contributed to any
/// pixel, the sum of transmittances whether all pixels have terminated.
#[derive(Clone, Copy, Debug)]
pub struct ReplaySplat {
    /// Pixels of the invocation.
    pub block: PixelBlock,
    /// Number of blended channels.
    pub channels: usize,
}

formula!(ReplaySplat, |this, inputs| replay_splat(
    root: 3, log2_opacity: 1, delta: 2,
    ..state_fields(this.block),
    ..color_fields(this.channels),
    ..pixel_grad_fields(this.block, this.channels)
) -> (
    ..state_fields(this.block), ..[call("store_sum", MOMENTS + this.channels)], weight: 1, transmittance_sum: 1
) {
    let (root, log2_opacity, [dx, dy]) = (inputs.array(), inputs.number(), inputs.array());
    let splat = Splat2d { mean2d: [dx.zero(); 2], root, log2_opacity };
    let count = this.block.count();
    let mut transmittances = inputs.slice(count).to_vec();
    let mut remainders = inputs.slice(count).to_vec();
    let color = inputs.slice(this.channels);
    let mut moments = OffsetMoments::zero(dx);
    let mut grad_color = vec![dx.zero(); this.channels];
    let mut weight = dx.zero();
    for pixel in 0..count {
        let grads = inputs.slice(this.channels);
        let [column, row] = this.block.position(pixel);
        let falloff = falloff(&splat, dx + column as f32, dy + row as f32);
        let along = dot(color, grads, dx.zero());
        let replay = Replay { transmittance: transmittances[pixel], remaining: remainders[pixel] };
        let step = step_vjp(falloff.log2_strength, replay, along);
        (transmittances[pixel], remainders[pixel]) = (step.behind.transmittance, step.behind.remaining);
        moments = moments.with(step.log_strength, falloff.offset);
        grad_color.iter_mut().zip(grads).for_each(|(sum, grad)| *sum = step.weight.mul_add(*grad, *sum));
        weight = weight + step.weight;
    }
    let transmittance_sum = transmittances.iter().fold(dx.zero(), |sum, transmittance| sum + *transmittance);
    let moments = (moments.first, moments.second, [moments.sum]);
    (transmittances, remainders, moments, grad_color, [weight, transmittance_sum])
});

/// Gradient of a splat from its moments ([`specula_core::blend::moments_vjp`]), which it replaces.
#[derive(Clone, Copy, Debug)]
pub struct MomentsVjp;

formula!(MomentsVjp, |_, inputs| moments_vjp(
    root: 3, opacity: 1, ..[call("sum_of", MOMENTS)]
) -> (..[call("store_sum", MOMENTS)]) {
    let (root, opacity) = (inputs.array(), inputs.number());
    let splat = Splat2d { mean2d: [opacity.zero(); 2], root, log2_opacity: opacity.zero() };
    let moments = OffsetMoments { first: inputs.array(), second: inputs.array(), sum: inputs.number() };
    let grad = moments_vjp(&splat, opacity, &moments);
    (grad.mean2d, grad.root_conic, [grad.opacity])
});
