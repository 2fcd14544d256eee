//! What every stage works with: the machine's vectors, and memory that is used again.

use crate::{
    bin::RowRange,
    buffer::Pool,
    frame::Quad,
    prefilter::Texel,
    project::{PerspectiveRecord, SplatRecord},
};
use core::sync::atomic::AtomicU32;
use fearless_simd::Level;

/// Vectors and memory.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) level: Level,
    pub(crate) numbers: Pool<f32>,
    pub(crate) indices: Pool<u32>,
    /// Sort keys with what they belong to.
    pub(crate) keyed: Pool<(u32, u32)>,
    pub(crate) row_ranges: Pool<RowRange>,
    pub(crate) spans: Pool<[u16; 2]>,
    pub(crate) shared: Pool<AtomicU32>,
    pub(crate) quads: Pool<Quad>,
    pub(crate) bits: Pool<u16>,
    pub(crate) records: Pool<SplatRecord>,
    pub(crate) perspectives: Pool<PerspectiveRecord>,
    pub(crate) texels: Pool<Texel>,
    /// Sums that parts of the work leave for the whole, so that they are added in order.
    pub(crate) sums: Pool<[f64; 4]>,
}

impl Machine {
    /// The widest vectors that there are, and no memory yet.
    pub(crate) fn new() -> Self {
        Self {
            level: Level::new(),
            numbers: Pool::default(),
            indices: Pool::default(),
            keyed: Pool::default(),
            row_ranges: Pool::default(),
            spans: Pool::default(),
            shared: Pool::default(),
            quads: Pool::default(),
            bits: Pool::default(),
            records: Pool::default(),
            perspectives: Pool::default(),
            texels: Pool::default(),
            sums: Pool::default(),
        }
    }
}
