//! Arrays of Gaussians, divided into chunks.
//!
//! The size of a storage binding is limited, and Gaussians have many planes. So Gaussians may be in
//! several arrays, each of a whole number of blocks; a stage that processes Gaussians one by one
//! runs once for each chunk. Every Gaussian is computed as in a single array, so results do not
//! depend on the number of chunks.

use crate::device::{context::Context, error::GpuError, gpu::Gpu, memory::Array};
use bytemuck::Pod;
use core::ops::Range;
use specula_core::{
    pack::Storage,
    scene::{BLOCK, Layout},
};

/// 32-bit numbers on the device: a single array, or Gaussians in several chunks.
#[derive(Debug)]
pub struct ChunkedArray {
    arrays: Vec<Array>,
    /// Gaussians in every chunk except the last, which may have fewer.
    chunk_len: usize,
    /// Layout of Gaussians whose planes are packed as halves; `None` for numbers of 32 bits.
    packed: Option<Layout>,
}

/// One chunk: a range of Gaussians, and their array.
#[derive(Clone, Debug)]
pub(crate) struct Chunk<'a> {
    pub(crate) gaussians: Range<usize>,
    pub(crate) array: &'a Array,
}

impl ChunkedArray {
    /// Number of elements in all chunks.
    pub fn len(&self) -> usize {
        self.arrays.iter().map(Array::len).sum()
    }
    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Number of chunks.
    pub fn chunk_count(&self) -> usize {
        self.arrays.len()
    }

    /// The same array, marked as planes of Gaussians packed as halves.
    pub(crate) fn packed_from(self, layout: Layout) -> Self {
        Self { packed: Some(layout), ..self }
    }

    /// Layout of Gaussians whose planes are packed as halves; `None` for numbers of 32 bits.
    pub(crate) fn packed_layout(&self) -> Option<Layout> {
        self.packed
    }

    /// Format in which the planes of Gaussians are stored.
    pub(crate) fn storage(&self) -> Storage {
        if self.packed.is_some() { Storage::F16 } else { Storage::F32 }
    }

    /// Gaussians in every chunk except the last, which may have fewer.
    pub(crate) fn chunk_len(&self) -> usize {
        self.chunk_len
    }

    /// Array of values that are never divided into chunks.
    pub(crate) fn whole(&self) -> &Array {
        let [array] = &*self.arrays else { panic!("only Gaussians, uploaded as such, may be in several arrays") };
        array
    }

    /// Chunks of `count` Gaussians.
    pub(crate) fn chunks(&self, count: usize) -> impl Iterator<Item = Chunk<'_>> {
        self.arrays.iter().zip(ranges(count, self.chunk_len)).map(|(array, gaussians)| Chunk { gaussians, array })
    }

    /// Array with the Gaussians of another array's chunk, and the index of its first Gaussian.
    pub(crate) fn around(&self, chunk: &Chunk<'_>) -> (&Array, usize) {
        let index = chunk.gaussians.start / self.chunk_len;
        (&self.arrays[index], index * self.chunk_len)
    }

    /// Chunks of several arrays with the same division, side by side.
    pub(crate) fn side_by_side<const N: usize>(several: [&Self; N]) -> impl Iterator<Item = [&Array; N]> {
        let is_alike = |other: &Self| other.arrays.iter().map(Array::len).eq(several[0].arrays.iter().map(Array::len));
        assert!(several.into_iter().all(is_alike), "gradients and moments are uploaded like their Gaussians");
        (0..several[0].chunk_count()).map(move |index| several.map(|chunked| &chunked.arrays[index]))
    }
}

impl From<Array> for ChunkedArray {
    fn from(array: Array) -> Self {
        Self { arrays: vec![array], chunk_len: usize::MAX, packed: None }
    }
}

/// Ranges of `chunk_len` Gaussians each; at least one range.
fn ranges(count: usize, chunk_len: usize) -> impl Iterator<Item = Range<usize>> {
    (0..count.div_ceil(chunk_len).max(1))
        .map(move |index| index * chunk_len..(index + 1).saturating_mul(chunk_len).min(count))
}

/// Division of Gaussians into chunks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chunking {
    /// 32-bit numbers of a Gaussian.
    words: usize,
    /// Gaussians of a chunk.
    chunk_len: usize,
}

impl Chunking {
    /// Chunks of the maximum size of an array.
    pub(crate) fn new(gpu: &Gpu, words: usize) -> Self {
        let blocks = (gpu.chunk_max() / 4) as usize / (BLOCK * words);
        Self { words, chunk_len: BLOCK * blocks.max(1) }
    }

