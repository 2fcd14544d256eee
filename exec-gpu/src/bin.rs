//! Splats to tiles: by depth, then by tile.

use crate::{
    device::GpuError,
    executor::GpuExecutor,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    ledger::{Ledger, Room},
    machine::Machine,
    memory::Array,
    project::Splats,
    sort::{Len, Pairs, scan, sort},
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
    /// How many there may be.
    pub(crate) count_max: usize,
    /// Numbers of the splats of all tiles when they were emitted, Gaussian after Gaussian from front to back.
    pub(crate) emissions: Array,
    /// All Gaussians from front to back, then those that are not drawn.
    pub(crate) order: Array,
    /// First emission of each Gaussian in that order, and one past the last.
    pub(crate) offsets: Array,
}

/// With this much room, or as much as it takes, if none is given; then it waits for the device.
pub(crate) fn bin(
    machine: &mut Machine,
    splats: &Splats,
    camera: &Camera,
    room: Option<Room>,
) -> Result<Tiles, GpuError> {
    let view = View::new(camera, splats.count);
    let (ledger, room) = (machine.ledger.clone(), measured(machine, splats, room)?);
    let count_max = room.pairs;
    let order = depth_order(machine, splats, room.depth_bits)?;
    let offsets = machine.take("offsets", splats.count + 1)?;
    let pairs = Pairs {
        keys: machine.take("tiles of splats", count_max)?,
        items: machine.take("numbers of splats", count_max)?,
    };
    let emitted = machine.take("splats of tiles", count_max)?;
    let bound = [
        Uniform(view.bytes()),
        Of(&splats.splats),
        Of(&order),
        Of(&splats.tile_counts),
        Of(&offsets),
        Of(&pairs.keys),
        Of(&pairs.items),
        Of(&emitted),
        Of(ledger.array()),
    ];
    machine.run("bin", "counts_in_order", &source::bin, &bound, Groups::For(splats.count + 1))?;
    scan(machine, &offsets, splats.count + 1)?;
    machine.run("bin", "emit", &source::bin, &bound, Groups::For(splats.count))?;
    let tile_bits = (view.tile_count() as u32).next_power_of_two().ilog2();
    let Pairs { keys, items: emissions } = sort(machine, pairs, Len::Held(count_max), tile_bits)?;

    let ranges = machine.zeros("tiles", 2 * view.tile_count())?;
    let gaussians = machine.take("splats of tiles", count_max)?;
    let bound = [Of(ledger.array()), Of(&keys), Of(&emissions), Of(&emitted), Of(&ranges), Of(&gaussians)];
    machine.run("ranges", "find_ranges", &source::ranges, &bound, Groups::For(count_max))?;
    Ok(Tiles { ranges, gaussians, count_max, emissions, order, offsets })
}

/// Notes in the ledger what must be known of splats before they are sorted, and whether there is room for it; gives the
/// room that there is.
fn measured(machine: &mut Machine, splats: &Splats, room: Option<Room>) -> Result<Room, GpuError> {
    let ledger = machine.ledger.clone();
    machine.write(ledger.array(), &Ledger::OF_A_PICTURE)?;
    let run = |machine: &mut Machine, entry: &'static str, room: Room, groups: Groups| {
        let size = [splats.count as u32, room.pairs as u32, not_drawn(room.depth_bits)];
        let bound =
            [Uniform(bytemuck::cast_slice(&size)), Of(&splats.depth_keys), Of(&splats.tile_counts), Of(ledger.array())];
        machine.run("measure", entry, &source::measure, &bound, groups)
    };
    run(machine, "measure", Room::default(), Groups::For(splats.count.div_ceil(COLUMN)))?;
    let room = match room {
        Some(room) => room,
        None => machine.entries()?.room(&machine.gpu)?,
    };
    run(machine, "settle", room, Groups::Count(1))?;
    Ok(room)
}

/// The largest key of so many bits: that of what is not drawn.
fn not_drawn(depth_bits: u32) -> u32 {
    u32::MAX >> (u32::BITS - depth_bits.max(1))
}

/// All Gaussians, front to back, ties in their order; behind them those that are not drawn. Sorts by no more bits than
/// their depths differ in.
fn depth_order(machine: &mut Machine, splats: &Splats, depth_bits: u32) -> Result<Array, GpuError> {
    let (count, ledger) = (splats.count, machine.ledger.clone());
    let pairs = Pairs { keys: machine.take("depths", count)?, items: machine.take("order", count)? };
    let settings = [count as u32, not_drawn(depth_bits)];
    let bound = [
        Uniform(bytemuck::cast_slice(&settings)),
        Of(&splats.depth_keys),
        Of(&pairs.keys),
        Of(&pairs.items),
        Of(ledger.array()),
    ];
    machine.run("depths", "shorten", &source::depths, &bound, Groups::For(count))?;
    Ok(sort(machine, pairs, Len::Known(count), depth_bits)?.items)
}

impl GpuExecutor {
    /// Gives steps of training room for so many pairs of a tile and a splat, until a report tells what they need.
    /// Results do not depend on it.
    pub fn make_room(&mut self, pairs: usize) {
        let depth_bits = self.machine.room.map_or(1, |room| room.depth_bits);
        self.machine.room = Some(Room { pairs, depth_bits });
    }
}
