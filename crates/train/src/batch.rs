//! Batches of views: gradients at the same parameters, which ranks can compute in parallel.
//!
//! Adam then takes a step for each of them in the order of the views, as if they were visited one
//! after another; the only difference is that gradients are up to B − 1 steps old. Rates and
//! moments are those of single views, so no scaling rule is needed.

use crate::{
    profile::{Densification, Profile},
    transfer::{download, download_gaussians},
};
use specula_core::{
    executor::{Executor, StepReport, TrainingStep},
    optimise::Schedule,
    pipeline::{ViewGradient, view_gradient},
    scene::{Environment, Gaussians},
    state::{SceneState, Statistics},
};

impl Profile {
    /// Profile for batches of views, from the profile of a training that visits the same number of
    /// views, one per step: counts of views become counts of batches. Learning rates are unchanged,
    /// because Adam takes a step for each view; 1 changes nothing.
    #[must_use]
    pub fn for_batches(mut self, views: u32) -> Self {
        let views = views.max(1);
        if views == 1 {
            return self;
        }
        let steps = |count: u32| (count.saturating_add(views / 2) / views).max(count.min(1));
        let rate = |schedule: Schedule| Schedule { steps: steps(schedule.steps), ..schedule };
        self.rates = self.rates.map(rate);
        self.exposure = self.exposure.map(rate);
        let Densification { from, until, every, reset_every, .. } = self.densification;
        self.densification = Densification {
            from: steps(from),
            until: steps(until),
            every: steps(every),
            reset_every: steps(reset_every),
            ..self.densification
        };
        self.views_per_step *= views;
        self
    }
}

/// Settings of Adam's steps for the views of a batch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Updates<'a> {
    /// Number of views, of all ranks together.
    pub(crate) views: usize,
    /// Number of the first step of Adam.
    pub(crate) first: u64,
    /// Learning rate of every plane.
    pub(crate) rates: &'a [f32],
    /// Learning rate of the light.
    pub(crate) environment_rate: f32,
    /// Largest radiance that the light keeps.
    pub(crate) radiance_max: f32,
    /// Whether the views add to the statistics of densification.
    pub(crate) is_observed: bool,
}

impl Updates<'_> {
    /// Number of the step for the view at a position.
    pub(crate) fn number(&self, position: usize) -> u32 {
        u32::try_from(self.first + position as u64).unwrap_or(u32::MAX)
    }
}

/// Takes a step of Adam for each of several views, in their order, against gradients at the
/// parameters before the first. Returns the report of each view; the last counts the gradients that
/// were skipped.
///
/// # Errors
///
/// The error of the stage that failed.
pub(crate) fn batch_step<E: Executor>(
    exec: &mut E,
    scene: &mut SceneState<E::Array>,
    views: &[TrainingStep<'_, E>],
    updates: &Updates<'_>,
) -> Result<Vec<StepReport>, E::Error> {
    let (gaussians, light) = copied_parameters(exec, scene)?;
    let mut reports = Vec::with_capacity(views.len());
    let mut nonfinite = 0;
    for (position, view) in views.iter().enumerate() {
        let (grad, report) = gradient_of(exec, &gaussians, light.as_ref(), view)?;
        nonfinite += apply(exec, scene, grad, updates, position)?;
        reports.push(report);
    }
    if let Some(last) = reports.last_mut() {
        last.nonfinite = nonfinite;
    }
    Ok(reports)
}

/// Gaussians and light before a batch.
type Parameters<A> = (Gaussians<A>, Option<Environment<A>>);

fn copied_parameters<E: Executor>(
    exec: &mut E,
    scene: &SceneState<E::Array>,
) -> Result<Parameters<E::Array>, E::Error> {
    let gaussians = download_gaussians(exec, &scene.gaussians)?;
    let gaussians = exec.upload_gaussians(&gaussians)?;
    let Some((light, _)) = &scene.light else { return Ok((gaussians, None)) };
    let values = download(exec, &light.values, light.len_of_values())?;
    Ok((gaussians, Some(light.with_values(exec.upload(&values)?))))
}

/// Gradient of one view of a batch, with its contribution to the statistics.
pub(crate) fn gradient_of<E: Executor>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&Environment<E::Array>>,
    view: &TrainingStep<'_, E>,
) -> Result<(ViewGradient<E::Array>, StepReport), E::Error> {
    let statistics = if view.is_observed { Some(no_statistics(exec, gaussians.count)?) } else { None };
    view_gradient(exec, gaussians, light, statistics, view)
}

fn no_statistics<E: Executor>(exec: &mut E, count: usize) -> Result<Statistics<E::Array>, E::Error> {
    let zeros = vec![0.0; count];
    Ok(Statistics { grad_sum: exec.upload(&zeros)?, view_count: exec.upload(&zeros)? })
}

