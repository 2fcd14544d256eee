//! What densification sees, and does: all of it where the Gaussians are, but for a few counts and the noise of parts.

use crate::{
    blend_vjp::SplatGrads,
    device::GpuError,
    kernel::{
        Bound::{self, Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    pieces::{Piece, Pieces},
    project::Splats,
    sort::{Len, Pairs, numbers, scan, sort},
    source::{self, COLUMN},
    view::View,
};
use bytemuck::{Pod, Zeroable};
use specula_core::{
    camera::Camera,
    densify::{Action, DensifyRules, part_noise},
    executor::{DensifyReport, RandomKey},
    morton::CODE_BITS,
    region::Ball,
    scene::{Gaussians, Layout},
    state::{AdamMoments, Statistics},
};

/// Adds the length of the gradient of each projected centre, where a Gaussian is drawn and that is finite.
pub(crate) fn observe(
    machine: &mut Machine,
    statistics: &mut Statistics<Pieces>,
    splats: &Splats,
    grads: &SplatGrads,
    camera: &Camera,
) -> Result<(), GpuError> {
    let (channels, ledger) = (grads.channels, machine.ledger.clone());
    let (key, source) = (channels.to_string(), || source::observe(channels));
    for piece in grads.values.of(splats.count) {
        let view = View::of(camera, piece.gaussians.clone());
        let bound = [
            Uniform(view.bytes()),
            Of(&splats.splats),
            Of(piece.array),
            Of(statistics.grad_sum.whole()),
            Of(statistics.view_count.whole()),
            Of(ledger.array()),
        ];
        machine.run(&key, "observe", &source, &bound, Groups::For(piece.gaussians.len()))?;
    }
    Ok(())
}

/// Clones, splits and prunes, and brings Gaussians into the order of space.
pub(crate) fn densify(
    machine: &mut Machine,
    gaussians: &mut Gaussians<Pieces>,
    moments: &mut AdamMoments<Pieces>,
    statistics: &mut Statistics<Pieces>,
    rules: &DensifyRules,
    count_max: usize,
    key: RandomKey,
) -> Result<DensifyReport, GpuError> {
    let fates = Fates::new(machine, gaussians, statistics, rules, count_max)?;
    let heirs = Heirs::new(machine, gaussians, &fates)?;
    let mean = heirs.gather(machine, gaussians.layout, &moments.mean, false)?;
    let square = heirs.gather(machine, gaussians.layout, &moments.square, false)?;
    let values = heirs.gather(machine, gaussians.layout, &gaussians.values, true)?;
    heirs.become_parts(machine, gaussians.layout, &values, key)?;
    let grad_sum = machine.zeros("statistics", heirs.count)?.into();
    let view_count = machine.zeros("statistics", heirs.count)?.into();
    *moments = AdamMoments { mean, square };
    *gaussians = Gaussians { count: heirs.count, layout: gaussians.layout, values };
    *statistics = Statistics { grad_sum, view_count };
    let report = fates.report();
    drop((fates, heirs));
    // Nothing will have the old size again.
    machine.forget_memory();
    Ok(report)
}

/// Limits one plane to at most `ceiling` and forgets its momentum: outside of a ball, or everywhere.
pub(crate) fn limit_plane(
    machine: &mut Machine,
    gaussians: &mut Gaussians<Pieces>,
    moments: &mut AdamMoments<Pieces>,
    plane: usize,
    ceiling: f32,
    outside: Option<Ball>,
) -> Result<(), GpuError> {
    let Gaussians { count, layout, values } = gaussians;
    let (key, source) = (format!("{layout:?}"), || source::limit_plane(*layout));
    let arrays = Pieces::side_by_side([values, &moments.mean, &moments.square]);
    for (Piece { gaussians, .. }, [values, mean, square]) in values.of(*count).zip(arrays) {
        let limit = Limit::new(gaussians.len(), plane, ceiling, outside);
        let bound = [Uniform(bytemuck::bytes_of(&limit)), Of(values), Of(mean), Of(square)];
        machine.run(&key, "limit_plane", &source, &bound, Groups::For(gaussians.len()))?;
    }
    Ok(())
}

/// `Rules` of `densify.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Rules {
    first: u32,
    count: u32,
    grad_min: f32,
    split_scale: f32,
    opacity_min: f32,
    scale_max: f32,
}

/// `Limit` of `limit_plane.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Limit {
    center: [f32; 3],
    /// Negative where there is no ball: then everything lies outside.
    radius_squared: f32,
    count: u32,
    plane: u32,
    ceiling: f32,
    padding: u32,
}

