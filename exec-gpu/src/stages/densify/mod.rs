//! Densification: Gaussians are cloned, split and pruned on the device; the host reads a few counts
//! and draws the random numbers of split Gaussians.

use crate::{
    device::{chunks::ChunkedArray, context::Context, error::GpuError},
    stages::step_counters::StepCounters,
};
use children::Children;
use plan::DensifyPlan;
use specula_core::{
    densify::DensifyRules,
    executor::{DensifyReport, RandomKey},
    scene::Gaussians,
    state::{AdamMoments, Statistics},
};

pub(crate) mod children;
pub mod formulas;
pub(crate) mod plan;

/// Clones, splits and prunes Gaussians, and sorts them into Morton order.
///
/// # Errors
///
/// See [`Context::allocate`], [`Context::dispatch`] and [`Context::download`].
pub(crate) fn densify(
    context: &mut Context,
    counters: &StepCounters,
    gaussians: &mut Gaussians<ChunkedArray>,
    moments: &mut AdamMoments<ChunkedArray>,
    statistics: &mut Statistics<ChunkedArray>,
    rules: &DensifyRules,
    count_max: usize,
    key: RandomKey,
) -> Result<DensifyReport, GpuError> {
    let plan = DensifyPlan::new(context, counters, gaussians, statistics, rules, count_max)?;
    let children = Children::new(context, counters, gaussians, &plan)?;
    let mean = children.gather(context, gaussians.layout, &moments.mean, false)?;
    let square = children.gather(context, gaussians.layout, &moments.square, false)?;
    let values = children.gather(context, gaussians.layout, &gaussians.values, true)?;
    children.sample_split_children(context, gaussians.layout, &values, key)?;
    let grad_sum = context.zeros("statistics", children.count())?.into();
    let view_count = context.zeros("statistics", children.count())?.into();
    *moments = AdamMoments { mean, square };
    *gaussians = Gaussians { count: children.count(), layout: gaussians.layout, values };
    *statistics = Statistics { grad_sum, view_count };
    let report = plan.report();
    drop((plan, children));
    // Arrays for the old number of Gaussians are no longer needed.
    context.free_unused_memory();
    Ok(report)
}
