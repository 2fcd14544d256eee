//! Costs of the GPU's kernels, counted from their schedules: what each reads, computes and waits
//! for, whatever the machine. Splats behind terminated pixels are counted like the others.

use specula_core::bin::TILE_SIZE;

/// Pixels of a tile.
const PIXELS: usize = (TILE_SIZE * TILE_SIZE) as usize;
/// Bytes of an index or a number.
const WORD: usize = 4;
/// Bytes of a splat that compositing reads: mean, root and opacity.
const SHAPE: usize = 6 * WORD;
/// Bytes of a splat in storage, and of one staged in workgroup memory.
const SPLAT: usize = 12 * WORD;
const STAGED_SPLAT: usize = 8 * WORD;
/// Numbers of a splat's gradient beside those of its channels.
const MOMENTS: usize = 6;
/// Bytes of workgroup memory that sums may take.
const SUMS_MAX: usize = 16 * 1024 - 64;
/// Splats that `blend` stages at once.
const BATCH: usize = 64;
/// Invocations of `blend_vjp` that own pixels, and pixels of each.
const BY_PIXELS: [usize; 2] = [64, 4];
/// Invocations of `blend_vjp` that own splats, and pixels of a step.
const BY_SPLATS: [usize; 2] = [32, 4];
/// Barriers of a uniform load.
const UNIFORM_LOAD: f64 = 2.0;
/// Steps of `blend_vjp` between two uniform loads.
const STEPS_AT_ONCE: usize = 8;

/// Costs of a kernel, for each unit of its work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Bytes that invocations read from storage and write to it.
    pub storage_bytes: f64,
    /// Bytes that invocations read from workgroup memory and write to it.
    pub workgroup_bytes: f64,
    /// Floating-point operations.
    pub operations: f64,
    /// Bytes of workgroup memory of a workgroup.
    pub workgroup_memory: usize,
    /// Barriers that a workgroup passes.
    pub barriers: f64,
    /// Share of the invocations' steps that do nothing.
    pub idle: f64,
}

/// Vectors of four channels.
const fn vectors(channels: usize) -> usize {
    channels.div_ceil(4)
}

/// `blend` with a pixel an invocation, each reading all splats; a unit is a splat of a tile.
pub fn blend_unstaged(channels: usize) -> Cost {
    Cost {
        storage_bytes: (PIXELS * (WORD + SHAPE + 16 * vectors(channels))) as f64,
        workgroup_bytes: 0.0,
        operations: (PIXELS * (29 + 2 * channels)) as f64,
        workgroup_memory: 0,
        barriers: 0.0,
        idle: 0.0,
    }
}

/// `blend` with splats staged in workgroup memory, for tiles of so many splats.
pub fn blend_staged(channels: usize, tiles: &[usize]) -> Cost {
    let vectors = vectors(channels);
    let splats: usize = tiles.iter().sum();
    let batches: usize = tiles.iter().map(|count| count.div_ceil(BATCH)).sum();
    Cost {
        storage_bytes: (WORD * (1 + vectors) + SHAPE + 16 * vectors) as f64,
        workgroup_bytes: ((PIXELS + 1) * (SHAPE + 16 * vectors)) as f64,
        operations: (PIXELS * (29 + 2 * channels)) as f64,
        workgroup_memory: BATCH * (STAGED_SPLAT + 16 * vectors) + 2 * WORD,
        barriers: (2.0 + UNIFORM_LOAD) * batches as f64 / splats as f64,
        idle: 0.0,
    }
}

/// `blend_vjp` with pixels owned by invocations, whose sums are added up in workgroup memory; idle
/// are those without a row to add.
pub fn blend_vjp_by_pixels(channels: usize) -> Cost {
    let [invocations, pixels] = BY_PIXELS;
    debug_assert_eq!(invocations * pixels, PIXELS, "a tile has so many pixels");
    let slot = MOMENTS + channels;
    let row = invocations + 1;
    let at_once = (SUMS_MAX / (WORD * slot * row)).min(31);
    let rows = at_once * slot;
    Cost {
        storage_bytes: (invocations * (WORD + SHAPE + 16 * vectors(channels)) + WORD * (1 + slot)) as f64,
        workgroup_bytes: (2 * WORD * slot * invocations) as f64,
        operations: (PIXELS * (49 + 4 * channels) + slot * invocations) as f64,
        workgroup_memory: WORD * (at_once * slot * row + 3),
        barriers: (1.0 + UNIFORM_LOAD) / at_once as f64,
        idle: 1.0 - rows as f64 / rows.next_multiple_of(invocations) as f64,
    }
}

