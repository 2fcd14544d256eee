//! Which splats each tile holds, front to back.

use crate::project::{SplatRecord, Splats};
use rayon::prelude::*;
use specula_core::{
    bin::{Footprint, TILE_SIZE, span_in_rows, tile_count, tile_range},
    camera::Camera,
};

/// Tiles of a picture and the splats that they hold.
///
/// An *intersection* is one splat in one tile. Intersections are emitted Gaussian by Gaussian, and lie in memory tile
/// by tile, each tile sorted by depth and ties by the order of the Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct Tiles {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    /// First intersection of each tile, and one past the last.
    pub(crate) starts: Vec<u32>,
    /// Gaussian of each intersection.
    pub(crate) gaussians: Vec<u32>,
    /// First emission of each Gaussian, and one past the last.
    pub(crate) emissions: Vec<u32>,
    /// Where an emission lies among the intersections.
    pub(crate) positions: Vec<u32>,
}

impl Tiles {
    /// Number of intersections.
    pub fn intersection_count(&self) -> usize {
        self.gaussians.len()
    }
    /// Intersections of one tile.
    pub(crate) fn of(&self, tile: usize) -> core::ops::Range<usize> {
        self.starts[tile] as usize..self.starts[tile + 1] as usize
    }
}

pub(crate) fn bin_all(splats: &Splats, camera: &Camera) -> Tiles {
    const GAUSSIANS_AT_ONCE: usize = 2048;
    let (columns, rows) = (tile_count(camera.width), tile_count(camera.height));
    let emitted: Vec<(Vec<u32>, Vec<u32>)> =
        splats.records.par_chunks(GAUSSIANS_AT_ONCE).map(|records| emit(records, columns, rows)).collect();

    let mut emissions = Vec::with_capacity(splats.records.len() + 1);
    let mut tiles = Vec::new();
    emissions.push(0);
    for (counts, chunk) in emitted {
        for count in counts {
            emissions.push(emissions[emissions.len() - 1] + count);
        }
        tiles.extend(chunk);
    }
    let order = depth_order(&splats.records, &emissions);
    sort_into_tiles(columns, rows, &order, emissions, &tiles)
}

/// Tiles that each of some splats touches: how many, and which.
fn emit(records: &[SplatRecord], columns: u32, rows: u32) -> (Vec<u32>, Vec<u32>) {
    let mut counts = Vec::with_capacity(records.len());
    let mut tiles = Vec::new();
    for record in records {
        let before = tiles.len();
        if record.reach > 0.0 {
            emit_one(record, columns, rows, &mut tiles);
        }
        counts.push((tiles.len() - before) as u32);
    }
    (counts, tiles)
}

fn emit_one(record: &SplatRecord, columns: u32, rows: u32, tiles: &mut Vec<u32>) {
    let [x, y] = record.mean2d;
    let [half_width, half_height] = record.half_extent;
    let [first_row, end_row] = tile_range(y - half_height, y + half_height, rows);
    let [first, end] = tile_range(x - half_width, x + half_width, columns);
    if end_row - first_row == 1 || end - first == 1 {
        for row in first_row..end_row {
            tiles.extend((first..end).map(|column| row * columns + column));
        }
        return;
    }
    let footprint = Footprint { mean2d: record.mean2d, root_conic: record.root_conic, reach: record.reach };
    for row in first_row..end_row {
        let [left, right] = span_in_rows(&footprint, (row * TILE_SIZE) as f32, ((row + 1) * TILE_SIZE) as f32);
        let [first, end] = tile_range(left, right, columns);
        tiles.extend((first..end).map(|column| row * columns + column));
    }
}

/// Drawn Gaussians by depth, ties in their order: a radix sort of the depths' bits, which for positive numbers are in
/// the order of the numbers.
fn depth_order(records: &[SplatRecord], emissions: &[u32]) -> Vec<u32> {
    const DIGIT_BITS: u32 = 11;
    const DIGITS: usize = 1 << DIGIT_BITS;
    let drawn = (0..records.len()).filter(|index| emissions[index + 1] > emissions[*index]);
    let mut keyed: Vec<(u32, u32)> = drawn.map(|index| (records[index].depth.to_bits(), index as u32)).collect();
    let mut scratch = vec![(0, 0); keyed.len()];
    for shift in [0, DIGIT_BITS, 2 * DIGIT_BITS] {
        let digit = |key: u32| (key >> shift) as usize % DIGITS;
        let mut starts = vec![0_usize; DIGITS + 1];
        keyed.iter().for_each(|(key, _)| starts[digit(*key) + 1] += 1);
        (0..DIGITS).for_each(|d| starts[d + 1] += starts[d]);
        for entry in &keyed {
            let place = &mut starts[digit(entry.0)];
            scratch[*place] = *entry;
            *place += 1;
        }
        core::mem::swap(&mut keyed, &mut scratch);
    }
    keyed.into_iter().map(|(_, index)| index).collect()
}

/// A counting sort by tile, which keeps the order of depth within each tile.
fn sort_into_tiles(columns: u32, rows: u32, order: &[u32], emissions: Vec<u32>, tiles: &[u32]) -> Tiles {
    let tile_count = (columns * rows) as usize;
    let mut starts = vec![0_u32; tile_count + 1];
    tiles.iter().for_each(|tile| starts[*tile as usize + 1] += 1);
    (0..tile_count).for_each(|tile| starts[tile + 1] += starts[tile]);

    let mut next = starts.clone();
    let mut gaussians = vec![0; tiles.len()];
    let mut positions = vec![0; tiles.len()];
    for gaussian in order {
        let own = emissions[*gaussian as usize] as usize..emissions[*gaussian as usize + 1] as usize;
        for emission in own {
            let place = &mut next[tiles[emission] as usize];
            gaussians[*place as usize] = *gaussian;
            positions[emission] = *place;
            *place += 1;
        }
    }
    Tiles { columns, rows, starts, gaussians, emissions, positions }
}
