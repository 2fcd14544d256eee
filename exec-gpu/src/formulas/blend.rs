//! Splats over pixels.

use crate::formula::{Field, Formula, Inputs, call, field, variable};
use specula_core::{
    blend::{PixelState, alpha, falloff, step},
    real::Real,
    splat::Splat2d,
};

/// The pixels of one invocation: a small rectangle of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelBlock {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl PixelBlock {
    /// How many there are.
    pub const fn count(self) -> usize {
        self.width * self.height
    }
    /// Column and row of a pixel.
    pub(super) const fn place(self, pixel: usize) -> [usize; 2] {
        [pixel % self.width, pixel / self.width]
    }
}

/// A number of each channel, in vectors of four that are named `array` and begin at `first`.
pub(super) fn channel_fields(array: &str, first: &str, channels: usize) -> impl Iterator<Item = Field> + use<> {
    let name = |c: usize| format!("{array}[{first} + {}u].{}", c / 4, ["x", "y", "z", "w"][c % 4]);
    (0..channels).map(|c| variable(&name(c), 1)).collect::<Vec<_>>().into_iter()
}

/// Pixels before their first splat ([`PixelState::open`]); those outside the picture have ended.
#[derive(Clone, Copy, Debug)]
pub struct BlendStart {
    /// The pixels.
    pub block: PixelBlock,
}

impl Formula for BlendStart {
    fn name(&self) -> String {
        "blend_start".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![call("light_at_start", self.block.count())]
    }
    fn results(&self) -> Vec<Field> {
        passages(self.block).to_vec()
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let light = inputs.slice(self.block.count());
        let left = light.iter().map(|light| PixelState::open(*light).left);
        light.iter().copied().chain(left).collect()
    }
}

/// What pixels let through ([`PixelState`]).
fn passages(block: PixelBlock) -> [Field; 2] {
    ["transmittance", "left"].map(|name| variable(name, block.count()))
}

/// What is left of the light behind the last splat, pixel by pixel.
#[derive(Clone, Copy, Debug)]
pub struct BlendEnd {
    /// The pixels.
    pub block: PixelBlock,
}

impl Formula for BlendEnd {
    fn name(&self) -> String {
        "blend_end".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![variable("left", self.block.count())]
    }
    fn results(&self) -> Vec<Field> {
        vec![call("put_pixel", self.block.count())]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        inputs.slice(self.block.count()).to_vec()
    }
}

/// One splat over the pixels of an invocation ([`specula_core::blend::step`]): what they let through, and the sums of
/// their channels. The largest transmittance tells whether all have ended.
#[derive(Clone, Copy, Debug)]
pub struct BlendSplat {
    /// The pixels.
    pub block: PixelBlock,
    /// What is blended.
    pub channels: usize,
}

impl BlendSplat {
    /// What is let through, then the channels of one pixel after the other.
    fn states(&self) -> Vec<Field> {
        let first = |pixel: usize| format!("{}u", pixel * self.channels.div_ceil(4));
        let sums = (0..self.block.count()).flat_map(|pixel| channel_fields("sums", &first(pixel), self.channels));
        passages(self.block).into_iter().chain(sums).collect()
    }
}

impl Formula for BlendSplat {
    fn name(&self) -> String {
        "blend_splat".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = vec![field("root", 3), field("log2_opacity", 1), field("delta", 2)];
        fields.extend(channel_fields("colors", "first_color", self.channels));
        fields.extend(self.states());
        fields
    }
    fn results(&self) -> Vec<Field> {
        let mut fields = self.states();
        fields.push(field("light_left", 1));
        fields
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (root, log2_opacity, [dx, dy]) = (inputs.array(), inputs.number(), inputs.array());
        let stamp = Splat2d { mean2d: [dx.zero(); 2], root, log2_opacity };
        let color = inputs.slice(self.channels);
        let count = self.block.count();
        let (transmittances, left) = (inputs.slice(count), inputs.slice(count));
        let mut passages = Vec::new();
        let mut sums = Vec::new();
        for pixel in 0..count {
            let [column, row] = self.block.place(pixel);
            let falloff = falloff(&stamp, dx + column as f32, dy + row as f32);
            let front = PixelState { transmittance: transmittances[pixel], left: left[pixel] };
            let step = step(alpha(falloff.log2_strength), front);
            passages.push(step.behind);
            let before = inputs.slice(self.channels);
            sums.extend(color.iter().zip(before).map(|(color, sum)| step.weight.mul_add(*color, *sum)));
        }
        let light_left = passages.iter().fold(dx.zero(), |most, passage| most.max(passage.transmittance));
        let mut numbers: Vec<R> = passages.iter().map(|passage| passage.transmittance).collect();
        numbers.extend(passages.iter().map(|passage| passage.left));
        numbers.extend(sums);
        numbers.push(light_left);
        numbers
    }
}
