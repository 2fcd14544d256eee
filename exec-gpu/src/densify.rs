//! What densification sees, and does: all of it where the Gaussians are, but for a few counts and the noise of parts.

use crate::{
    blend_vjp::SplatGrads,
    device::GpuError,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    project::Splats,
    sort::{Len, Pairs, numbers, scan, sort},
    source::{self, COLUMN},
    view::View,
};
use bytemuck::{Pod, Zeroable};
use specula_core::{
    camera::Camera,
    densify::{Action, DensifyRules, part_noise},
    executor::{DensifyReport, Moments, RandomKey, Statistics},
    order::CODE_BITS,
    scene::{Gaussians, Layout, len_of_values},
};

/// Adds the length of the gradient of each projected centre, where a Gaussian is drawn and that is finite.
pub(crate) fn observe(
    machine: &mut Machine,
    statistics: &mut Statistics<Array>,
    splats: &Splats,
    grads: &SplatGrads,
    camera: &Camera,
) -> Result<(), GpuError> {
    let view = View::new(camera, splats.count);
    let (channels, ledger) = (grads.channels, machine.ledger.clone());
    let bound = [
        Uniform(view.bytes()),
        Of(&splats.splats),
        Of(&grads.values),
        Of(&statistics.grad_sum),
        Of(&statistics.view_count),
        Of(ledger.array()),
    ];
    let source = || source::observe(channels);
    machine.run(&channels.to_string(), "observe", &source, &bound, Groups::For(splats.count))
}

/// Clones, splits and prunes, and brings Gaussians into the order of space.
pub(crate) fn densify(
    machine: &mut Machine,
    gaussians: &mut Gaussians<Array>,
    moments: &mut Moments<Array>,
    statistics: &mut Statistics<Array>,
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
    let grad_sum = machine.zeros("statistics", heirs.count)?;
    let view_count = machine.zeros("statistics", heirs.count)?;
    *moments = Moments { mean, square };
    *gaussians = Gaussians { count: heirs.count, layout: gaussians.layout, values };
    *statistics = Statistics { grad_sum, view_count };
    let report = fates.report();
    drop((fates, heirs));
    // Nothing will have the old size again.
    machine.forget_memory();
    Ok(report)
}

/// Limits one plane to at most `ceiling` and forgets its momentum.
pub(crate) fn limit_plane(
    machine: &mut Machine,
    gaussians: &mut Gaussians<Array>,
    moments: &mut Moments<Array>,
    plane: usize,
    ceiling: f32,
) -> Result<(), GpuError> {
    let Gaussians { count, layout, values } = gaussians;
    let settings = [*count as u32, plane as u32, ceiling.to_bits()];
    let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(values), Of(&moments.mean), Of(&moments.square)];
    let source = || source::limit_plane(*layout);
    machine.run(&format!("{layout:?}"), "limit_plane", &source, &bound, Groups::For(*count))
}

/// `Rules` of `densify.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Rules {
    count: u32,
    grad_min: f32,
    split_scale: f32,
    opacity_min: f32,
    scale_max: f32,
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
        gaussians: &Gaussians<Array>,
        statistics: &Statistics<Array>,
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
    gaussians: &Gaussians<Array>,
    statistics: &Statistics<Array>,
    rules: &DensifyRules,
    [actions, growth_keys, counts]: [&Array; 3],
) -> Result<(), GpuError> {
    let (count, layout) = (gaussians.count, gaussians.layout);
    let DensifyRules { grad_min, split_scale, opacity_min, scale_max } = *rules;
    let rules = Rules { count: count as u32, grad_min, split_scale, opacity_min, scale_max };
    let bound = [
        Uniform(bytemuck::bytes_of(&rules)),
        Of(&gaussians.values),
        Of(&statistics.grad_sum),
        Of(&statistics.view_count),
        Of(actions),
        Of(growth_keys),
        Of(counts),
    ];
    machine.run(&format!("{layout:?}"), "decide_all", &|| source::densify(layout), &bound, Groups::For(count))
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
    fn new(machine: &mut Machine, gaussians: &Gaussians<Array>, fates: &Fates) -> Result<Self, GpuError> {
        let (old_count, layout) = (gaussians.count, gaussians.layout);
        let split_count = fates.of(Action::Split);
        let count = fates.of(Action::Keep) + 2 * (fates.of(Action::Clone) + split_count);
        let places = machine.take("places", 3 * old_count)?;
        let split_parents = machine.take("places", split_count)?;
        let heirs = Pairs { keys: machine.take("codes", count)?, items: machine.take("heirs", count)? };
        let [low, high] = [f32::INFINITY, f32::NEG_INFINITY].map(ordered_bits);
        let bounds = machine.upload("bounds", &[low, low, low, high, high, high])?;
        let settings = [old_count as u32];
        let bound = [
            Uniform(bytemuck::cast_slice(&settings)),
            Of(&gaussians.values),
            Of(&fates.actions),
            Of(&places),
            Of(&bounds),
            Of(&heirs.keys),
            Of(&heirs.items),
            Of(&split_parents),
        ];
        let (key, source) = (format!("{layout:?}"), || source::densify_heirs(layout));
        machine.run(&key, "mark", &source, &bound, Groups::For(old_count))?;
        machine.run(&key, "find_bounds", &source, &bound, Groups::For(old_count.div_ceil(COLUMN)))?;
        scan(machine, &places, 3 * old_count)?;
        machine.run(&key, "put_heirs", &source, &bound, Groups::For(old_count))?;
        let heirs = sort(machine, heirs, Len::Known(count), CODE_BITS)?.items;
        Ok(Self { count, heirs, places, old_count, split_parents, split_count })
    }

    /// The numbers of the heirs from those of their parents; those of new ones are zero if they are not kept.
    fn gather(&self, machine: &mut Machine, layout: Layout, old: &Array, keeps_new: bool) -> Result<Array, GpuError> {
        let len = len_of_values(self.count, layout);
        let gathered = machine.take("Gaussians", len)?;
        let settings = [self.count as u32, len as u32, u32::from(keeps_new)];
        let bound = [Uniform(bytemuck::cast_slice(&settings)), Of(&self.heirs), Of(old), Of(&gathered)];
        let source = || source::densify_gather(layout);
        machine.run(&format!("{layout:?}"), "gather", &source, &bound, Groups::For(len))?;
        Ok(gathered)
    }

    /// Moves and shrinks the parts of what was split. The host draws the noise, the same as every executor.
    fn become_parts(
        &self,
        machine: &mut Machine,
        layout: Layout,
        values: &Array,
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
        let settings = [self.count as u32, self.old_count as u32];
        let bound =
            [Uniform(bytemuck::cast_slice(&settings)), Of(&self.heirs), Of(&self.places), Of(&noise), Of(values)];
        let source = || source::densify_parts(layout);
        machine.run(&format!("{layout:?}"), "become_parts", &source, &bound, Groups::For(self.count))
    }
}

/// Bits that sort as numbers do, as in `bits.wgsl`.
fn ordered_bits(x: f32) -> u32 {
    let bits = x.to_bits();
    if x.is_sign_negative() { !bits } else { bits | 1 << 31 }
}
