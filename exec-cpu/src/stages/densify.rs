//! Cloning, splitting and pruning.

use crate::{
    context::Context,
    lanes::Lanes,
    morton::{codes, gather},
    stages::{
        blend_vjp::SplatGrads,
        project::{BLOCKS_AT_ONCE, Splats},
    },
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    activation::sigmoid,
    camera::Camera,
    densify::{
        Action, DensifyRules, action, grad_length, largest_scale, mean_grad, split_log_scales, split_mean, split_noise,
    },
    executor::{DensifyReport, RandomKey},
    region::Ball,
    scene::{BLOCK, Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT},
    state::{AdamMoments, Statistics},
    vector::{Vec3, vec3},
};

/// Adds the length of the gradient of each projected centre, if the Gaussian is drawn and the
/// length is finite.
pub(crate) fn observe(
    context: &Context,
    statistics: &mut Statistics<Vec<f32>>,
    splats: &Splats,
    grads: &SplatGrads,
    camera: &Camera,
) {
    let half_size = [camera.width as f32 / 2.0, camera.height as f32 / 2.0];
    let Statistics { grad_sum, view_count } = statistics;
    let blocks = grad_sum.par_chunks_mut(BLOCK).zip(view_count.par_chunks_mut(BLOCK)).with_min_len(BLOCKS_AT_ONCE);
    blocks.enumerate().for_each(|(block, (sum, count))| {
        dispatch!(context.level, simd => {
            let lengths = grad_lengths(simd, grads.block(block), half_size);
            for (lane, (sum, count)) in sum.iter_mut().zip(count).enumerate() {
                if splats.is_drawn(block, lane) && lengths[lane].is_finite() {
                    *sum += lengths[lane];
                    *count += 1.0;
                }
            }
        });
    });
}

#[inline(always)]
fn grad_lengths<S: Simd>(simd: S, grads: &[f32], [half_width, half_height]: [f32; 2]) -> [f32; BLOCK] {
    let grad = [Lanes::load(simd, grads), Lanes::load(simd, &grads[BLOCK..])];
    grad_length(grad, [Lanes::splat(simd, half_width), Lanes::splat(simd, half_height)]).to_array()
}

/// Gaussian after densification: its parent, and its role.
#[derive(Clone, Copy)]
struct Child {
    parent: usize,
    origin: Origin,
}

#[derive(Clone, Copy, PartialEq)]
enum Origin {
    Kept,
    Cloned,
    /// First or second child of a split Gaussian.
    Split(u64),
}

pub(crate) fn densify(
    gaussians: &mut Gaussians<Vec<f32>>,
    moments: &mut AdamMoments<Vec<f32>>,
    statistics: &mut Statistics<Vec<f32>>,
    rules: &DensifyRules,
    count_max: usize,
    key: RandomKey,
) -> DensifyReport {
    let actions = decide_all(gaussians, statistics, rules, count_max);
    let (mut children, report) = children(&actions);
    let codes = codes(gaussians);
    children.sort_by_key(|child| codes[child.parent]);
    let from_parent = |old: &[f32], keep_new: bool| {
        let source = |index: usize| {
            let child: &Child = &children[index];
            (keep_new || child.origin == Origin::Kept).then_some(child.parent)
        };
        gather(gaussians, old, children.len(), source)
    };
    let (mean, square) = (from_parent(&moments.mean, false), from_parent(&moments.square, false));
    let values = from_parent(&gaussians.values, true);
    *moments = AdamMoments { mean, square };
    *gaussians = Gaussians { count: children.len(), layout: gaussians.layout, values };
    for (index, child) in children.iter().enumerate() {
        if let Origin::Split(sibling) = child.origin {
            sample_split_child(gaussians, index, key, 2 * child.parent as u64 + sibling);
        }
    }
    *statistics = Statistics { grad_sum: vec![0.0; children.len()], view_count: vec![0.0; children.len()] };
    report
}