fn add_statistics<E: Executor>(
    exec: &mut E,
    sum: &mut Statistics<E::Array>,
    share: &Statistics<E::Array>,
) -> Result<(), E::Error> {
    exec.add(&mut sum.grad_sum, &share.grad_sum)?;
    exec.add(&mut sum.view_count, &share.view_count)
}

/// Takes Adam's step against the gradient of the view at a position, and adds its statistics to
/// those of the scene. Returns the number of skipped gradient entries that were not finite.
pub(crate) fn apply<E: Executor>(
    exec: &mut E,
    scene: &mut SceneState<E::Array>,
    grad: ViewGradient<E::Array>,
    updates: &Updates<'_>,
    position: usize,
) -> Result<usize, E::Error> {
    let SceneState { gaussians, moments, statistics, light } = scene;
    let Updates { rates, environment_rate, radiance_max, .. } = *updates;
    let number = updates.number(position);
    if let Some(share) = &grad.statistics {
        add_statistics(exec, statistics, share)?;
    }
    exec.optimise(gaussians, moments, grad.gaussians, rates, number)?;
    if let (Some((environment, moments)), Some(grad)) = (light, grad.light) {
        exec.optimise_environment(environment, moments, grad, environment_rate, radiance_max, number)?;
    }
    // Nothing is binned here, so no step has to be repeated.
    Ok(exec.report()?.map_or(0, |report| report.nonfinite))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        profile::{NAMES, by_name, exposure_rate},
        start::Point,
        trainer::{Settings, Trainer},
        view::View,
    };
    use glam::Vec3;
    use specula_core::{camera::Camera, scene::OPACITY};
    use specula_cpu::CpuExecutor;

    /// Two steps of Adam against one gradient move a number by its rate each, since both moments
    /// are corrected for the start; one step against a sum would move it by that rate once.
    #[test]
    fn a_batch_takes_a_step_of_adam_for_each_view() {
        /// Relative rounding of the corrected rate and of both moments.
        const ROUNDING: f32 = 1e-4;
        const BATCH: u32 = 2;
        let camera = Camera::look_at(Vec3::X * 3.0, Vec3::ZERO, Vec3::Z, 0.7, 32, 32);
        let views = [View { name: "one".into(), camera, rgba: vec![200; 32 * 32 * 4], unclipped: None, normals: None }];
        let points = [0.0, 0.2].map(|z| Point { position: [0.0, 0.0, z], color: [0.5; 3] });
        let moved = |batch: u32| {
            let profile = by_name("3dgs", 100 * batch).expect("a profile").for_batches(batch);
            let settings = Settings { profile, iterations: 100, seed: 0, background: [1.0; 3], random_points: 0 };
            let mut trainer = Trainer::new(CpuExecutor::new(), settings, &views, &points).expect("there is a view");
            let mut opacity = || {
                let gaussians = trainer.download().expect("the CPU gives back").gaussians;
                let value = gaussians.values[gaussians.index_of(0, OPACITY)];
                trainer.step().expect("the CPU trains");
                value
            };
            (opacity() - opacity()).abs()
        };
        let rate = by_name("3dgs", 100).expect("a profile").rates.opacity.first;
        for batch in [1, BATCH] {
            let expected = batch as f32 * rate;
            assert!((moved(batch) - expected).abs() < ROUNDING * expected, "{} is not {expected}", moved(batch));
        }
    }

    #[test]
    fn single_views_change_no_profile() {
        for name in NAMES {
            let profile = by_name(name, 7000).expect("a profile");
            assert_eq!(profile.clone().for_batches(1), profile);
        }
    }

    #[test]
    fn batches_count_views_in_steps_and_keep_the_rates() {
        let mut single = by_name("specula", 7000).expect("a profile");
        single.exposure = Some(exposure_rate(7000));
        let batched = single.clone().for_batches(4);
        assert_eq!(batched.views_per_step, 4);
        let Densification { from, until, every, reset_every, grad_min, .. } = batched.densification;
        assert_eq!((from, until, every, reset_every, grad_min), (125, 875, 25, 750, single.densification.grad_min));
        let (batched_rate, single_rate) = (batched.rates.mean, single.rates.mean);
        let expected = (single_rate.first, single_rate.last, single_rate.steps / 4);
        assert_eq!((batched_rate.first, batched_rate.last, batched_rate.steps), expected);
        assert_eq!(batched.rates.tint, single.rates.tint, "constant rates are unchanged");
        let [batched_rate, single_rate] = [batched.exposure, single.exposure].map(|rate| rate.expect("it is learned"));
        assert_eq!((batched_rate.first, batched_rate.steps), (single_rate.first, 1750));
    }

    #[test]
    fn intervals_do_not_become_zero_and_zeros_stay() {
        let mut profile = by_name("paper", 100).expect("a profile");
        (profile.densification.every, profile.densification.reset_every) = (3, 0);
        let Densification { every, reset_every, .. } = profile.for_batches(64).densification;
        assert_eq!((every, reset_every), (1, 0));
    }
}
