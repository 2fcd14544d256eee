//! The optimisation loop.

use crate::{
    exposure::Exposures,
    profile::Profile,
    start::{Point, gaussians, random_points, rates_by_plane},
    view::{View, extent_of},
};
use specula_core::{
    activation::logit,
    camera::{Camera, near_of},
    densify::DensifyRules,
    executor::{AdamMoments, DensifyReport, Executor, RandomKey, Statistics, StepReport, TrainingStep},
    metrics::psnr,
    pipeline::{Fit, train_step},
    random,
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, OPACITY, RadianceActivation, TINT, len_of_values},
};

/// The raw tint of what reflects nothing: σ(−64) = 1.6e-28 is lost beside any colour, and gradients in its proportion are
/// lost beside Adam's ε of 1e-15, so that neither the tint nor the light takes a step for its sake.
pub const TINT_LOGIT_OFF: f32 = -64.0;

/// What a run is told.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The kind of training.
    pub profile: Profile,
    /// How many steps.
    pub iterations: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Behind the Gaussians, sRGB.
    pub background: [f32; 3],
    /// How many random points to start from where none are given.
    pub random_points: usize,
}

/// Why a run could not start or go on.
#[derive(Debug, thiserror::Error)]
pub enum TrainError<E> {
    /// There is nothing to learn from.
    #[error("a training needs at least one picture, and there is none")]
    NoViews,
    /// There is nothing to start from.
    #[error(
        "a training needs at least one point to start from, and there is none; give a point cloud or more random points"
    )]
    NoPoints,
    /// What was learned does not belong to the run that is to go on from it.
    #[error("what was learned is not of a training with these settings and views: {what}")]
    OtherRun {
        /// What does not fit.
        what: &'static str,
    },
    /// The executor failed.
    #[error(transparent)]
    Executor(#[from] E),
}

/// A run: a scene, what is known of its gradients, and the pictures that it is fitted to.
#[derive(Debug)]
pub struct Trainer<E: Executor> {
    exec: E,
    settings: Settings,
    /// Cameras and pictures at full size, and at half.
    pictures: [Vec<(Camera, E::Target)>; 2],
    extent: f32,
    gaussians: Gaussians<E::Array>,
    moments: AdamMoments<E::Array>,
    statistics: Statistics<E::Array>,
    light: Option<(Environment<E::Array>, AdamMoments<E::Array>)>,
    /// How the pictures were exposed, if that is learned.
    exposures: Option<Exposures>,
    /// Steps taken.
    iteration: u32,
    order: Vec<usize>,
    psnr: Option<f64>,
    nonfinite: usize,
}

impl<E: Executor> Trainer<E> {
    /// A run over these views that starts from these points, or from random ones if there are none.
    pub fn new(exec: E, settings: Settings, views: &[View], points: &[Point]) -> Result<Self, TrainError<E::Error>> {
        if views.is_empty() {
            return Err(TrainError::NoViews);
        }
        let random =
            if points.is_empty() { random_points(settings.random_points, views, settings.seed) } else { Vec::new() };
        let points = if points.is_empty() { &random } else { points };
        if points.is_empty() {
            return Err(TrainError::NoPoints);
        }
        let start = gaussians(points, &settings.profile, settings.seed);
        let light = start_light(&settings.profile);
        let exposures = settings.profile.exposure.map(|_| Exposures::start(views.len()));
        let mut trainer = Self::resume(exec, settings, views, &Snapshot::start(start, light, exposures))?;
        trainer.disable_background_specular()?;
        Ok(trainer)
    }

