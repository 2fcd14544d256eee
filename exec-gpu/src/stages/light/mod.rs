//! Filtered lights in kernels: their layout, lookup, and the gradients of their texels.

use crate::{
    codegen::{source::Source, trace::literal},
    device::memory::Array,
};
use formulas::{DirectionVjp, LevelOf, RoughnessVjp, SplitSumVjp, TexelShares, TexelsAt, TexelsMean, TexelsVjp};
use specula_core::{
    light_view::TexelMap,
    pack::{Storage, pack2, unpack2},
    split_sum::RESOLUTION,
};
use specula_prefilter::Operator;

pub mod formulas;
pub(crate) mod matrix;
pub(crate) mod sums;

/// Numbers of a texel: red, green, blue and padding.
pub(crate) const TEXEL_LEN: usize = 4;

/// Words of a texel of a filtered light.
pub(crate) fn texel_words(storage: Storage) -> usize {
    match storage {
        Storage::F32 => TEXEL_LEN,
        Storage::F16 => TEXEL_LEN / 2,
    }
}

/// Gradient of a filtered light, texel by texel.
#[derive(Debug)]
pub struct LightGrad {
    /// In the layout of the light's texels, in `f32`.
    pub(crate) texels: Array,
}

/// Layout of the levels of a light.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LightLayout {
    /// Roughness of each level.
    pub(crate) levels: LevelOf,
    /// Map of each level, and of the irradiance behind them. Without one, the last level holds the
    /// irradiance.
    pub(crate) maps: Vec<TexelMap>,
    /// Storage format of the texels.
    pub(crate) storage: Storage,
}

impl LightLayout {
    /// Levels of an operator in a storage format.
    pub(crate) fn of(operator: &Operator, storage: Storage) -> Self {
        Self { levels: LevelOf { levels: operator.levels().to_vec() }, maps: operator.maps().to_vec(), storage }
    }

    /// Appends the lookup of the light.
    pub(crate) fn lookup(&self, source: Source) -> Source {
        let table = |name: &str, numbers: &mut dyn Iterator<Item = usize>| {
            let numbers: Vec<String> = numbers.map(|number| format!("{number}u")).collect();
            format!(
                "fn {name}(level: u32) -> u32 {{\n    var table = array({});\n    return table[level];\n}}\n",
                numbers.join(", ")
            )
        };
        source
            .count("LEVELS", self.levels.levels.len())
            .count("IRRADIANCE_LEVEL", self.maps.len() - 1)
            .part(|source| texels(source, self.storage))
            .formula(&self.levels)
            .formula(&TexelsAt)
            .with(&table("level_start", &mut self.maps.iter().map(|map| map.first)))
            .with(&table("level_resolution", &mut self.maps.iter().map(|map| map.resolution)))
            .with(include_str!("light.wgsl"))
    }

    /// Appends the lookup of the light, and its gradient.
    pub(crate) fn lookup_vjp(&self, source: Source) -> Source {
        self.lookup(source)
            .formula(&TexelShares)
            .formula(&TexelsMean)
            .formula(&TexelsVjp)
            .formula(&DirectionVjp)
            .formula(&RoughnessVjp { levels: self.levels.levels.clone() })
            .part(|source| sums::light_sums(source, self.texel_count()))
            .with(include_str!("light_sums.wgsl"))
            .with(include_str!("light_vjp.wgsl"))
    }

    /// Texels of all levels and of the irradiance map.
    pub(crate) fn texel_count(&self) -> usize {
        self.maps.last().map_or(0, |map| map.end())
    }
}

/// Appends the lookup of the split-sum table at this binding.
pub(crate) fn split_sums(source: Source, binding: usize) -> Source {
    source
        .count("SPLIT_SUM_SIZE", RESOLUTION)
        .with(&format!("@group(0) @binding({binding}) var<storage, read> split_sums: array<vec2f>;\n"))
        .with(include_str!("split_sum.wgsl"))
}

/// Appends the gradient of the lookup of the split-sum table.
pub(crate) fn split_sums_vjp(source: Source) -> Source {
    source.formula(&SplitSumVjp).with(include_str!("split_sum_vjp.wgsl"))
}

/// Appends the storage format of a light's texels.
pub(crate) fn texels(source: Source, storage: Storage) -> Source {
    match storage {
        Storage::F32 => source.with(include_str!("texels.wgsl")),
        Storage::F16 => source.part(halves).with(include_str!("half_texels.wgsl")),
    }
}

/// Appends the constants that `half_texels.wgsl` converts `f32` to halves with.
fn halves(source: Source) -> Source {
    const HALF_MIN: f32 = 1.0 / 16_384.0;
    let half = |number: f32| pack2(number, 0.0) as usize;
    source
        .count("HALF_SIGN", half(-0.0))
        .count("HALF_INFINITY", half(f32::INFINITY))
        .count("HALF_NOT_A_NUMBER", half(f32::NAN))
        .count("F32_SIGN", (-0.0_f32).to_bits() as usize)
        .count("F32_INFINITY", f32::INFINITY.to_bits() as usize)
        .count("F32_OF_HALF_MAX", unpack2(pack2(f32::MAX, 0.0))[0].to_bits() as usize)
        .count("F32_OF_HALF_MIN", HALF_MIN.to_bits() as usize)
        .count("F32_OF_HALF_BIAS", (HALF_MIN / 2.0).to_bits() as usize)
        .count("DROPPED_BITS", 23 - 10)
        .with(&format!("const SMALLEST_HALVES: f32 = {};", literal(1.0 / unpack2(1)[0])))
}
