//! Splats of each tile, front to back.

use crate::{
    buffer::Buffer,
    context::Context,
    error::CpuError,
    frame::Cover,
    lanes::Lanes,
    parts::{Pieces, each_part},
    stages::project::{SplatRecord, Splats},
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    bin::{TILE_SIZE, outline, span_in_rows, tile_count, tile_range},
    camera::{Camera, TileWindow},
    real::Real,
    scene::BLOCK,
    splat::Footprint,
};

/// Tiles of a picture and their splats.
///
/// An *intersection* is one splat in one tile. Intersections are emitted Gaussian by Gaussian and
/// stored tile by tile, each tile sorted by depth and ties by the order of the Gaussians.
#[derive(Debug)]
pub struct Tiles {
    /// Tiles with at least one splat.
    pub(crate) cover: Cover,
    /// First intersection of each tile, and one past the last.
    starts: Buffer<u32>,
    /// Gaussian of each intersection. Atomic because threads write to it at scattered positions; a
    /// load is a plain load.
    gaussians: Buffer<AtomicU32>,
    /// First emission of each Gaussian, and one past the last.
    pub(crate) emissions: Buffer<u32>,
    /// Position of an emission among the intersections.
    positions: Buffer<AtomicU32>,
}

impl Tiles {
    /// Number of intersections.
    pub fn intersection_count(&self) -> usize {
        self.gaussians.len()
    }
    /// Columns and rows of tiles.
    pub fn grid(&self) -> [usize; 2] {
        [self.cover.columns, self.cover.rows]
    }
    /// Gaussians of a tile, front to back.
    pub fn gaussians_of(&self, tile: usize) -> impl Iterator<Item = usize> + '_ {
        self.of(tile).iter().map(|gaussian| gaussian.load(Relaxed) as usize)
    }
    fn of(&self, tile: usize) -> &[AtomicU32] {
        &self.gaussians[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
    /// Gaussians of a covered tile.
    pub(crate) fn of_covered(&self, slot: usize) -> &[AtomicU32] {
        self.of(self.cover.tiles[slot] as usize)
    }
    /// First intersection of a covered tile, or one past the last of all.
    pub(crate) fn start_of_covered(&self, slot: usize) -> usize {
        self.cover.tiles.get(slot).map_or(self.intersection_count(), |tile| self.starts[*tile as usize] as usize)
    }
    /// Intersections of one Gaussian.
    #[inline(always)]
    pub(crate) fn positions_of(&self, gaussian: usize) -> impl Iterator<Item = usize> + '_ {
        let range = self.emissions[gaussian] as usize..self.emissions[gaussian + 1] as usize;
        self.positions[range].iter().map(|position| position.load(Relaxed) as usize)
    }
}

/// Gaussians per task.
const GAUSSIANS_AT_ONCE: usize = 1024;
/// Parts of the Gaussians that are sorted into tiles at once. A stable sort does not depend on it.
const SORT_PARTS: usize = 16;

pub(crate) fn bin_all(context: &Context, splats: &Splats, camera: &Camera) -> Result<Tiles, CpuError> {
    let grid = [tile_count(camera.width), tile_count(camera.height)];
    let records = &splats.records;
    let window = camera.tile_window();
    let (order, spread) = rayon::join(|| depth_order(context, records), || spread_all(context, records, &window));
    let (rows, emissions, spans) = spread?;
    Ok(sort_into_tiles(context, grid, &order, &Spread { rows, spans }, emissions))
}

/// The rows of tiles that a splat may touch.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RowRange {
    /// Index of its first span; there is one for each row.
    first_span: u32,
    first: u16,
    count: u16,
}

/// First column and one past the last, of a splat in a row of tiles.
type Span = [u16; 2];

/// Rows of tiles, first emissions and spans of all splats.
type Spans = (Buffer<RowRange>, Buffer<u32>, Buffer<Span>);

/// Tiles that splats touch.
struct Spread {
    /// For each splat, and one past the last.
    rows: Buffer<RowRange>,
    spans: Buffer<Span>,
}

impl Spread {
    /// The tiles of a splat, in the order of its emissions.
    #[inline(always)]
    fn each_tile(&self, gaussian: usize, columns: usize, mut visit: impl FnMut(usize)) {
        let rows = self.rows[gaussian];
        let spans = &self.spans[rows.first_span as usize..][..usize::from(rows.count)];
        let mut row_start = usize::from(rows.first) * columns;
        for [first, end] in spans {
            (row_start + usize::from(*first)..row_start + usize::from(*end)).for_each(&mut visit);
            row_start += columns;
        }
    }
}