    /// A run that goes on from what another had learned, with the same settings and views; on the same kind of executor
    /// it goes on to the last bit.
    pub fn resume(
        mut exec: E,
        settings: Settings,
        views: &[View],
        snapshot: &Snapshot,
    ) -> Result<Self, TrainError<E::Error>> {
        if views.is_empty() {
            return Err(TrainError::NoViews);
        }
        snapshot.belongs_to(&settings, views.len()).map_err(|what| TrainError::OtherRun { what })?;
        let halved: Vec<View> = if settings.profile.coarse_until > 0.0 && all_can_be_halved(views) {
            views.iter().map(View::halved).collect()
        } else {
            Vec::new()
        };
        let extent = extent_of(views);
        let near = near_of(extent);
        let Snapshot { scene, moments, statistics, light_moments, exposures, iteration, order, psnr, nonfinite } =
            snapshot;
        let HostScene { gaussians, environment } = scene;
        let light = environment.as_ref().zip(light_moments.as_ref()).map(|(light, moments)| -> Result<_, E::Error> {
            let Environment { resolution, activation, ref values } = *light;
            let light = Environment { resolution, activation, values: exec.upload(values)? };
            Ok((light, upload_moments(&mut exec, moments)?))
        });
        let mut upload = |values| exec.upload_gaussians(&gaussians.with_values(values));
        Ok(Self {
            light: light.transpose()?,
            gaussians: upload(&gaussians.values)?,
            moments: AdamMoments { mean: upload(&moments.mean)?.values, square: upload(&moments.square)?.values },
            statistics: Statistics {
                grad_sum: exec.upload(&statistics.grad_sum)?,
                view_count: exec.upload(&statistics.view_count)?,
            },
            pictures: [upload_pictures(&mut exec, views, near)?, upload_pictures(&mut exec, &halved, near)?],
            extent,
            exposures: exposures.clone(),
            iteration: *iteration,
            order: order.clone(),
            psnr: *psnr,
            nonfinite: *nonfinite,
            settings,
            exec,
        })
    }

    /// Everything that the run has learned so far, on the host.
    pub fn snapshot(&mut self) -> Result<Snapshot, TrainError<E::Error>> {
        let scene = self.download()?;
        let moments = download_moments(&mut self.exec, &self.moments, scene.gaussians.values.len())?;
        let statistics = Statistics {
            grad_sum: download(&mut self.exec, &self.statistics.grad_sum, scene.gaussians.count)?,
            view_count: download(&mut self.exec, &self.statistics.view_count, scene.gaussians.count)?,
        };
        let light_moments = match &self.light {
            Some((light, moments)) => Some(download_moments(&mut self.exec, moments, light.len_of_values())?),
            None => None,
        };
        let Self { iteration, psnr, nonfinite, .. } = *self;
        let (exposures, order) = (self.exposures.clone(), self.order.clone());
        Ok(Snapshot { scene, moments, statistics, light_moments, exposures, iteration, order, psnr, nonfinite })
    }

    /// Takes one step, and densifies where the schedule says so.
    pub fn step(&mut self) -> Result<(StepReport, DensifyReport), TrainError<E::Error>> {
        self.iteration += 1;
        let view = self.next_view();
        let rules = self.rules_at(self.iteration, Channels::Training);
        let weights = self.settings.profile.weights_at(self.done(self.iteration));
        let profile = &self.settings.profile;
        let is_coarse = self.done(self.iteration) < profile.coarse_until;
        let pictures = &self.pictures[usize::from(is_coarse && !self.pictures[1].is_empty())];
        let (camera, target) = &pictures[view];
        let rates = rates_by_plane(profile.layout, &profile.rates, self.extent, self.iteration);
        let step = TrainingStep {
            camera,
            target,
            background: self.settings.background,
            exposure: self.exposures.as_ref().map(|exposures| &exposures.maps[view]),
            rules: &rules,
            weights: &weights,
            rates: &rates,
            environment_rate: profile.rates.environment.at(self.iteration),
            radiance_max: profile.light.map_or(f32::INFINITY, |light| light.radiance_max),
            number: self.iteration,
        };
        let mut fit = Fit {
            gaussians: &mut self.gaussians,
            moments: &mut self.moments,
            environment: self.light.as_mut().map(|(light, moments)| (light, moments)),
            statistics: &mut self.statistics,
        };
        let report = train_step(&mut self.exec, &mut fit, &step)?;
        self.note(&report);
        self.expose(view, &report);
        Ok((report, self.refine()?))
    }