impl Limit {
    fn new(count: usize, plane: usize, ceiling: f32, outside: Option<Ball>) -> Self {
        let (center, radius_squared) =
            outside.map_or(([0.0; 3], -1.0), |ball| (ball.center, ball.radius * ball.radius));
        Self { center, radius_squared, count: count as u32, plane: plane as u32, ceiling, padding: 0 }
    }
}

/// `Gathering` of `densify_gather.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Gathering {
    first: u32,
    end: u32,
    numbers: u32,
    keeps_new: u32,
    old_first: u32,
    old_end: u32,
}

/// How many there are of each action.
const ACTIONS: usize = 4;

/// What becomes of each Gaussian.
struct Fates {
    /// An [`Action`] for each.
    actions: Array,
    /// How many of each.
    counts: [u32; ACTIONS],
}

impl Fates {
    fn new(
        machine: &mut Machine,
        gaussians: &Gaussians<Pieces>,
        statistics: &Statistics<Pieces>,
        rules: &DensifyRules,
        count_max: usize,
    ) -> Result<Self, GpuError> {
        let count = gaussians.count;
        let actions = machine.take("actions", count)?;
        let growth_keys = machine.take("gradients", count)?;
        let counts = machine.zeros("counts", ACTIONS)?;
        decide_all(machine, gaussians, statistics, rules, [&actions, &growth_keys, &counts])?;
        let mut fates = Self { actions, counts: [0; ACTIONS] };
        machine.download(&counts, 0, &mut fates.counts)?;
        let room = count_max.saturating_sub(count - fates.of(Action::Prune));
        if fates.of(Action::Clone) + fates.of(Action::Split) > room {
            fates.limit_growth(machine, growth_keys, &counts, [count, room])?;
        }
        Ok(fates)
    }

    /// Of all that would grow, lets those with the largest gradients do.
    fn limit_growth(
        &mut self,
        machine: &mut Machine,
        keys: Array,
        counts: &Array,
        [count, room]: [usize; 2],
    ) -> Result<(), GpuError> {
        let pairs = Pairs { keys, items: numbers(machine, "gradients", count)? };
        let order = sort(machine, pairs, Len::Known(count), u32::BITS)?.items;
        let settings = [count as u32, room as u32];
        let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(&order), Of(&self.actions), Of(counts)];
        machine.run("densify", "limit_growth", &source::densify_limit, &bound, Groups::For(count))?;
        machine.download(counts, 0, &mut self.counts)
    }

    fn of(&self, action: Action) -> usize {
        self.counts[action as usize] as usize
    }

    fn report(&self) -> DensifyReport {
        DensifyReport { cloned: self.of(Action::Clone), split: self.of(Action::Split), pruned: self.of(Action::Prune) }
    }
}

fn decide_all(
    machine: &mut Machine,
    gaussians: &Gaussians<Pieces>,
    statistics: &Statistics<Pieces>,
    rules: &DensifyRules,
    [actions, growth_keys, counts]: [&Array; 3],
) -> Result<(), GpuError> {
    let (count, layout) = (gaussians.count, gaussians.layout);
    let DensifyRules { grad_min, split_scale, opacity_min, scale_max } = *rules;
    let (key, source) = (format!("{layout:?}"), || source::densify(layout));
    for Piece { gaussians, array } in gaussians.values.of(count) {
        let (first, count) = (gaussians.start as u32, gaussians.len() as u32);
        let rules = Rules { first, count, grad_min, split_scale, opacity_min, scale_max };
        let bound = [
            Uniform(bytemuck::bytes_of(&rules)),
            Of(array),
            Of(statistics.grad_sum.whole()),
            Of(statistics.view_count.whole()),
            Of(actions),
            Of(growth_keys),
            Of(counts),
        ];
        machine.run(&key, "decide_all", &source, &bound, Groups::For(gaussians.len()))?;
    }
    Ok(())
}

/// The Gaussians after densification, in the order of space.
struct Heirs {
    count: usize,
    /// The number of each heir's parent, and how the heir came about.
    heirs: Array,
    /// For each Gaussian whether it stayed, then whether it was copied, then whether it was split: the sums of those
    /// before.
    places: Array,
    old_count: usize,
    split_parents: Array,
    split_count: usize,
}