fn spread_all(context: &Context, records: &[SplatRecord], window: &TileWindow) -> Result<Spans, CpuError> {
    let mut rows = context.take::<RowRange>(records.len() + 1);
    rows.par_chunks_mut(GAUSSIANS_AT_ONCE).zip(records.par_chunks(GAUSSIANS_AT_ONCE)).for_each(|(rows, records)| {
        dispatch!(context.level, _simd => {
            for (rows, record) in rows.iter_mut().zip(records) {
                *rows = row_range(record, window.rows);
            }
        });
    });
    let mut total = 0;
    for range in &mut rows[..records.len()] {
        range.first_span = sum_so_far(total)?;
        total += u64::from(range.count);
    }
    let total = sum_so_far(total)?;
    rows[records.len()] = RowRange { first_span: total, first: 0, count: 0 };

    let mut spans = context.take::<Span>(total as usize);
    let mut counts = context.take::<u32>(records.len() + 1);
    let count = records.len().div_ceil(GAUSSIANS_AT_ONCE);
    let start_of = |part: usize| (part * GAUSSIANS_AT_ONCE).min(records.len());
    let spans_of = |part: usize| rows[start_of(part)].first_span as usize;
    let parts = (Pieces::new(&mut spans, &spans_of), Pieces::new(&mut counts[..records.len()], &start_of));
    each_part(count, parts, &|part, (spans, counts): (Pieces<'_, Span>, Pieces<'_, u32>)| {
        let range = start_of(part)..start_of(part + 1);
        let blocks = records[range.clone()].chunks(BLOCK).zip(rows[range].chunks(BLOCK));
        let (spans, first_span) = (spans.only(), spans_of(part));
        dispatch!(context.level, simd => {
            for ((records, rows), counts) in blocks.zip(counts.only().chunks_mut(BLOCK)) {
                spread_block(simd, records, rows, window.columns, first_span, spans, counts);
            }
        });
    });
    let mut total = 0;
    for count in &mut counts[..records.len()] {
        let before = sum_so_far(total)?;
        total += u64::from(*count);
        *count = before;
    }
    counts[records.len()] = sum_so_far(total)?;
    Ok((rows, counts, spans))
}

/// Number of splats in tiles, if it fits into a word.
fn sum_so_far(total: u64) -> Result<u32, CpuError> {
    u32::try_from(total).map_err(|_| CpuError::TooManySplats)
}

#[inline(always)]
fn row_range(record: &SplatRecord, rows: [u32; 2]) -> RowRange {
    if !(record.reach > 0.0) {
        return RowRange::default();
    }
    let (y, half) = (record.mean2d[1], record.half_extent[1]);
    let [first, end] = tile_range(y - half, y + half, rows.map(|row| row as f32)).map(|tile| tile as u16);
    RowRange { first_span: 0, first, count: end.saturating_sub(first) }
}

/// Columns that each splat of a block touches in each of its rows, and the number of these tiles.
/// `spans` begin with span `first_span`.
#[inline(always)]
fn spread_block<S: Simd>(
    simd: S,
    records: &[SplatRecord],
    rows: &[RowRange],
    columns: [u32; 2],
    first_span: usize,
    spans: &mut [Span],
    counts: &mut [u32],
) {
    let (footprint, half_width) = footprints(simd, records);
    let outline = outline(&footprint);
    let columns = columns.map(|column| Lanes::splat(simd, column as f32));
    let x = footprint.mean2d[0];
    let whole = tile_range(x - half_width, x + half_width, columns);
    let mut row_lanes = [[0.0; BLOCK]; 2];
    let mut rows_max = 0;
    for (lane, rows) in rows.iter().enumerate() {
        (row_lanes[0][lane], row_lanes[1][lane]) = (f32::from(rows.first), f32::from(rows.count));
        rows_max = rows_max.max(rows.count);
    }
    let [first_row, row_count] = [Lanes::load(simd, &row_lanes[0]), Lanes::load(simd, &row_lanes[1])];
    // Splats in a single row or column of tiles need no outline.
    let is_box = row_count.less_or_equal(row_count.constant(1.0)) | whole[1].less_or_equal(whole[0] + 1.0);
    counts.fill(0);
    for row in 0..rows_max {
        let top = (first_row + f32::from(row)) * TILE_SIZE as f32;
        let [left, right] = span_in_rows(&outline, top, top + TILE_SIZE as f32);
        let [first, end] = tile_range(left, right, columns);
        let first = Lanes::select(is_box, whole[0], first);
        let end = Lanes::select(is_box, whole[1], end).max(first);
        let (first, end) = (first.to_array(), end.to_array());
        for (lane, rows) in rows.iter().enumerate().filter(|(_, rows)| row < rows.count) {
            let span = [first[lane] as u16, end[lane] as u16];
            spans[rows.first_span as usize - first_span + usize::from(row)] = span;
            counts[lane] += u32::from(span[1] - span[0]);
        }
    }
}

