//! Arrays of Gaussians in as many pieces as it takes.
//!
//! What a kernel sees of an array has a limit, and Gaussians have many planes. So they may lie in several arrays, each
//! of a whole number of blocks, and a stage that goes Gaussian by Gaussian runs once for each piece. Every Gaussian is
//! computed as if there were one piece alone, so results do not depend on how many there are.

use crate::{
    device::{Gpu, GpuError},
    machine::Machine,
    memory::Array,
};
use bytemuck::Pod;
use core::ops::Range;
use specula_core::scene::BLOCK;

/// Numbers of 32 bits on the device: all in one array, or those of Gaussians in several.
#[derive(Debug)]
pub struct Pieces {
    arrays: Vec<Array>,
    /// Gaussians in every array but the last, which may have fewer.
    gaussians_each: usize,
}

/// Some of the Gaussians, and where they lie.
#[derive(Clone, Debug)]
pub(crate) struct Piece<'a> {
    pub(crate) gaussians: Range<usize>,
    pub(crate) array: &'a Array,
}

impl Pieces {
    /// How many numbers there are.
    pub fn len(&self) -> usize {
        self.arrays.iter().map(Array::len).sum()
    }
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// How many arrays they lie in.
    pub fn piece_count(&self) -> usize {
        self.arrays.len()
    }

    /// Gaussians in every piece but the last, which may have fewer.
    pub(crate) fn gaussians_each(&self) -> usize {
        self.gaussians_each
    }

    /// The array of what is never divided.
    pub(crate) fn whole(&self) -> &Array {
        let [array] = &*self.arrays else { panic!("only Gaussians, uploaded as such, lie in several arrays") };
        array
    }

    /// The array of what is never divided.
    pub(crate) fn into_whole(mut self) -> Array {
        self.whole();
        self.arrays.remove(0)
    }

    /// The pieces of so many Gaussians.
    pub(crate) fn of(&self, count: usize) -> impl Iterator<Item = Piece<'_>> {
        self.arrays.iter().zip(ranges(count, self.gaussians_each)).map(|(array, gaussians)| Piece { gaussians, array })
    }

    /// The array that the Gaussians of a piece of another lie in, and the number of its first.
    pub(crate) fn around(&self, piece: &Piece<'_>) -> (&Array, usize) {
        let number = piece.gaussians.start / self.gaussians_each;
        (&self.arrays[number], number * self.gaussians_each)
    }

    /// The arrays of several that are divided alike.
    pub(crate) fn side_by_side<const N: usize>(several: [&Self; N]) -> impl Iterator<Item = [&Array; N]> {
        let is_alike = |other: &Self| other.arrays.iter().map(Array::len).eq(several[0].arrays.iter().map(Array::len));
        assert!(several.into_iter().all(is_alike), "gradients and moments are uploaded as their Gaussians are");
        (0..several[0].piece_count()).map(move |number| several.map(|pieces| &pieces.arrays[number]))
    }
}

impl From<Array> for Pieces {
    fn from(array: Array) -> Self {
        Self { arrays: vec![array], gaussians_each: usize::MAX }
    }
}

/// So many Gaussians, so many each; at least one piece.
fn ranges(count: usize, each: usize) -> impl Iterator<Item = Range<usize>> {
    (0..count.div_ceil(each).max(1)).map(move |number| number * each..(number + 1).saturating_mul(each).min(count))
}

/// How Gaussians are divided.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Division {
    /// Numbers of 32 bits that each has.
    words: usize,
    gaussians_each: usize,
}

impl Division {
    /// As many to a piece as an array holds.
    pub(crate) fn new(gpu: &Gpu, words: usize) -> Self {
        let blocks = (gpu.piece_max() / 4) as usize / (BLOCK * words);
        Self { words, gaussians_each: BLOCK * blocks.max(1) }
    }

    /// Other numbers of Gaussians that are divided already: as many pieces of theirs to a piece as an array holds.
    pub(crate) fn around(gpu: &Gpu, words: usize, pieces_each: usize) -> Self {
        let gaussians_each = Self::new(gpu, words).gaussians_each;
        Self { words, gaussians_each: pieces_each.max(gaussians_each / pieces_each * pieces_each) }
    }
}

impl Machine {
    /// How Gaussians with so many numbers each are divided.
    pub(crate) fn division(&self, words: usize) -> Division {
        Division::new(&self.gpu, words)
    }

    /// Pieces for so many Gaussians, whatever their numbers are.
    pub(crate) fn take_pieces(&self, what: &'static str, count: usize, division: Division) -> Result<Pieces, GpuError> {
        let Division { words, gaussians_each } = division;
        let len = |gaussians: Range<usize>| gaussians.len().next_multiple_of(BLOCK) * words;
        let arrays = ranges(count, gaussians_each).map(|gaussians| self.take(what, len(gaussians)));
        Ok(Pieces { arrays: arrays.collect::<Result<_, _>>()?, gaussians_each })
    }

    /// Pieces like others, whatever their numbers are.
    pub(crate) fn take_like(&self, what: &'static str, like: &Pieces) -> Result<Pieces, GpuError> {
        let arrays = like.arrays.iter().map(|array| self.take(what, array.len()));
        Ok(Pieces { arrays: arrays.collect::<Result<_, _>>()?, gaussians_each: like.gaussians_each })
    }

    /// The numbers of so many Gaussians.
    pub(crate) fn upload_pieces<T: Pod>(
        &mut self,
        what: &'static str,
        values: &[T],
        count: usize,
        division: Division,
    ) -> Result<Pieces, GpuError> {
        let pieces = self.take_pieces(what, count, division)?;
        assert_eq!(values.len(), pieces.len(), "all numbers of all Gaussians are there");
        let mut rest = values;
        for array in &pieces.arrays {
            let (own, others) = rest.split_at(array.len());
            self.write(array, own)?;
            rest = others;
            if !rest.is_empty() {
                // Copies on their way to the device do not all wait at once.
                self.kernels.submit(&self.gpu)?;
            }
        }
        Ok(pieces)
    }

    /// All numbers. Waits for the device.
    pub(crate) fn download_pieces<T: Pod>(&mut self, pieces: &Pieces, values: &mut [T]) -> Result<(), GpuError> {
        let mut rest = values;
        for array in &pieces.arrays {
            let (own, others) = rest.split_at_mut(array.len().min(rest.len()));
            self.download(array, 0, own)?;
            rest = others;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_gaussian_lies_in_one_piece() {
        for (count, each) in [(0, 16), (1, 16), (16, 16), (17, 16), (1000, 208), (1000, usize::MAX)] {
            let pieces: Vec<Range<usize>> = ranges(count, each).collect();
            assert_eq!(pieces.len(), count.div_ceil(each).max(1), "{count} Gaussians, {each} each");
            assert!(pieces.iter().cloned().flatten().eq(0..count), "{count} Gaussians, {each} each: {pieces:?}");
            assert!(pieces.iter().all(|piece| piece.len() <= each), "{count} Gaussians, {each} each: {pieces:?}");
        }
    }
}