    /// Pictures in a random order, each once before any comes again.
    fn next_view(&mut self) -> usize {
        if self.order.is_empty() {
            self.order = (0..self.pictures[0].len()).collect();
            for k in (1..self.order.len()).rev() {
                let other = random::bits(self.settings.seed, u64::from(self.iteration), k as u64) % (k as u64 + 1);
                self.order.swap(k, other as usize);
            }
        }
        self.order.pop().expect("the order was just filled")
    }

    fn note(&mut self, report: &StepReport) {
        const MEMORY: f64 = 0.98;
        let now = psnr(report.loss.squared.max(1e-10));
        self.psnr = Some(self.psnr.map_or(now, |mean| MEMORY * mean + (1.0 - MEMORY) * now));
        self.nonfinite += report.nonfinite;
    }

    /// Adam's step for the exposure of a picture. Pictures come in turns, so the number of the turn is that of its step.
    fn expose(&mut self, view: usize, report: &StepReport) {
        let turn = (self.iteration - 1) / self.pictures[0].len() as u32 + 1;
        let schedule = self.settings.profile.exposure;
        if let (Some(exposures), Some(grad), Some(schedule)) = (&mut self.exposures, &report.exposure, schedule) {
            self.nonfinite += exposures.step(view, grad, schedule.at(self.iteration), turn);
        }
    }

    /// How the scene is rendered at an iteration: harmonics come in band by band.
    pub fn rules_at(&self, iteration: u32, channels: Channels) -> RenderRules {
        let profile = &self.settings.profile;
        let done = self.done(iteration);
        let is_plain = !profile.layout.is_shaded();
        let bands = if done < profile.harmonics_from {
            None
        } else if profile.harmonics_step > 0.0 {
            Some(((done - profile.harmonics_from) / profile.harmonics_step) as u8)
        } else {
            Some(3)
        };
        let channels = if is_plain && channels == Channels::Training { Channels::Color } else { channels };
        RenderRules {
            sh_degree: bands.or(is_plain.then_some(0)).map(|bands| bands.min(3)),
            ..RenderRules::full(profile.shading, profile.scheme, channels)
        }
    }

    /// The share of the run that lies behind an iteration.
    fn done(&self, iteration: u32) -> f32 {
        iteration as f32 / self.settings.iterations.max(1) as f32
    }

    fn refine(&mut self) -> Result<DensifyReport, TrainError<E::Error>> {
        let plan = self.settings.profile.densification;
        let k = self.iteration;
        let mut report = DensifyReport::default();
        if k > plan.from && k < plan.until && k.is_multiple_of(plan.every) {
            let was_reset = plan.reset_every > 0 && k > plan.reset_every;
            let rules = DensifyRules {
                grad_min: plan.grad_min,
                split_scale: plan.split_share * self.extent,
                opacity_min: plan.opacity_min,
                scale_max: if was_reset { plan.prune_share * self.extent } else { f32::INFINITY },
            };
            let key = RandomKey { seed: self.settings.seed, stream: u64::from(k) };
            report = self.exec.densify(
                &mut self.gaussians,
                &mut self.moments,
                &mut self.statistics,
                &rules,
                plan.count_max,
                key,
            )?;
        }
        if plan.reset_every > 0 && k < plan.until && k.is_multiple_of(plan.reset_every) {
            self.exec.limit_plane(&mut self.gaussians, &mut self.moments, OPACITY, logit(0.01), None)?;
        }
        if k.is_multiple_of(plan.every) || k == self.settings.iterations {
            self.disable_background_specular()?;
        }
        Ok(report)
    }