    /// Chunks of another array of divided Gaussians: whole chunks of theirs, up to the size of an
    /// array.
    pub(crate) fn around(gpu: &Gpu, words: usize, inner_len: usize) -> Self {
        let chunk_len = Self::new(gpu, words).chunk_len;
        Self { words, chunk_len: inner_len.max(chunk_len / inner_len * inner_len) }
    }
}

impl Context {
    /// Division of Gaussians with `words` numbers each.
    pub(crate) fn chunking(&self, words: usize) -> Chunking {
        Chunking::new(&self.gpu, words)
    }

    /// Allocates chunks for `count` Gaussians, with arbitrary contents.
    ///
    /// # Errors
    ///
    /// See [`Self::allocate`].
    pub(crate) fn allocate_chunks(
        &self,
        what: &'static str,
        count: usize,
        chunking: Chunking,
    ) -> Result<ChunkedArray, GpuError> {
        let Chunking { words, chunk_len } = chunking;
        let len = |gaussians: Range<usize>| gaussians.len().next_multiple_of(BLOCK) * words;
        let arrays = ranges(count, chunk_len).map(|gaussians| self.allocate(what, len(gaussians)));
        Ok(ChunkedArray { arrays: arrays.collect::<Result<_, _>>()?, chunk_len, packed: None })
    }

    /// Allocates chunks of the same sizes as those of `like`, with arbitrary contents.
    ///
    /// # Errors
    ///
    /// See [`Self::allocate`].
    pub(crate) fn allocate_like(&self, what: &'static str, like: &ChunkedArray) -> Result<ChunkedArray, GpuError> {
        let arrays = like.arrays.iter().map(|array| self.allocate(what, array.len()));
        Ok(ChunkedArray { arrays: arrays.collect::<Result<_, _>>()?, chunk_len: like.chunk_len, packed: like.packed })
    }

    /// Uploads the numbers of `count` Gaussians.
    ///
    /// # Errors
    ///
    /// See [`Self::allocate`] and [`Self::submit`].
    pub(crate) fn upload_chunks<T: Pod>(
        &mut self,
        what: &'static str,
        values: &[T],
        count: usize,
        chunking: Chunking,
    ) -> Result<ChunkedArray, GpuError> {
        let chunked = self.allocate_chunks(what, count, chunking)?;
        assert_eq!(values.len(), chunked.len(), "all numbers of all Gaussians are there");
        let mut rest = values;
        for array in &chunked.arrays {
            let (chunk, others) = rest.split_at(array.len());
            self.write(array, chunk)?;
            rest = others;
            if !rest.is_empty() {
                // Bounds the staging memory to one chunk.
                self.submit()?;
            }
        }
        Ok(chunked)
    }

    /// Records a write of numbers, of 32 bits each, from the number `first` of all chunks on.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub(crate) fn write_chunks<T: Pod>(
        &mut self,
        chunked: &ChunkedArray,
        first: usize,
        values: &[T],
    ) -> Result<(), GpuError> {
        let (mut start, end) = (0, first + values.len());
        for array in &chunked.arrays {
            let part = first.max(start)..end.min(start + array.len());
            if !part.is_empty() {
                self.write_at(array, part.start - start, &values[part.start - first..part.end - first])?;
            }
            start += array.len();
        }
        Ok(())
    }

    /// Downloads all chunks. Blocks until the device is done.
    ///
    /// # Errors
    ///
    /// See [`Self::download`].
    pub(crate) fn download_chunks<T: Pod>(&mut self, chunked: &ChunkedArray, values: &mut [T]) -> Result<(), GpuError> {
        let mut rest = values;
        for array in &chunked.arrays {
            let (chunk, others) = rest.split_at_mut(array.len().min(rest.len()));
            self.download(array, 0, chunk)?;
            rest = others;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_gaussian_is_in_one_chunk() {
        for (count, each) in [(0, 16), (1, 16), (16, 16), (17, 16), (1000, 208), (1000, usize::MAX)] {
            let chunks: Vec<Range<usize>> = ranges(count, each).collect();
            assert_eq!(chunks.len(), count.div_ceil(each).max(1), "{count} Gaussians, {each} each");
            assert!(chunks.iter().cloned().flatten().eq(0..count), "{count} Gaussians, {each} each: {chunks:?}");
            assert!(chunks.iter().all(|chunk| chunk.len() <= each), "{count} Gaussians, {each} each: {chunks:?}");
        }
    }
}