/// `blend_vjp` with splats owned by invocations, which pixels pass through, for tiles of so many
/// splats.
pub fn blend_vjp_by_splats(channels: usize, tiles: &[usize]) -> Cost {
    let [invocations, pixels] = BY_SPLATS;
    let (slot, vectors, blocks) = (MOMENTS + channels, vectors(channels), PIXELS / pixels);
    let steps = |count: usize| match count {
        0 => 0,
        _ => (count - 1) / invocations * blocks + (count - 1) % invocations + blocks,
    };
    let splats: usize = tiles.iter().sum();
    let steps: usize = tiles.iter().map(|count| steps(*count)).sum();
    let uniform_loads = steps as f64 / STEPS_AT_ONCE as f64;
    Cost {
        storage_bytes: (2 * WORD + SPLAT + 16 * vectors + WORD * slot) as f64,
        workgroup_bytes: (PIXELS * (4 * WORD + 16 * vectors)) as f64,
        operations: (PIXELS * (49 + 4 * channels)) as f64,
        workgroup_memory: WORD * (PIXELS * (4 * vectors + 2) + 1),
        barriers: (steps as f64 + (UNIFORM_LOAD - 1.0) * uniform_loads) / splats as f64,
        idle: 1.0 - (splats * blocks) as f64 / (invocations * steps) as f64,
    }
}

/// A sort of `count` keys of `bits` bits; a unit is an element.
#[derive(Clone, Copy, Debug)]
pub struct Sort {
    /// Bits of a pass.
    pub digit_bits: u32,
    /// Elements whose digits are counted together.
    pub column: usize,
    /// Invocations that take an element each at the same time.
    pub side_by_side: usize,
}

/// The sort of a software driver: each invocation walks over a column alone.
pub const NARROW_SORT: Sort = Sort { digit_bits: 4, column: 64, side_by_side: 1 };
/// The sort of hardware: a workgroup walks over a column row by row.
pub const WIDE_SORT: Sort = Sort { digit_bits: 8, column: 2048, side_by_side: 256 };

impl Sort {
    /// Passes over all elements.
    pub const fn passes(&self, bits: u32) -> u32 {
        bits.div_ceil(self.digit_bits)
    }
    /// Bytes of an element that are read and written: keys to be counted, keys and items to be
    /// moved, and the counts of digits, which are written, summed and read.
    pub fn storage_bytes(&self, bits: u32) -> f64 {
        let counts = 4.0 * (WORD << self.digit_bits) as f64 / self.column as f64;
        f64::from(self.passes(bits)) * (5.0 * WORD as f64 + counts)
    }
    /// Invocations that move elements at the same time.
    pub const fn invocations(&self, count: usize) -> usize {
        count.div_ceil(self.column) * self.side_by_side
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{camera, torus};
    use specula_core::executor::Renderer;
    use specula_cpu::CpuExecutor;
    use specula_train::profile::by_name;

    /// Splats of each tile of the scene that the tables are of.
    fn tiles() -> Vec<usize> {
        let profile = by_name("3dgs", 100).expect("a profile of that name");
        let (cloud, camera) = (torus(100_000, &profile), camera(800));
        let mut cpu = CpuExecutor::new();
        let splats = cpu.project(&cloud, &camera).expect("the CPU projects");
        let tiles = cpu.bin(&splats, &camera).expect("the CPU bins");
        let [columns, rows] = tiles.grid();
        (0..columns * rows).map(|tile| tiles.gaussians_of(tile).count()).collect()
    }

    fn row(name: &str, channels: usize, cost: Cost) -> String {
        let Cost { storage_bytes, workgroup_bytes, operations, workgroup_memory, barriers, idle } = cost;
        format!(
            "| {name} | {channels} | {storage_bytes:.0} | {workgroup_bytes:.0} | {operations:.0} | {workgroup_memory} \
             | {barriers:.2} | {:.0} % |",
            100.0 * idle
        )
    }

    #[test]
    fn the_documentation_has_the_costs_of_the_kernels() {
        let tiles = tiles();
        let page = include_str!("../../docs/performance.md");
        let mut rows = Vec::new();
        for channels in [3, 12] {
            rows.extend([
                row("`blend`, before", channels, blend_unstaged(channels)),
                row("`blend`", channels, blend_staged(channels, &tiles)),
                row("`blend_vjp`, before", channels, blend_vjp_by_pixels(channels)),
                row("`blend_vjp`", channels, blend_vjp_by_splats(channels, &tiles)),
            ]);
        }
        for (name, sort) in [("before", NARROW_SORT), ("now", WIDE_SORT)] {
            let (passes, bytes) = (sort.passes(24), sort.storage_bytes(24));
            rows.push(format!("| {name} | {passes} | {bytes:.0} | {} |", sort.invocations(100_000)));
        }
        let missing: Vec<&String> = rows.iter().filter(|row| !page.contains(row.as_str())).collect();
        assert!(missing.is_empty(), "docs/performance.md lacks:\n{missing:#?}");
    }

    #[test]
    fn few_splats_leave_invocations_idle_and_many_do_not() {
        let idle = |splats: usize| blend_vjp_by_splats(3, &[splats]).idle;
        assert!((idle(1) - 31.0 / 32.0).abs() < 1e-12, "one splat has one invocation");
        assert!(idle(32) > 0.3 && idle(3200) < 0.01, "{} and {}", idle(32), idle(3200));
    }
}
