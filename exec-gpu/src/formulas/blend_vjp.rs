//! The way back through blending.

use super::blend::{PixelBlock, channel_fields};
use crate::formula::{Field, Formula, Inputs, call, field, variable};
use specula_core::{
    blend::{OffsetMoments, Replay, falloff, moments_vjp, step_vjp},
    real::Real,
    splat::Splat2d,
};

/// Numbers that the pixels of a splat are summed up in, before those of its channels: its moments.
pub const MOMENTS: usize = 6;

/// The gradients of the channels in each pixel of an invocation, which stay where they are while splats are replayed.
fn pixel_grad_fields(block: PixelBlock, channels: usize) -> impl Iterator<Item = Field> {
    let first = move |pixel: usize| format!("{}u", pixel * channels.div_ceil(4));
    (0..block.count()).flat_map(move |pixel| channel_fields("pixel_grads", &first(pixel), channels))
}

/// What pixels know while their splats are replayed ([`Replay`]).
fn states(block: PixelBlock) -> [Field; 2] {
    ["transmittance", "remaining"].map(|name| variable(name, block.count()))
}

/// Pixels before their first splat: Σ g · C + g_T · T is what [`Replay::remaining`] starts with.
#[derive(Clone, Copy, Debug)]
pub struct ReplayStart {
    /// The pixels.
    pub block: PixelBlock,
    /// What was blended.
    pub channels: usize,
}

impl Formula for ReplayStart {
    fn name(&self) -> String {
        "replay_start".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let len = self.block.count() * (self.channels + 1);
        vec![call("light_at_start", self.block.count()), call("blended", len), call("grad_of_blended", len)]
    }
    fn results(&self) -> Vec<Field> {
        let mut fields = states(self.block).to_vec();
        fields.extend(pixel_grad_fields(self.block, self.channels));
        fields
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = self.channels + 1;
        let len = self.block.count() * planes;
        let mut numbers = inputs.slice(self.block.count()).to_vec();
        let (blended, grads) = (inputs.slice(len), inputs.slice(len));
        let product = |k: usize| blended[k] * grads[k];
        let of_pixel = |pixel: usize| (pixel * planes..(pixel + 1) * planes).rev();
        let remaining = |pixel: usize| of_pixel(pixel).map(product).reduce(|sum, x| sum + x).expect("there is T");
        numbers.extend((0..self.block.count()).map(remaining));
        numbers.extend(grads.chunks(planes).flat_map(|grads| &grads[..self.channels]));
        numbers
    }
}

/// One splat over the pixels of an invocation, and the sums over them ([`specula_core::blend::step_vjp`]). The weight of
/// the splat tells whether any pixel saw it, the light that is left whether all have ended.
#[derive(Clone, Copy, Debug)]
pub struct ReplaySplat {
    /// The pixels.
    pub block: PixelBlock,
    /// What was blended.
    pub channels: usize,
}

impl Formula for ReplaySplat {
    fn name(&self) -> String {
        "replay_splat".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = vec![field("root", 3), field("log2_opacity", 1), field("delta", 2)];
        fields.extend(states(self.block));
        fields.extend(channel_fields("colors", "first_color", self.channels));
        fields.extend(pixel_grad_fields(self.block, self.channels));
        fields
    }
    fn results(&self) -> Vec<Field> {
        let mut fields = states(self.block).to_vec();
        fields.extend([call("put_sum", MOMENTS + self.channels), field("weight", 1), field("light_left", 1)]);
        fields
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (root, log2_opacity, [dx, dy]) = (inputs.array(), inputs.number(), inputs.array());
        let stamp = Splat2d { mean2d: [dx.zero(); 2], root, log2_opacity };
        let count = self.block.count();
        let mut transmittances = inputs.slice(count).to_vec();
        let mut remainders = inputs.slice(count).to_vec();
        let color = inputs.slice(self.channels);
        let mut moments = OffsetMoments::zero(dx);
        let mut grad_color = vec![dx.zero(); self.channels];
        let mut weight = dx.zero();
        for pixel in 0..count {
            let grads = inputs.slice(self.channels);
            let [column, row] = self.block.place(pixel);
            let falloff = falloff(&stamp, dx + column as f32, dy + row as f32);
            let along = color.iter().zip(grads).fold(dx.zero(), |sum, (color, grad)| color.mul_add(*grad, sum));
            let replay = Replay { transmittance: transmittances[pixel], remaining: remainders[pixel] };
            let step = step_vjp(falloff.log2_strength, replay, along);
            (transmittances[pixel], remainders[pixel]) = (step.behind.transmittance, step.behind.remaining);
            moments = moments.with(step.log_strength, falloff.offset);
            grad_color.iter_mut().zip(grads).for_each(|(sum, grad)| *sum = step.weight.mul_add(*grad, *sum));
            weight = weight + step.weight;
        }
        let light_left = transmittances.iter().fold(dx.zero(), |sum, light| sum + *light);
        let mut numbers = [transmittances, remainders].concat();
        numbers.extend(moments.first);
        numbers.extend(moments.second);
        numbers.push(moments.sum);
        numbers.extend(grad_color);
        numbers.extend([weight, light_left]);
        numbers
    }
}

/// A splat's gradient from its moments ([`specula_core::blend::moments_vjp`]), in their place.
#[derive(Clone, Copy, Debug)]
pub struct MomentsVjp;

impl Formula for MomentsVjp {
    fn name(&self) -> String {
        "moments_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("root", 3), field("opacity", 1), call("sum_of", MOMENTS)]
    }
    fn results(&self) -> Vec<Field> {
        vec![call("put_sum", MOMENTS)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (root, opacity) = (inputs.array(), inputs.number());
        let stamp = Splat2d { mean2d: [opacity.zero(); 2], root, log2_opacity: opacity.zero() };
        let moments = OffsetMoments { first: inputs.array(), second: inputs.array(), sum: inputs.number() };
        let grad = moments_vjp(&stamp, opacity, &moments);
        let mut numbers = grad.mean2d.to_vec();
        numbers.extend(grad.root_conic);
        numbers.push(grad.opacity);
        numbers
    }
}
