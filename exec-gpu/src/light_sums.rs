//! Sums of a light's gradient, which many invocations add to at once.
//!
//! Floating-point sums depend on their order, and atomic ones do not exist everywhere. So each number is rounded to
//! whole steps of 2⁻⁵² and added as an integer of 96 bits: numbers down to the gradients of a mean over millions of
//! pixels keep their digits, and 2²⁴ of the largest that is taken, 2¹⁸, still fit; what is larger counts as that. A
//! number that is not finite makes the sum of its colour not finite.

use crate::{
    device::GpuError,
    executor::GpuExecutor,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    prefilter::{Light, LightGrad, TEXEL_LEN},
    source,
};

/// Words of a sum: three digits, then how many numbers were none.
pub(crate) const SUM_WORDS: usize = 4;
/// The word that counts those.
pub(crate) const SUM_FAULTS: usize = 3;
/// Steps of the middle word in 1; those of the word before it are finer by 2³².
pub(crate) const MIDDLE_STEPS: f32 = (1 << 20) as f32;
/// The largest number that is added.
pub(crate) const NUMBER_MAX: f32 = (1 << 18) as f32;

/// Sums for every texel of a light.
#[derive(Debug)]
pub(crate) struct LightSums {
    sums: Array,
    texel_count: usize,
}

impl LightSums {
    /// Zeros for this light.
    pub(crate) fn new(machine: &mut Machine, light: &Light) -> Result<Self, GpuError> {
        Self::zeros(machine, light.layout.texel_count())
    }

    fn zeros(machine: &mut Machine, texel_count: usize) -> Result<Self, GpuError> {
        Ok(Self { sums: machine.zeros("sums of a light's gradient", 3 * SUM_WORDS * texel_count)?, texel_count })
    }

    /// What kernels bind as `light_sums`.
    pub(crate) fn array(&self) -> &Array {
        &self.sums
    }

    /// The sums as numbers.
    pub(crate) fn finish(self, machine: &mut Machine) -> Result<LightGrad, GpuError> {
        let Self { sums, texel_count } = self;
        let texels = machine.take("gradient of a light", TEXEL_LEN * texel_count)?;
        let source = || source::light_grad(texel_count);
        let key = format!("{texel_count} texels");
        machine.run(&key, "finish_sums", &source, &[Of(&sums), Of(&texels)], Groups::For(texel_count))?;
        Ok(LightGrad { texels })
    }
}

impl GpuExecutor {
    /// Colours added to texels as the gradient of a light is, for whoever wants to know whether their sums are right;
    /// the fourth number of a colour is left out.
    pub fn add_colors(
        &mut self,
        texel_count: usize,
        places: &[u32],
        colors: &[[f32; 4]],
    ) -> Result<LightGrad, GpuError> {
        let machine = &mut self.machine;
        let sums = LightSums::zeros(machine, texel_count)?;
        let (places, added) = (machine.upload("places", places)?, machine.upload("colours", colors)?);
        let settings = [colors.len() as u32];
        let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(&places), Of(&added), Of(sums.array())];
        let source = || source::add_colors(texel_count);
        machine.run(&format!("{texel_count} texels"), "add_colors", &source, &bound, Groups::For(colors.len()))?;
        sums.finish(machine)
    }
}
