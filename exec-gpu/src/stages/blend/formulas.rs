//! Compositing of splats over the pixels of an invocation.

use crate::codegen::formula::{Field, call, formula, variable};
use specula_core::{
    blend::{PixelState, alpha, falloff, step},
    occlusion::is_hidden,
    splat::Splat2d,
};

/// Pixels of one invocation: a small rectangle of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelBlock {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl PixelBlock {
    /// Number of pixels.
    pub const fn count(self) -> usize {
        self.width * self.height
    }
    /// Column and row of a pixel.
    pub(crate) const fn position(self, pixel: usize) -> [usize; 2] {
        [pixel % self.width, pixel / self.width]
    }
}

/// One number of each channel, in vectors of four of the variable `array`, from index `first` on.
pub(crate) fn channel_fields(array: &str, first: usize, channels: usize) -> Vec<Field> {
    let name = |c: usize| format!("{array}[{}].{}", first + c / 4, ["x", "y", "z", "w"][c % 4]);
    (0..channels).map(|c| variable(&name(c), 1)).collect()
}

/// Channels of the splat, in the variable `color` of the shader.
pub(crate) fn color_fields(channels: usize) -> Vec<Field> {
    channel_fields("color", 0, channels)
}

/// State of the pixels ([`PixelState`]) in variables of the shader.
fn state_fields(block: PixelBlock) -> [Field; 2] {
    ["transmittance", "final_transmittance"].map(|name| variable(name, block.count()))
}

/// Initial state of the pixels ([`PixelState::open`]); pixels outside the image have terminated.
#[derive(Clone, Copy, Debug)]
pub struct BlendStart {
    /// Pixels of the invocation.
    pub block: PixelBlock,
}

formula!(BlendStart, |this, inputs| blend_start(
    ..[call("initial_transmittance", this.block.count())]
) -> (..state_fields(this.block)) {
    let initial = inputs.slice(this.block.count());
    let last: Vec<R> = initial.iter().map(|t| PixelState::open(*t).final_transmittance).collect();
    (initial.to_vec(), last)
});

/// Transmittance behind the last splat, pixel by pixel.
#[derive(Clone, Copy, Debug)]
pub struct BlendEnd {
    /// Pixels of the invocation.
    pub block: PixelBlock,
}

formula!(BlendEnd, |this, inputs| blend_end(
    ..[variable("final_transmittance", this.block.count())]
) -> (..[call("store_pixel", this.block.count())]) {
    inputs.slice(this.block.count()).to_vec()
});

/// Depths of the surfaces of another renderer in the pixels, in the shader's variable `surfaces`.
#[derive(Clone, Copy, Debug)]
pub struct ReadSurfaces {
    /// Pixels of the invocation.
    pub block: PixelBlock,
}

formula!(ReadSurfaces, |this, inputs| read_surfaces(
    ..[call("surface_at", this.block.count())]
) -> (..[variable("surfaces", this.block.count())]) {
    inputs.slice(this.block.count()).to_vec()
});

/// End of the pixels from which a surface hides a splat ([`specula_core::occlusion::is_hidden`]),
/// and so all later ones.
#[derive(Clone, Copy, Debug)]
pub struct EndPixels {
    /// Pixels of the invocation.
    pub block: PixelBlock,
}

formula!(EndPixels, |this, inputs| end_pixels(
    depth: 1,
    ..[variable("surfaces", this.block.count()), variable("transmittance", this.block.count())]
) -> (..[variable("transmittance", this.block.count())]) {
    let (depth, count) = (inputs.number(), this.block.count());
    let (surfaces, transmittances) = (inputs.slice(count), inputs.slice(count));
    let ended = |(surface, transmittance): (&R, &R)| R::select(is_hidden(depth, *surface), depth.zero(), *transmittance);
    surfaces.iter().zip(transmittances).map(ended).collect::<Vec<R>>()
});

/// Compositing of one splat over the pixels of an invocation ([`specula_core::blend::step`]): their
/// state, and the sums of their channels. The largest transmittance shows whether all pixels have
/// terminated.
#[derive(Clone, Copy, Debug)]
pub struct BlendSplat {
    /// Pixels of the invocation.
    pub block: PixelBlock,
    /// Number of blended channels.
    pub channels: usize,
}

impl BlendSplat {
    /// State of all pixels, then the channels of one pixel after the other.
    pub(crate) fn accumulators(&self) -> Vec<Field> {
        let first = |pixel: usize| pixel * self.channels.div_ceil(4);
        let sums = (0..self.block.count()).flat_map(|pixel| channel_fields("sums", first(pixel), self.channels));
        state_fields(self.block).into_iter().chain(sums).collect()
    }
}

formula!(BlendSplat, |this, inputs| blend_splat(
    root: 3, log2_opacity: 1, delta: 2,
    ..color_fields(this.channels),
    ..this.accumulators()
) -> (..this.accumulators(), largest_transmittance: 1) {
    let (root, log2_opacity, [dx, dy]) = (inputs.array(), inputs.number(), inputs.array());
    let splat = Splat2d { mean2d: [dx.zero(); 2], root, log2_opacity };
    let color = inputs.slice(this.channels);
    let count = this.block.count();
    let (transmittances, last) = (inputs.slice(count), inputs.slice(count));
    let mut states = Vec::new();
    let mut sums = Vec::new();
    for pixel in 0..count {
        let [column, row] = this.block.position(pixel);
        let falloff = falloff(&splat, dx + column as f32, dy + row as f32);
        let front = PixelState { transmittance: transmittances[pixel], final_transmittance: last[pixel] };
        let step = step(alpha(falloff.log2_strength), front);
        states.push(step.behind);
        let before = inputs.slice(this.channels);
        sums.extend(color.iter().zip(before).map(|(color, sum)| step.weight.mul_add(*color, *sum)));
    }
    let largest_transmittance = states.iter().fold(dx.zero(), |most, state| most.max(state.transmittance));
    let transmittances: Vec<R> = states.iter().map(|state| state.transmittance).collect();
    let last: Vec<R> = states.iter().map(|state| state.final_transmittance).collect();
    (transmittances, last, sums, [largest_transmittance])
});
