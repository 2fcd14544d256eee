//! Which splats each tile holds, front to back.

use crate::{
    buffer::Buffer,
    frame::Cover,
    machine::Machine,
    parts::{Pieces, each_part},
    project::{SplatRecord, Splats},
};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use rayon::prelude::*;
use specula_core::{
    bin::{Footprint, TILE_SIZE, outline, span_in_rows, tile_count, tile_range},
    camera::Camera,
};

/// Tiles of a picture and the splats that they hold.
///
/// An *intersection* is one splat in one tile. Intersections are emitted Gaussian by Gaussian, and lie in memory tile
/// by tile, each tile sorted by depth and ties by the order of the Gaussians.
#[derive(Debug)]
pub struct Tiles {
    /// The tiles that hold any splat.
    pub(crate) cover: Cover,
    /// First intersection of each tile, and one past the last.
    starts: Buffer<u32>,
    /// Gaussian of each intersection. Atomic because threads fill it at places that no slice divides; a load is a
    /// plain load.
    gaussians: Buffer<AtomicU32>,
    /// First emission of each Gaussian, and one past the last.
    pub(crate) emissions: Buffer<u32>,
    /// Where an emission lies among the intersections.
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
        let own = self.emissions[gaussian] as usize..self.emissions[gaussian + 1] as usize;
        self.positions[own].iter().map(|position| position.load(Relaxed) as usize)
    }
}

/// Gaussians that one task takes.
const GAUSSIANS_AT_ONCE: usize = 1024;
/// Parts of the Gaussians that are sorted into tiles at once. A stable sort does not depend on it.
const SORT_PARTS: usize = 16;

pub(crate) fn bin_all(machine: &Machine, splats: &Splats, camera: &Camera) -> Tiles {
    let grid = [tile_count(camera.width), tile_count(camera.height)];
    let records = &splats.records;
    let (order, (rows, emissions, spans)) =
        rayon::join(|| depth_order(machine, records), || spread_all(machine, records, grid));
    sort_into_tiles(machine, grid, &order, &Spread { rows, spans }, emissions)
}

/// The rows of tiles that a splat may touch.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RowRange {
    /// Where its spans lie, one for each row.
    first_span: u32,
    first: u16,
    count: u16,
}

/// First column and one past the last, of a splat in a row of tiles.
type Span = [u16; 2];

/// Which tiles splats touch.
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

fn spread_all(
    machine: &Machine,
    records: &[SplatRecord],
    grid: [u32; 2],
) -> (Buffer<RowRange>, Buffer<u32>, Buffer<Span>) {
    let mut rows = machine.row_ranges.take(records.len() + 1);
    rows.par_iter_mut().zip(records).with_min_len(GAUSSIANS_AT_ONCE).for_each(|(rows, record)| {
        *rows = row_range(record, grid[1]);
    });
    let mut total = 0;
    for range in &mut rows[..records.len()] {
        range.first_span = total;
        total += u32::from(range.count);
    }
    rows[records.len()] = RowRange { first_span: total, first: 0, count: 0 };

    let mut spans = machine.spans.take(total as usize);
    let mut counts = machine.indices.take(records.len() + 1);
    let count = records.len().div_ceil(GAUSSIANS_AT_ONCE);
    let place = |part: usize| (part * GAUSSIANS_AT_ONCE).min(records.len());
    let spans_of = |part: usize| rows[place(part)].first_span as usize;
    let parts = (Pieces::new(&mut spans, &spans_of), Pieces::new(&mut counts[..records.len()], &place));
    each_part(count, parts, &|part, (spans, counts): (Pieces<'_, Span>, Pieces<'_, u32>)| {
        let mut spans = spans.only();
        for (gaussian, count) in (place(part)..).zip(counts.only()) {
            let (own, rest) = spans.split_at_mut(usize::from(rows[gaussian].count));
            *count = spread(&records[gaussian], rows[gaussian], grid[0], own);
            spans = rest;
        }
    });
    let mut total = 0;
    for count in &mut counts[..records.len()] {
        (*count, total) = (total, total + *count);
    }
    counts[records.len()] = total;
    (rows, counts, spans)
}

fn row_range(record: &SplatRecord, rows: u32) -> RowRange {
    if !(record.reach > 0.0) {
        return RowRange::default();
    }
    let (y, half) = (record.mean2d[1], record.half_extent[1]);
    let [first, end] = tile_range(y - half, y + half, rows);
    RowRange { first_span: 0, first: first as u16, count: end.saturating_sub(first) as u16 }
}