    /// What lies outside of the foreground reflects nothing from here on.
    fn disable_background_specular(&mut self) -> Result<(), TrainError<E::Error>> {
        let Profile { layout, foreground, .. } = self.settings.profile;
        if layout.is_shaded() && foreground.is_some() {
            for plane in TINT..TINT + 3 {
                self.exec.limit_plane(&mut self.gaussians, &mut self.moments, plane, TINT_LOGIT_OFF, foreground)?;
            }
        }
        Ok(())
    }

    /// Steps taken so far.
    pub fn iteration(&self) -> u32 {
        self.iteration
    }
    /// Whether all steps are taken.
    pub fn is_finished(&self) -> bool {
        self.iteration >= self.settings.iterations
    }
    /// PSNR of the training pictures, in dB, a running mean.
    pub fn psnr(&self) -> Option<f64> {
        self.psnr
    }
    /// Gradients left out so far because they were not finite.
    pub fn nonfinite(&self) -> usize {
        self.nonfinite
    }
    /// The Gaussians now.
    pub fn gaussians(&self) -> &Gaussians<E::Array> {
        &self.gaussians
    }
    /// The light now, if there is one.
    pub fn environment(&self) -> Option<&Environment<E::Array>> {
        self.light.as_ref().map(|(light, _)| light)
    }
    /// How the pictures were exposed, in the order of the views, if that is learned.
    pub fn exposures(&self) -> Option<&Exposures> {
        self.exposures.as_ref()
    }
    /// What the run was told.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
    /// The executor, for rendering between steps.
    pub fn executor(&mut self) -> &mut E {
        &mut self.exec
    }

    /// The scene on the host: Gaussians, and the light if there is one.
    pub fn download(&mut self) -> Result<HostScene, TrainError<E::Error>> {
        let Gaussians { count, layout, .. } = self.gaussians;
        let values = download(&mut self.exec, &self.gaussians.values, len_of_values(count, layout))?;
        let mut environment = None;
        if let Some((light, _)) = &self.light {
            let values = download(&mut self.exec, &light.values, light.len_of_values())?;
            environment = Some(Environment { resolution: light.resolution, activation: light.activation, values });
        }
        Ok(HostScene { gaussians: Gaussians { count, layout, values }, environment })
    }
}

/// What a run has learned, on the host: enough for it to go on, on any executor.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Gaussians, and the light if there is one.
    pub scene: HostScene,
    /// Adam's moments of the Gaussians.
    pub moments: AdamMoments<Vec<f32>>,
    /// What densification has seen since it last acted, a number for each Gaussian.
    pub statistics: Statistics<Vec<f32>>,
    /// Adam's moments of the light.
    pub light_moments: Option<AdamMoments<Vec<f32>>>,
    /// How the pictures were exposed, if that is learned.
    pub exposures: Option<Exposures>,
    /// Steps that were taken.
    pub iteration: u32,
    /// Views that come before any comes again, the next one last.
    pub order: Vec<usize>,
    /// PSNR of the training pictures, in dB, a running mean.
    pub psnr: Option<f64>,
    /// Gradients left out so far because they were not finite.
    pub nonfinite: usize,
}

impl Snapshot {
    /// Before the first step.
    fn start(
        gaussians: Gaussians<Vec<f32>>,
        environment: Option<Environment<Vec<f32>>>,
        exposures: Option<Exposures>,
    ) -> Self {
        let zeros = |len: usize| AdamMoments { mean: vec![0.0; len], square: vec![0.0; len] };
        Self {
            moments: zeros(gaussians.values.len()),
            statistics: Statistics { grad_sum: vec![0.0; gaussians.count], view_count: vec![0.0; gaussians.count] },
            light_moments: environment.as_ref().map(|light| zeros(light.values.len())),
            scene: HostScene { gaussians, environment },
            exposures,
            iteration: 0,
            order: Vec::new(),
            psnr: None,
            nonfinite: 0,
        }
    }

