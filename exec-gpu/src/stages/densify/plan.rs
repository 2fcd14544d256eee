//! Action of each Gaussian.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
        chunks::{Chunk, ChunkedArray},
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        densify::formulas::{Decide, MeasuresOf},
        gaussians::planes,
        sort::{Len, Pairs, iota, sort},
        step_counters::StepCounters,
    },
};
use specula_core::{
    densify::{Action, DensifyRules},
    executor::DensifyReport,
    scene::{Gaussians, Layout},
    state::Statistics,
};

/// Number of actions.
const ACTIONS: usize = 4;

uniform! {
    /// Thresholds, and the chunk: `count` Gaussians, the first of index `first`.
    struct Rules {
        first: u32,
        count: u32,
        grad_min: f32,
        split_scale: f32,
        opacity_min: f32,
        scale_max: f32,
    }
}

uniform! {
    /// Number of Gaussians, and of those that may grow.
    struct Growth {
        count: u32,
        growth_max: u32,
    }
}

/// Appends the numbers of the actions.
pub(crate) fn actions(source: Source) -> Source {
    source
        .count("KEEP", Action::Keep as usize)
        .count("CLONE", Action::Clone as usize)
        .count("SPLIT", Action::Split as usize)
        .count("PRUNE", Action::Prune as usize)
}

pub(crate) fn decision_source(layout: Layout) -> String {
    let source = Source::new().real().part(|source| planes(source, layout)).bits().part(actions);
    source.formula(&MeasuresOf { layout }).formula(&Decide).uniform::<Rules>().with(include_str!("decide.wgsl")).text()
}

pub(crate) fn limit_source() -> String {
    Source::new().part(actions).uniform::<Growth>().with(include_str!("limit_growth.wgsl")).text()
}

/// Action of each Gaussian.
pub(crate) struct DensifyPlan {
    /// An [`Action`] for each Gaussian.
    pub(crate) actions: Array,
    /// Number of Gaussians of each action.
    counts: [u32; ACTIONS],
}

impl DensifyPlan {
    /// Decides for all Gaussians.
    ///
    /// # Errors
    ///
    /// See [`Context::allocate`], [`Context::dispatch`] and [`Context::download`].
    pub(crate) fn new(
        context: &mut Context,
        counters: &StepCounters,
        gaussians: &Gaussians<ChunkedArray>,
        statistics: &Statistics<ChunkedArray>,
        rules: &DensifyRules,
        count_max: usize,
    ) -> Result<Self, GpuError> {
        let count = gaussians.count;
        let actions = context.allocate("actions", count)?;
        let growth_keys = context.allocate("gradients", count)?;
        let counts = context.zeros("counts", ACTIONS)?;
        decide_all(context, gaussians, statistics, rules, [&actions, &growth_keys, &counts])?;
        let mut plan = Self { actions, counts: [0; ACTIONS] };
        context.download(&counts, 0, &mut plan.counts)?;
        let growth_max = count_max.saturating_sub(count - plan.count(Action::Prune));
        if plan.count(Action::Clone) + plan.count(Action::Split) > growth_max {
            plan.limit_growth(context, counters, growth_keys, &counts, [count, growth_max])?;
        }
        Ok(plan)
    }

    /// Limits cloning and splitting to the `growth_max` Gaussians with the largest gradients.
    fn limit_growth(
        &mut self,
        context: &mut Context,
        counters: &StepCounters,
        keys: Array,
        counts: &Array,
        [count, growth_max]: [usize; 2],
    ) -> Result<(), GpuError> {
        let pairs = Pairs { keys, items: iota(context, "gradients", count)? };
        let order = sort(context, counters, pairs, Len::Known(count), u32::BITS)?.items;
        let growth = Growth { count: count as u32, growth_max: growth_max as u32 };
        let bindings = [Uniform(growth.bytes()), Buffer(&order), Buffer(&self.actions), Buffer(counts)];
        context.dispatch("densify", "limit_growth", &limit_source, &bindings, Dispatch::Invocations(count))?;
        context.download(counts, 0, &mut self.counts)
    }

    /// Number of Gaussians of an action.
    pub(crate) fn count(&self, action: Action) -> usize {
        self.counts[action as usize] as usize
    }

    /// Numbers of clones, splits and prunes.
    pub(crate) fn report(&self) -> DensifyReport {
        DensifyReport {
            cloned: self.count(Action::Clone),
            split: self.count(Action::Split),
            pruned: self.count(Action::Prune),
        }
    }
}

fn decide_all(
    context: &mut Context,
    gaussians: &Gaussians<ChunkedArray>,
    statistics: &Statistics<ChunkedArray>,
    rules: &DensifyRules,
    [actions, growth_keys, counts]: [&Array; 3],
) -> Result<(), GpuError> {
    let (count, layout) = (gaussians.count, gaussians.layout);
    let DensifyRules { grad_min, split_scale, opacity_min, scale_max } = *rules;
    let (key, source) = (format!("{layout:?}"), || decision_source(layout));
    for Chunk { gaussians, array } in gaussians.values.chunks(count) {
        let (first, count) = (gaussians.start as u32, gaussians.len() as u32);
        let rules = Rules { first, count, grad_min, split_scale, opacity_min, scale_max };
        let bindings = [
            Uniform(rules.bytes()),
            Buffer(array),
            Buffer(statistics.grad_sum.whole()),
            Buffer(statistics.view_count.whole()),
            Buffer(actions),
            Buffer(growth_keys),
            Buffer(counts),
        ];
        context.dispatch(&key, "decide_all", &source, &bindings, Dispatch::Invocations(gaussians.len()))?;
    }
    Ok(())
}
