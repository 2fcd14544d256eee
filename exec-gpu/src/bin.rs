//! Splats to tiles: by depth, then by tile.

use crate::{
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    project::Splats,
    sort::{Pairs, numbers, scan, sort},
    source,
    view::View,
};
use specula_core::camera::Camera;

/// Which splats each tile holds, front to back.
#[derive(Debug)]
pub struct Tiles {
    /// First of each tile's splats in `gaussians`, and one past the last.
    pub(crate) ranges: Array,
    /// Splats of all tiles, tile after tile.
    pub(crate) gaussians: Array,
    /// How many there are.
    pub(crate) count: usize,
}

impl Tiles {
    /// How many pairs of a tile and a splat there are.
    pub fn intersection_count(&self) -> usize {
        self.count
    }
}

pub(crate) fn bin(machine: &mut Machine, splats: &Splats, camera: &Camera) -> Result<Tiles, GpuError> {
    let view = View::new(camera, splats.count);
    let order = depth_order(machine, splats)?;
    let offsets = machine.take("offsets", splats.count + 1)?;
    // Not yet known, and not yet written.
    let nothing = machine.take("nothing", 1)?;
    let none_yet = Pairs { keys: nothing, items: machine.take("nothing", 1)? };
    let counting = bound(&view, splats, &order, &offsets, &none_yet);
    machine.run("bin", "counts_in_order", &source::bin, &counting, Groups::For(splats.count + 1))?;
    scan(machine, &offsets, splats.count + 1)?;
    let count = machine.download_count(&offsets, splats.count)? as usize;

    let emitted =
        Pairs { keys: machine.take("tiles of splats", count)?, items: machine.take("splats of tiles", count)? };
    let emitting = bound(&view, splats, &order, &offsets, &emitted);
    machine.run("bin", "emit", &source::bin, &emitting, Groups::For(splats.count))?;
    let tile_bits = (view.tile_count() as u32).next_power_of_two().ilog2();
    let Pairs { keys, items } = sort(machine, emitted, count, tile_bits)?;

    let ranges = machine.zeros("tiles", 2 * view.tile_count())?;
    let size = [count as u32];
    let bound = [Uniform(bytemuck::cast_slice(&size)), Of(&keys), Of(&ranges)];
    machine.run("ranges", "find_ranges", &source::ranges, &bound, Groups::For(count))?;
    Ok(Tiles { ranges, gaussians: items, count })
}

fn bound<'a>(
    view: &'a View,
    splats: &'a Splats,
    order: &'a Array,
    offsets: &'a Array,
    emitted: &'a Pairs,
) -> [crate::kernel::Bound<'a>; 7] {
    [
        Uniform(view.bytes()),
        Of(&splats.splats),
        Of(order),
        Of(&splats.tile_counts),
        Of(offsets),
        Of(&emitted.keys),
        Of(&emitted.items),
    ]
}

/// All Gaussians, front to back, ties in their order; behind them those that are not drawn.
fn depth_order(machine: &mut Machine, splats: &Splats) -> Result<Array, GpuError> {
    let items = numbers(machine, "numbers", splats.count)?;
    let keys = machine.copy("depths", &splats.depth_keys)?;
    Ok(sort(machine, Pairs { keys, items }, splats.count, u32::BITS)?.items)
}
