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
    source::{self, COLUMN},
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
    let measures = Measures::new(machine, splats)?;
    let count = measures.intersections as usize;
    let order = depth_order(machine, splats, &measures)?;
    let offsets = machine.take("offsets", splats.count + 1)?;
    let pairs =
        Pairs { keys: machine.take("tiles of splats", count)?, items: machine.take("numbers of splats", count)? };
    let emitted = machine.take("splats of tiles", count)?;
    let bound = [
        Uniform(view.bytes()),
        Of(&splats.splats),
        Of(&order),
        Of(&splats.tile_counts),
        Of(&offsets),
        Of(&pairs.keys),
        Of(&pairs.items),
        Of(&emitted),
    ];
    machine.run("bin", "counts_in_order", &source::bin, &bound, Groups::For(splats.count + 1))?;
    scan(machine, &offsets, splats.count + 1)?;
    machine.run("bin", "emit", &source::bin, &bound, Groups::For(splats.count))?;
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

/// What must be known of splats before they are sorted.
struct Measures {
    /// Key of the nearest depth.
    nearest: u32,
    /// Key of the furthest; nothing is drawn if it is nearer.
    furthest: u32,
    /// How many pairs of a tile and a splat there are.
    intersections: u32,
}

impl Measures {
    fn new(machine: &mut Machine, splats: &Splats) -> Result<Self, GpuError> {
        let measures = machine.upload("measures", &[u32::MAX, 0, 0])?;
        let size = [splats.count as u32];
        let bound =
            [Uniform(bytemuck::cast_slice(&size)), Of(&splats.depth_keys), Of(&splats.tile_counts), Of(&measures)];
        let columns = splats.count.div_ceil(COLUMN);
        machine.run("measure", "measure", &source::measure, &bound, Groups::For(columns))?;
        let mut found = [0; 3];
        machine.download(&measures, 0, &mut found)?;
        let [nearest, furthest, intersections] = found;
        Ok(Self { nearest, furthest, intersections })
    }
}

/// All Gaussians, front to back, ties in their order; behind them those that are not drawn. Sorts by no more bits than
/// their depths differ in.
fn depth_order(machine: &mut Machine, splats: &Splats, measures: &Measures) -> Result<Array, GpuError> {
    let (count, nearest) = (splats.count, measures.nearest.min(measures.furthest));
    let not_drawn = measures.furthest - nearest + 1;
    let pairs = Pairs { keys: machine.take("depths", count)?, items: machine.take("order", count)? };
    let settings = [count as u32, nearest, not_drawn];
    let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(&splats.depth_keys), Of(&pairs.keys), Of(&pairs.items)];
    machine.run("depths", "shorten", &source::depths, &bound, Groups::For(count))?;
    Ok(sort(machine, pairs, count, u32::BITS - not_drawn.leading_zeros())?.items)
}
