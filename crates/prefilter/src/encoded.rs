//! Directions of a light's texels in the encoding of a light's network
//! ([`specula_core::light_network`]), level by level.

use crate::Operator;
use core::ops::Range;
use rayon::prelude::*;
use specula_core::{
    cubemap::{FACE_COUNT, texel_of_index},
    environment::encoding_of,
    light_network::{ENCODING, attenuations},
    prefilter::{LevelRange, PrefilterScheme},
};
use std::sync::Arc;

/// Texels of all levels without their aprons, in which a network is evaluated: those of the base,
/// then the rows of an operator, which only adds aprons.
#[derive(Debug)]
pub struct EncodedTexels {
    operator: Arc<Operator>,
    kept_levels: LevelRange,
    /// Encodings of the kept texels.
    encodings: Vec<[f32; ENCODING]>,
    kept: Range<usize>,
}

impl EncodedTexels {
    /// Texels of the levels of a base of this resolution, a power of two; those of levels that are
    /// not kept are not encoded.
    pub fn new(resolution: usize, kept_levels: LevelRange) -> Self {
        let operator = Operator::shared(PrefilterScheme::Exact, resolution, LevelRange::NONE);
        let (mut encodings, mut first) = (Vec::new(), 0);
        let mut kept: Option<Range<usize>> = None;
        for (number, level) in operator.levels().iter().enumerate() {
            let count = FACE_COUNT * level.resolution * level.resolution;
            if kept_levels.contains(number) {
                let level_attenuations = attenuations(level.roughness);
                encodings.par_extend((0..count).into_par_iter().map(|index| {
                    let (face, column, row) = texel_of_index(index, level.resolution);
                    encoding_of(face, column, row, level.resolution, &level_attenuations)
                }));
                kept = Some(kept.map_or(first, |kept| kept.start)..first + count);
            }
            first += count;
        }
        Self { operator, kept_levels, encodings, kept: kept.unwrap_or(0..0) }
    }

    /// Levels and their aprons; its rows are empty.
    pub fn operator(&self) -> &Arc<Operator> {
        &self.operator
    }
    /// Texels along an edge of a face of the base.
    pub fn resolution(&self) -> usize {
        self.operator.base_resolution()
    }
    /// Levels whose texels are encoded.
    pub fn kept_levels(&self) -> LevelRange {
        self.kept_levels
    }
    /// Encodings of the kept texels, in order.
    pub fn encodings(&self) -> &[[f32; ENCODING]] {
        &self.encodings
    }
    /// Kept texels among the inputs of [`Operator::aprons`]: of the base, and of the rows.
    pub fn nodes(&self) -> [Range<usize>; 2] {
        let base = FACE_COUNT * self.resolution() * self.resolution();
        let Range { start, end } = self.kept;
        let row = |texel: usize| self.operator.node_count() + texel.max(base) - base;
        [start.min(base)..end.min(base), row(start)..row(end)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_texels_of_kept_levels_are_encoded() {
        let all = EncodedTexels::new(32, LevelRange::ALL);
        let count = |range: &Range<usize>| range.len();
        assert_eq!(all.nodes().iter().map(count).sum::<usize>(), all.encodings().len());
        assert_eq!(all.nodes()[0], 0..FACE_COUNT * 32 * 32);
        assert_eq!(all.nodes()[1].end, all.operator().node_count() + all.operator().row_count());
        let some = EncodedTexels::new(32, LevelRange { first: 2, end: 4 });
        assert!(some.nodes()[0].is_empty(), "the base is not kept");
        let levels = all.operator().levels();
        let before: usize = levels[..2].iter().map(|level| FACE_COUNT * level.resolution.pow(2)).sum();
        assert_eq!(some.encodings(), &all.encodings()[before..before + some.encodings().len()]);
        let none = EncodedTexels::new(32, LevelRange::NONE);
        assert!(none.encodings().is_empty() && none.nodes().iter().all(Range::is_empty));
    }
}