/// Footprints of a block, and half their widths; arbitrary values after the last.
#[inline(always)]
fn footprints<S: Simd>(simd: S, records: &[SplatRecord]) -> (Footprint<Lanes<S>>, Lanes<S>) {
    let mut numbers = [[0.0; BLOCK]; 7];
    for (lane, record) in records.iter().enumerate() {
        let ([x, y], [xx, yx, yy]) = (record.mean2d, record.root_conic);
        let shape = [x, y, xx, yx, yy, record.reach, record.half_extent[0]];
        for k in 0..shape.len() {
            numbers[k][lane] = shape[k];
        }
    }
    let load = |k: usize| Lanes::load(simd, &numbers[k]);
    let footprint = Footprint { mean2d: [load(0), load(1)], root_conic: [load(2), load(3), load(4)], reach: load(5) };
    (footprint, load(6))
}

/// Drawn Gaussians by depth, ties in their order: a radix sort of the depths' bits, which for
/// positive numbers are in the order of the numbers. Bits that all depths share are skipped.
pub(crate) fn depth_order(context: &Context, records: &[SplatRecord]) -> Buffer<(u32, u32)> {
    let drawn = || records.iter().enumerate().filter(|(_, record)| record.reach > 0.0);
    let bounds = drawn().fold((0, u32::MAX, 0), |(count, low, high), (_, record)| {
        let key = record.depth.to_bits();
        (count + 1, key.min(low), key.max(high))
    });
    let (count, low, high) = bounds;
    let (mut keyed, mut scratch) = (context.take::<(u32, u32)>(count), context.take::<(u32, u32)>(count));
    let passes = (u32::BITS - high.saturating_sub(low).leading_zeros()).div_ceil(DIGIT_BITS);
    let mut starts = [[0_u32; DIGITS]; PASSES_MAX];
    for (entry, (index, record)) in keyed.iter_mut().zip(drawn()) {
        let key = record.depth.to_bits() - low;
        *entry = (key, index as u32);
        for pass in 0..passes {
            starts[pass as usize][digit(key, pass)] += 1;
        }
    }
    for pass in 0..passes {
        let starts = &mut starts[pass as usize];
        let mut total = 0;
        for start in starts.iter_mut() {
            (*start, total) = (total, total + *start);
        }
        for entry in keyed.iter() {
            let offset = &mut starts[digit(entry.0, pass)];
            scratch[*offset as usize] = *entry;
            *offset += 1;
        }
        core::mem::swap(&mut keyed, &mut scratch);
    }
    keyed.iter_mut().for_each(|entry| entry.0 += low);
    keyed
}

/// Bits that a pass of the sort reads.
const DIGIT_BITS: u32 = 12;
const DIGITS: usize = 1 << DIGIT_BITS;
/// Passes over all bits.
const PASSES_MAX: usize = u32::BITS.div_ceil(DIGIT_BITS) as usize;

fn digit(key: u32, pass: u32) -> usize {
    (key >> (pass * DIGIT_BITS)) as usize % DIGITS
}

/// A counting sort by tile, which keeps the order of depth within each tile.
fn sort_into_tiles(
    context: &Context,
    [columns, rows]: [u32; 2],
    order: &[(u32, u32)],
    spread: &Spread,
    emissions: Buffer<u32>,
) -> Tiles {
    let (columns, rows) = (columns as usize, rows as usize);
    let tile_count = columns * rows;
    let part_len = order.len().div_ceil(SORT_PARTS).max(1);
    let mut next = context.take_cleared::<u32>(SORT_PARTS * tile_count);
    let parts = order.par_chunks(part_len);
    parts.clone().zip(next.par_chunks_mut(tile_count.max(1))).for_each(|(order, counts)| {
        for (_, gaussian) in order {
            spread.each_tile(*gaussian as usize, columns, |tile| counts[tile] += 1);
        }
    });

    let mut starts = context.take::<u32>(tile_count + 1);
    let mut total = 0;
    for tile in 0..tile_count {
        starts[tile] = total;
        for part in 0..SORT_PARTS {
            let offset = &mut next[part * tile_count + tile];
            (*offset, total) = (total, total + *offset);
        }
    }
    starts[tile_count] = total;

    let gaussians = context.take::<AtomicU32>(total as usize);
    let positions = context.take::<AtomicU32>(total as usize);
    parts.zip(next.par_chunks_mut(tile_count.max(1))).for_each(|(order, next)| {
        for (_, gaussian) in order {
            let mut emission = emissions[*gaussian as usize] as usize;
            spread.each_tile(*gaussian as usize, columns, |tile| {
                let offset = &mut next[tile];
                gaussians[*offset as usize].store(*gaussian, Relaxed);
                positions[emission].store(*offset, Relaxed);
                *offset += 1;
                emission += 1;
            });
        }
    });
    let cover = Cover::new(context, columns, rows, |tile| starts[tile + 1] > starts[tile]);
    Tiles { cover, starts, gaussians, emissions, positions }
}