impl Heirs {
    fn new(machine: &mut Machine, gaussians: &Gaussians<Pieces>, fates: &Fates) -> Result<Self, GpuError> {
        let old_count = gaussians.count;
        let split_count = fates.of(Action::Split);
        let count = fates.of(Action::Keep) + 2 * (fates.of(Action::Clone) + split_count);
        let places = machine.take("places", 3 * old_count)?;
        let split_parents = machine.take("places", split_count)?;
        let heirs = Pairs { keys: machine.take("codes", count)?, items: machine.take("heirs", count)? };
        let [low, high] = [f32::INFINITY, f32::NEG_INFINITY].map(ordered_bits);
        let bounds = machine.upload("bounds", &[low, low, low, high, high, high])?;
        let bound = [&fates.actions, &places, &bounds, &heirs.keys, &heirs.items, &split_parents].map(Of);
        run_heirs(machine, "mark", gaussians, &bound, 1)?;
        run_heirs(machine, "find_bounds", gaussians, &bound, COLUMN)?;
        scan(machine, &places, 3 * old_count)?;
        run_heirs(machine, "put_heirs", gaussians, &bound, 1)?;
        let heirs = sort(machine, heirs, Len::Known(count), CODE_BITS)?.items;
        Ok(Self { count, heirs, places, old_count, split_parents, split_count })
    }

    /// The numbers of the heirs from those of their parents; those of new ones are zero if they are not kept.
    fn gather(&self, machine: &mut Machine, layout: Layout, old: &Pieces, keeps_new: bool) -> Result<Pieces, GpuError> {
        let gathered = machine.take_pieces("Gaussians", self.count, machine.division(layout.plane_count()))?;
        for new in gathered.of(self.count) {
            for old in old.of(self.old_count) {
                self.gather_piece(machine, layout, [&old, &new], keeps_new)?;
            }
        }
        Ok(gathered)
    }

    /// What goes from an old piece into a new one.
    fn gather_piece(
        &self,
        machine: &mut Machine,
        layout: Layout,
        [old, new]: [&Piece<'_>; 2],
        keeps_new: bool,
    ) -> Result<(), GpuError> {
        let gathering = Gathering {
            first: new.gaussians.start as u32,
            end: new.gaussians.end as u32,
            numbers: new.array.len() as u32,
            keeps_new: u32::from(keeps_new),
            old_first: old.gaussians.start as u32,
            old_end: old.gaussians.end as u32,
        };
        let bound = [Uniform(bytemuck::bytes_of(&gathering)), Of(&self.heirs), Of(old.array), Of(new.array)];
        let source = || source::densify_gather(layout);
        machine.run(&format!("{layout:?}"), "gather", &source, &bound, Groups::For(new.array.len()))
    }

    /// Moves and shrinks the parts of what was split. The host draws the noise, the same as every executor.
    fn become_parts(
        &self,
        machine: &mut Machine,
        layout: Layout,
        values: &Pieces,
        key: RandomKey,
    ) -> Result<(), GpuError> {
        if self.split_count == 0 {
            return Ok(());
        }
        let mut parents = vec![0_u32; self.split_count];
        machine.download(&self.split_parents, 0, &mut parents)?;
        let noise: Vec<f32> = parents
            .iter()
            .flat_map(|parent| [0, 1].map(|part| 2 * u64::from(*parent) + part))
            .flat_map(|draw| part_noise(key.seed, key.stream, draw))
            .collect();
        let noise = machine.upload("noise", &noise)?;
        let (key, source) = (format!("{layout:?}"), || source::densify_parts(layout));
        for Piece { gaussians, array } in values.of(self.count) {
            let settings = [gaussians.start, gaussians.len(), self.old_count].map(|number| number as u32);
            let bound =
                [Uniform(bytemuck::cast_slice(&settings)), Of(&self.heirs), Of(&self.places), Of(&noise), Of(array)];
            machine.run(&key, "become_parts", &source, &bound, Groups::For(gaussians.len()))?;
        }
        Ok(())
    }
}

/// Runs a kernel of `densify_heirs.wgsl` for every piece, an invocation for so many Gaussians.
fn run_heirs(
    machine: &mut Machine,
    entry: &'static str,
    gaussians: &Gaussians<Pieces>,
    others: &[Bound<'_>],
    each: usize,
) -> Result<(), GpuError> {
    let (count, layout) = (gaussians.count, gaussians.layout);
    let (key, source) = (format!("{layout:?}"), || source::densify_heirs(layout));
    for Piece { gaussians, array } in gaussians.values.of(count) {
        let settings = [count, gaussians.start, gaussians.len()].map(|number| number as u32);
        let mut bound = vec![Uniform(bytemuck::cast_slice(&settings)), Of(array)];
        bound.extend(others);
        machine.run(&key, entry, &source, &bound, Groups::For(gaussians.len().div_ceil(each)))?;
    }
    Ok(())
}

/// Bits that sort as numbers do, as in `bits.wgsl`.
fn ordered_bits(x: f32) -> u32 {
    let bits = x.to_bits();
    if x.is_sign_negative() { !bits } else { bits | 1 << 31 }
}
