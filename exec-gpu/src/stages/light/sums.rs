//! Sums of a light's gradient, to which many invocations add concurrently.
//!
//! Floating-point sums depend on their order, and float atomics are not universal. So each number
//! is rounded to whole steps of 2⁻⁵² and added as a 96-bit integer: numbers as small as gradients
//! of a mean over millions of pixels keep their digits, and 2²⁴ numbers of the largest magnitude,
//! 2¹⁸, fit; larger numbers are clamped to it. A non-finite number makes the sum of its colour
//! non-finite.

use crate::{
    codegen::{source::Source, trace::literal},
    device::{
        context::Context,
        error::GpuError,
        kernels::{Binding::Buffer, Dispatch},
        memory::Array,
    },
    stages::light::{LightGrad, LightLayout, TEXEL_LEN},
};

/// Words of a sum: three digits, then the count of non-finite numbers.
const SUM_WORDS: usize = 4;
/// Index of the word that counts non-finite numbers.
const SUM_FAULTS: usize = 3;
/// Steps of the middle word per unit; those of the previous word are finer by 2³².
const MIDDLE_STEPS: f32 = (1 << 20) as f32;
/// Largest magnitude of an addend.
const NUMBER_MAX: f32 = (1 << 18) as f32;
/// Values of a word.
const WORD: f32 = 4_294_967_296.0;

/// Appends the number format of the sums.
pub(crate) fn light_sums(source: Source, texel_count: usize) -> Source {
    source
        .with(&format!("const MIDDLE_STEPS: f32 = {};", literal(MIDDLE_STEPS)))
        .with(&format!("const NUMBER_MAX: f32 = {};", literal(NUMBER_MAX)))
        .with(&format!("const MIDDLE_STEP: f32 = {};", literal(1.0 / MIDDLE_STEPS)))
        .with(&format!("const WORD: f32 = {};", literal(WORD)))
        .with(&format!("const PER_WORD: f32 = {};\n", literal(1.0 / WORD)))
        .count("EXPONENT_BITS", f32::INFINITY.to_bits() as usize)
        .count("NOT_A_NUMBER", f32::NAN.to_bits() as usize)
        .count("SIGN_BIT", 1 << 31)
        .count("SUM_WORDS", SUM_WORDS)
        .count("SUM_FAULTS", SUM_FAULTS)
        .count("LIGHT_TEXELS", texel_count)
}

pub(crate) fn source(texel_count: usize) -> String {
    Source::new().part(|source| light_sums(source, texel_count)).with(include_str!("light_grad.wgsl")).text()
}

/// Sums for every texel of a light.
#[derive(Debug)]
pub(crate) struct LightSums {
    sums: Array,
    texel_count: usize,
}

impl LightSums {
    /// Allocates sums of a light's texels, all zero.
    ///
    /// # Errors
    ///
    /// See [`Context::allocate`].
    pub(crate) fn new(context: &mut Context, layout: &LightLayout) -> Result<Self, GpuError> {
        Self::zeros(context, layout.texel_count())
    }

    /// Allocates sums of `texel_count` texels, all zero.
    ///
    /// # Errors
    ///
    /// See [`Context::allocate`].
    pub(crate) fn zeros(context: &mut Context, texel_count: usize) -> Result<Self, GpuError> {
        Ok(Self { sums: context.zeros("sums of a light's gradient", 3 * SUM_WORDS * texel_count)?, texel_count })
    }

    /// Array that kernels bind as `light_sums`.
    pub(crate) fn array(&self) -> &Array {
        &self.sums
    }

    /// Converts the sums to numbers.
    ///
    /// # Errors
    ///
    /// See [`Context::allocate`] and [`Context::dispatch`].
    pub(crate) fn finish(self, context: &mut Context) -> Result<LightGrad, GpuError> {
        let Self { sums, texel_count } = self;
        let texels = context.allocate("gradient of a light", TEXEL_LEN * texel_count)?;
        let source = || source(texel_count);
        let key = format!("{texel_count} texels");
        context.dispatch(
            &key,
            "finish_sums",
            &source,
            &[Buffer(&sums), Buffer(&texels)],
            Dispatch::Invocations(texel_count),
        )?;
        Ok(LightGrad { texels })
    }
}