/// The columns that a splat touches in each of its rows; returns how many tiles those are.
fn spread(record: &SplatRecord, rows: RowRange, columns: u32, spans: &mut [Span]) -> u32 {
    let (x, half) = (record.mean2d[0], record.half_extent[0]);
    let whole = tile_range(x - half, x + half, columns);
    let is_box = spans.len() == 1 || whole[1] <= whole[0] + 1;
    let outline = outline(&Footprint { mean2d: record.mean2d, root_conic: record.root_conic, reach: record.reach });
    let mut count = 0;
    for (row, span) in (u32::from(rows.first)..).zip(spans) {
        let [first, end] = if is_box {
            whole
        } else {
            let [left, right] = span_in_rows(&outline, (row * TILE_SIZE) as f32, ((row + 1) * TILE_SIZE) as f32);
            tile_range(left, right, columns)
        };
        *span = [first as u16, end.max(first) as u16];
        count += u32::from(span[1] - span[0]);
    }
    count
}

/// Drawn Gaussians by depth, ties in their order: a radix sort of the depths' bits, which for positive numbers are in
/// the order of the numbers.
pub(crate) fn depth_order(machine: &Machine, records: &[SplatRecord]) -> Buffer<(u32, u32)> {
    const DIGIT_BITS: u32 = 11;
    const DIGITS: usize = 1 << DIGIT_BITS;
    const SHIFTS: [u32; 3] = [0, DIGIT_BITS, 2 * DIGIT_BITS];
    let digit = |key: u32, shift: u32| (key >> shift) as usize % DIGITS;
    let mut starts = [[0_u32; DIGITS]; SHIFTS.len()];
    let drawn = || records.iter().enumerate().filter(|(_, record)| record.reach > 0.0);
    let mut count = 0;
    for (_, record) in drawn() {
        count += 1;
        for (starts, shift) in starts.iter_mut().zip(SHIFTS) {
            starts[digit(record.depth.to_bits(), shift)] += 1;
        }
    }
    let (mut keyed, mut scratch) = (machine.keyed.take(count), machine.keyed.take(count));
    for (entry, (index, record)) in keyed.iter_mut().zip(drawn()) {
        *entry = (record.depth.to_bits(), index as u32);
    }
    for (starts, shift) in starts.iter_mut().zip(SHIFTS) {
        let mut total = 0;
        for start in starts.iter_mut() {
            (*start, total) = (total, total + *start);
        }
        for entry in keyed.iter() {
            let place = &mut starts[digit(entry.0, shift)];
            scratch[*place as usize] = *entry;
            *place += 1;
        }
        core::mem::swap(&mut keyed, &mut scratch);
    }
    keyed
}

/// A counting sort by tile, which keeps the order of depth within each tile.
fn sort_into_tiles(
    machine: &Machine,
    [columns, rows]: [u32; 2],
    order: &[(u32, u32)],
    spread: &Spread,
    emissions: Buffer<u32>,
) -> Tiles {
    let (columns, rows) = (columns as usize, rows as usize);
    let tile_count = columns * rows;
    let part_len = order.len().div_ceil(SORT_PARTS).max(1);
    let mut next = machine.indices.take_cleared(SORT_PARTS * tile_count);
    let parts = order.par_chunks(part_len);
    parts.clone().zip(next.par_chunks_mut(tile_count.max(1))).for_each(|(order, counts)| {
        for (_, gaussian) in order {
            spread.each_tile(*gaussian as usize, columns, |tile| counts[tile] += 1);
        }
    });

    let mut starts = machine.indices.take(tile_count + 1);
    let mut total = 0;
    for tile in 0..tile_count {
        starts[tile] = total;
        for part in 0..SORT_PARTS {
            let place = &mut next[part * tile_count + tile];
            (*place, total) = (total, total + *place);
        }
    }
    starts[tile_count] = total;

    let gaussians = machine.shared.take(total as usize);
    let positions = machine.shared.take(total as usize);
    parts.zip(next.par_chunks_mut(tile_count.max(1))).for_each(|(order, next)| {
        for (_, gaussian) in order {
            let mut emission = emissions[*gaussian as usize] as usize;
            spread.each_tile(*gaussian as usize, columns, |tile| {
                let place = &mut next[tile];
                gaussians[*place as usize].store(*gaussian, Relaxed);
                positions[emission].store(*place, Relaxed);
                *place += 1;
                emission += 1;
            });
        }
    });
    let cover = Cover::new(&machine.indices, columns, rows, |tile| starts[tile + 1] > starts[tile]);
    Tiles { cover, starts, gaussians, emissions, positions }
}