fn decide_all(
    gaussians: &Gaussians<Vec<f32>>,
    statistics: &Statistics<Vec<f32>>,
    rules: &DensifyRules,
    count_max: usize,
) -> Vec<Action> {
    let mut actions: Vec<Action> = (0..gaussians.count)
        .into_par_iter()
        .map(|index| {
            let mean_grad = mean_grad(statistics.grad_sum[index], statistics.view_count[index]);
            let [opacity] = gaussians.get::<1>(index, OPACITY).map(sigmoid);
            action(rules, mean_grad, opacity, largest_scale(take3(gaussians.get(index, LOG_SCALE))))
        })
        .collect();
    limit_growth(&mut actions, statistics, count_max);
    actions
}

/// Limits the count to `count_max`: of all candidates for cloning and splitting, only those with
/// the largest gradients are refined.
fn limit_growth(actions: &mut [Action], statistics: &Statistics<Vec<f32>>, count_max: usize) {
    let kept = actions.iter().filter(|action| **action != Action::Prune).count();
    let growth_max = count_max.saturating_sub(kept);
    let grows = |action: &Action| matches!(action, Action::Clone | Action::Split);
    let mut growing: Vec<usize> = (0..actions.len()).filter(|index| grows(&actions[*index])).collect();
    if growing.len() <= growth_max {
        return;
    }
    let mean_grad = |index: usize| mean_grad(statistics.grad_sum[index], statistics.view_count[index]);
    growing.sort_by(|a, b| mean_grad(*b).total_cmp(&mean_grad(*a)).then(a.cmp(b)));
    growing[growth_max..].iter().for_each(|index| actions[*index] = Action::Keep);
}

/// The Gaussians after densification: kept ones in their order, then clones, then the children of
/// split ones.
fn children(actions: &[Action]) -> (Vec<Child>, DensifyReport) {
    let of = |wanted: Action| {
        actions.iter().enumerate().filter(move |(_, action)| **action == wanted).map(|(index, _)| index)
    };
    let stays = |action: &Action| matches!(action, Action::Keep | Action::Clone);
    let mut children: Vec<Child> = (0..actions.len())
        .filter(|index| stays(&actions[*index]))
        .map(|parent| Child { parent, origin: Origin::Kept })
        .collect();
    children.extend(of(Action::Clone).map(|parent| Child { parent, origin: Origin::Cloned }));
    children.extend(
        of(Action::Split).flat_map(|parent| [0, 1].map(|sibling| Child { parent, origin: Origin::Split(sibling) })),
    );
    let count = |wanted: Action| of(wanted).count();
    let report =
        DensifyReport { cloned: count(Action::Clone), split: count(Action::Split), pruned: count(Action::Prune) };
    (children, report)
}

fn sample_split_child(gaussians: &mut Gaussians<Vec<f32>>, index: usize, key: RandomKey, draw: u64) {
    let [mean, log_scales] = [MEAN, LOG_SCALE].map(|plane| take3(gaussians.get(index, plane)));
    let noise = take3(split_noise(key.seed, key.stream, draw));
    let mean = split_mean(mean, log_scales, gaussians.get(index, QUAT), noise);
    gaussians.set(index, MEAN, mean.to_array());
    gaussians.set(index, LOG_SCALE, split_log_scales(log_scales).to_array());
}

fn take3([x, y, z]: [f32; 3]) -> Vec3<f32> {
    vec3(x, y, z)
}

/// Clamps one plane to at most `ceiling` and resets its momentum: outside of a ball, or everywhere.
pub(crate) fn limit_plane(
    gaussians: &mut Gaussians<Vec<f32>>,
    moments: &mut AdamMoments<Vec<f32>>,
    plane: usize,
    ceiling: f32,
    outside: Option<Ball>,
) {
    for index in 0..gaussians.count {
        if outside.is_some_and(|ball| ball.contains(gaussians.get(index, MEAN))) {
            continue;
        }
        let index = gaussians.index_of(index, plane);
        gaussians.values[index] = gaussians.values[index].min(ceiling);
        moments.mean[index] = 0.0;
        moments.square[index] = 0.0;
    }
}
