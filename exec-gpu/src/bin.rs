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
    sort::{Pairs, scan, sort},
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
    /// Numbers of the splats of all tiles when they were emitted, Gaussian after Gaussian from front to back.
    pub(crate) emissions: Array,
    /// All Gaussians from front to back, then those that are not drawn.
    pub(crate) order: Array,
    /// First emission of each Gaussian in that order, and one past the last.
    pub(crate) offsets: Array,
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
    let none_yet = Emitted::take(machine, 0)?;
    let counting = none_yet.bound(&view, splats, &order, &offsets);
    machine.run("bin", "counts_in_order", &source::bin, &counting, Groups::For(splats.count + 1))?;
    scan(machine, &offsets, splats.count + 1)?;
    let count = machine.download_count(&offsets, splats.count)? as usize;

    let emitted = Emitted::take(machine, count)?;
    let emitting = emitted.bound(&view, splats, &order, &offsets);
    machine.run("bin", "emit", &source::bin, &emitting, Groups::For(splats.count))?;
    let Emitted { pairs, gaussians: emitted } = emitted;
    let tile_bits = (view.tile_count() as u32).next_power_of_two().ilog2();
    let Pairs { keys, items: emissions } = sort(machine, pairs, count, tile_bits)?;

    let ranges = machine.zeros("tiles", 2 * view.tile_count())?;
    let gaussians = machine.take("splats of tiles", count)?;
    let size = [count as u32];
    let bound =
        [Uniform(bytemuck::cast_slice(&size)), Of(&keys), Of(&emissions), Of(&emitted), Of(&ranges), Of(&gaussians)];
    machine.run("ranges", "find_ranges", &source::ranges, &bound, Groups::For(count))?;
    Ok(Tiles { ranges, gaussians, count, emissions, order, offsets })
}

/// One element for each tile of each splat.
struct Emitted {
    /// Tiles, and numbers of the elements.
    pairs: Pairs,
    /// The Gaussian of each.
    gaussians: Array,
}

impl Emitted {
    fn take(machine: &Machine, count: usize) -> Result<Self, GpuError> {
        let keys = machine.take("tiles of splats", count)?;
        let items = machine.take("numbers of splats", count)?;
        Ok(Self { pairs: Pairs { keys, items }, gaussians: machine.take("splats of tiles", count)? })
    }

    fn bound<'a>(
        &'a self,
        view: &'a View,
        splats: &'a Splats,
        order: &'a Array,
        offsets: &'a Array,
    ) -> [crate::kernel::Bound<'a>; 8] {
        [
            Uniform(view.bytes()),
            Of(&splats.splats),
            Of(order),
            Of(&splats.tile_counts),
            Of(offsets),
            Of(&self.pairs.keys),
            Of(&self.pairs.items),
            Of(&self.gaussians),
        ]
    }
}

/// All Gaussians, front to back, ties in their order; behind them those that are not drawn.
fn depth_order(machine: &mut Machine, splats: &Splats) -> Result<Array, GpuError> {
    let numbers: Vec<u32> = (0..splats.count as u32).collect();
    let items = machine.upload("numbers", &numbers)?;
    let keys = machine.copy("depths", &splats.depth_keys)?;
    Ok(sort(machine, Pairs { keys, items }, splats.count, u32::BITS)?.items)
}
