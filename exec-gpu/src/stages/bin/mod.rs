//! Binning: splats are sorted by depth, then by tile.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        camera::{CameraUniform, camera},
        outline::outline,
        project::{Splats, splat},
        sort::{COLUMN, Len, Pairs, column, scan, sort},
        step_counters::{Capacity, StepCounters, step_counters},
    },
};
use specula_core::camera::Camera;

uniform! {
    /// Gaussians whose pairs are counted.
    struct Measured {
        count: u32,
        /// Capacity for tile-splat pairs, and the key of Gaussians that are not drawn.
        pairs_max: u32,
        not_drawn: u32,
    }
}

uniform! {
    /// Gaussians whose depths are sorted.
    struct Depths {
        count: u32,
        /// Key of Gaussians that are not drawn.
        not_drawn: u32,
    }
}

pub(crate) fn measure_source() -> String {
    let source = Source::new().part(splat).part(column).part(step_counters);
    source.uniform::<Measured>().with(include_str!("measure.wgsl")).text()
}

pub(crate) fn depth_source() -> String {
    Source::new().part(splat).part(step_counters).uniform::<Depths>().with(include_str!("depths.wgsl")).text()
}

pub(crate) fn emit_source() -> String {
    let source = Source::new().part(camera).part(splat).part(outline).part(step_counters);
    source.with(include_str!("bin.wgsl")).text()
}

pub(crate) fn range_source() -> String {
    Source::new().part(step_counters).with(include_str!("ranges.wgsl")).text()
}

/// Splats of each tile, front to back.
#[derive(Debug)]
pub struct Tiles {
    /// Range of each tile's splats in `gaussians`: the first, and one past the last.
    pub(crate) ranges: Array,
    /// Gaussians of the splats of all tiles, tile after tile.
    pub(crate) gaussians: Array,
    /// Capacity of `gaussians`.
    pub(crate) count_max: usize,
    /// Emission index of each splat of each tile; pairs are emitted Gaussian after Gaussian, front
    /// to back.
    pub(crate) emissions: Array,
    /// All Gaussians, front to back, then those that are not drawn.
    pub(crate) order: Array,
    /// First emission index of each Gaussian in that order, and one past the last.
    pub(crate) offsets: Array,
}

/// Sorts splats into tiles with a given capacity. Without one, blocks until the device has counted
/// the pairs.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`]; [`GpuError::TooLarge`] for more pairs than
/// 32 bits count.
pub(crate) fn bin(
    context: &mut Context,
    counters: &StepCounters,
    splats: &Splats,
    camera: &Camera,
    capacity: Option<Capacity>,
) -> Result<Tiles, GpuError> {
    let view = CameraUniform::new(camera, splats.count);
    let capacity = measure(context, counters, splats, capacity)?;
    let count_max = capacity.pairs;
    let order = depth_order(context, counters, splats, capacity.depth_bits)?;
    let offsets = context.allocate("offsets", splats.count + 1)?;
    let pairs = Pairs {
        keys: context.allocate("tiles of splats", count_max)?,
        items: context.allocate("numbers of splats", count_max)?,
    };
    let emitted = context.allocate("splats of tiles", count_max)?;
    let bindings = [
        Uniform(view.bytes()),
        Buffer(&splats.splats),
        Buffer(&order),
        Buffer(&splats.tile_counts),
        Buffer(&offsets),
        Buffer(&pairs.keys),
        Buffer(&pairs.items),
        Buffer(&emitted),
        Buffer(counters.array()),
    ];
    context.dispatch("bin", "counts_in_order", &emit_source, &bindings, Dispatch::Invocations(splats.count + 1))?;
    scan(context, &offsets, splats.count + 1)?;
    context.dispatch("bin", "emit", &emit_source, &bindings, Dispatch::Invocations(splats.count))?;
    let tile_bits = (view.tile_count() as u32).next_power_of_two().ilog2();
    let Pairs { keys, items: emissions } = sort(context, counters, pairs, Len::Counted(count_max), tile_bits)?;

    let ranges = context.zeros("tiles", 2 * view.tile_count())?;
    let gaussians = context.allocate("splats of tiles", count_max)?;
    let bindings = [
        Buffer(counters.array()),
        Buffer(&keys),
        Buffer(&emissions),
        Buffer(&emitted),
        Buffer(&ranges),
        Buffer(&gaussians),
    ];
    context.dispatch("ranges", "find_ranges", &range_source, &bindings, Dispatch::Invocations(count_max))?;
    Ok(Tiles { ranges, gaussians, count_max, emissions, order, offsets })
}

/// Counts the pairs and the range of depths, and compares them with the capacity; returns the
/// capacity.
fn measure(
    context: &mut Context,
    counters: &StepCounters,
    splats: &Splats,
    capacity: Option<Capacity>,
) -> Result<Capacity, GpuError> {
    counters.reset_image(context)?;
    let run = |context: &mut Context, entry: &'static str, capacity: Capacity, size: Dispatch| {
        let measured = Measured {
            count: splats.count as u32,
            pairs_max: capacity.pairs as u32,
            not_drawn: not_drawn(capacity.depth_bits),
        };
        let bindings = [
            Uniform(measured.bytes()),
            Buffer(&splats.depth_keys),
            Buffer(&splats.tile_counts),
            Buffer(counters.array()),
        ];
        context.dispatch("measure", entry, &measure_source, &bindings, size)
    };
    run(context, "measure", Capacity::default(), Dispatch::Invocations(splats.count.div_ceil(COLUMN)))?;
    let capacity = match capacity {
        Some(capacity) => capacity,
        None => counters.read(context)?.required(&context.gpu)?,
    };
    run(context, "settle", capacity, Dispatch::Workgroups(1))?;
    Ok(capacity)
}

/// Key of Gaussians that are not drawn: the largest of `depth_bits`.
fn not_drawn(depth_bits: u32) -> u32 {
    u32::MAX >> (u32::BITS - depth_bits.max(1))
}

/// All Gaussians, front to back, ties in their order, followed by those that are not drawn. Sorts
/// only by bits in which depths differ.
fn depth_order(
    context: &mut Context,
    counters: &StepCounters,
    splats: &Splats,
    depth_bits: u32,
) -> Result<Array, GpuError> {
    let count = splats.count;
    let pairs = Pairs { keys: context.allocate("depths", count)?, items: context.allocate("order", count)? };
    let depths = Depths { count: count as u32, not_drawn: not_drawn(depth_bits) };
    let bindings = [
        Uniform(depths.bytes()),
        Buffer(&splats.depth_keys),
        Buffer(&pairs.keys),
        Buffer(&pairs.items),
        Buffer(counters.array()),
    ];
    context.dispatch("depths", "shorten", &depth_source, &bindings, Dispatch::Invocations(count))?;
    Ok(sort(context, counters, pairs, Len::Known(count), depth_bits)?.items)
}