    /// Whether a run with these settings and so many views can go on from here; if not, what does not fit.
    fn belongs_to(&self, settings: &Settings, view_count: usize) -> Result<(), &'static str> {
        let HostScene { gaussians: Gaussians { count, layout, values }, environment } = &self.scene;
        let profile = &settings.profile;
        let has_moments =
            |moments: &AdamMoments<Vec<f32>>, len: usize| [moments.mean.len(), moments.square.len()] == [len; 2];
        let is_light = match (environment, &self.light_moments, profile.light) {
            (Some(light), Some(moments), Some(start)) => {
                let len = light.len_of_values();
                (light.resolution, light.activation) == (start.resolution, start.activation)
                    && light.values.len() == len
                    && has_moments(moments, len)
            }
            (None, None, None) => true,
            _ => false,
        };
        let are_exposures = match (&self.exposures, profile.exposure) {
            (Some(exposures), Some(_)) => exposures.are_of(view_count),
            (None, None) => true,
            _ => false,
        };
        let Statistics { grad_sum, view_count: seen } = &self.statistics;
        let checks = [
            (*layout == profile.layout, "the Gaussians have other attributes"),
            (values.len() == len_of_values(*count, *layout), "numbers of Gaussians are missing"),
            (has_moments(&self.moments, values.len()), "moments of Gaussians are missing"),
            ([grad_sum.len(), seen.len()] == [*count; 2], "statistics of Gaussians are missing"),
            (is_light, "the light is another"),
            (are_exposures, "the exposures are of other photographs"),
            (self.order.iter().all(|view| *view < view_count), "there are fewer views"),
        ];
        checks.into_iter().find(|(fits, _)| !fits).map_or(Ok(()), |(_, what)| Err(what))
    }
}

fn download<E: Executor>(exec: &mut E, array: &E::Array, len: usize) -> Result<Vec<f32>, E::Error> {
    let mut values = vec![0.0; len];
    exec.download(array, &mut values)?;
    Ok(values)
}

fn download_moments<E: Executor>(
    exec: &mut E,
    moments: &AdamMoments<E::Array>,
    len: usize,
) -> Result<AdamMoments<Vec<f32>>, E::Error> {
    Ok(AdamMoments { mean: download(exec, &moments.mean, len)?, square: download(exec, &moments.square, len)? })
}

fn upload_moments<E: Executor>(
    exec: &mut E,
    moments: &AdamMoments<Vec<f32>>,
) -> Result<AdamMoments<E::Array>, E::Error> {
    Ok(AdamMoments { mean: exec.upload(&moments.mean)?, square: exec.upload(&moments.square)? })
}

/// A scene in host memory.
#[derive(Clone, Debug, PartialEq)]
pub struct HostScene {
    /// The Gaussians.
    pub gaussians: Gaussians<Vec<f32>>,
    /// The light, if there is one.
    pub environment: Option<Environment<Vec<f32>>>,
}

/// Whether views at half their size still show something.
fn all_can_be_halved(views: &[View]) -> bool {
    const SIZE_MIN: u32 = 64;
    views.iter().all(|view| view.camera.width.min(view.camera.height) >= 2 * SIZE_MIN)
}

/// Pictures, and their cameras with the near plane of the whole scene.
fn upload_pictures<E: Executor>(exec: &mut E, views: &[View], near: f32) -> Result<Vec<(Camera, E::Target)>, E::Error> {
    let mut upload = |view: &View| {
        let [width, height] = [view.camera.width as usize, view.camera.height as usize];
        Ok((Camera { near, ..view.camera }, exec.target(width, height, &view.rgba)?))
    };
    views.iter().map(&mut upload).collect()
}

fn start_light(profile: &Profile) -> Option<Environment<Vec<f32>>> {
    let start = profile.light?;
    let number = match start.activation {
        RadianceActivation::Identity => start.radiance,
        RadianceActivation::Exponential => start.radiance.ln(),
    };
    let values = vec![number; 6 * start.resolution * start.resolution * 3];
    Some(Environment { resolution: start.resolution, activation: start.activation, values })
}
