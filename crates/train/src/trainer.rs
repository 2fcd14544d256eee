//! The optimisation loop.

pub use crate::error::TrainError;
use crate::{
    batch::Updates,
    evaluate::render_view,
    exchange::Exchange,
    exposure,
    initial_state::{check_state, initial_light, initial_state},
    light_scale,
    near_field::{self, UnderSky, UnlitPicture},
    physical::{material_rates, physical_rates, physical_rules, physical_weights, view_rates},
    picture_schedule::{PictureSchedule, Prepared},
    pictures::{PictureSource, Pictures, Turn},
    profile::{Profile, Reflections},
    ranks::{Answer, Ranks, Traffic},
    start::{Point, gaussians, points_within, rates_by_plane, silhouettes},
    transfer::{
        download_fitted_light, download_gaussians, download_light, download_scene, upload_fitted_light, upload_scene,
        with_scene,
    },
    view::extent_of_cameras,
};
use specula_core::{
    activation::logit,
    camera::{Camera, near_of},
    executor::{DensifyReport, Executor, OwnLoss, PictureLoss, RandomKey, StepReport, TrainingStep},
    loss::LossWeights,
    metrics::psnr,
    near_field::NearField,
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, OPACITY, TINT},
    state::{ExposureState, SceneState, TrainingState},
};
use specula_mesh::sky::Sky;

/// Tint logit of Gaussians without specular reflection. σ(−64) = 1.6e-28 is negligible against any
/// colour, and gradients of that scale against Adam's ε of 1e-15, so neither the tint nor the light
/// moves.
pub const TINT_LOGIT_OFF: f32 = -64.0;

/// Iterations between two scalings of a light of known mean: few enough that it drifts by at most a
/// few per cent, even at the initial rates.
const LIGHT_SCALE_EVERY: u32 = 10;

/// Settings of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Profile.
    pub profile: Profile,
    /// Number of steps.
    pub iterations: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Background colour in sRGB.
    pub background: [f32; 3],
    /// Number of random points if no points are given.
    pub random_points: usize,
}

/// Settings that all views of a step share.
struct StepSettings {
    rules: RenderRules,
    weights: LossWeights,
    /// Learning rate of every plane.
    rates: Vec<f32>,
    environment_rate: f32,
    /// Whether the views add to the statistics of densification.
    is_observed: bool,
}

/// A training: scene, optimiser state and target pictures.
#[derive(Debug)]
pub struct Trainer<E: Executor> {
    exec: E,
    settings: Settings,
    /// Cameras at full and at half size; none at half size where no view is halved.
    cameras: [Vec<Camera>; 2],
    pictures: PictureSchedule<E::Target>,
    /// Number of views under each light.
    views_by_light: Vec<u64>,
    extent: f32,
    /// State. Between steps the light of its scene is the first; during a step it is that of the
    /// step's picture.
    state: TrainingState<E::Array>,
    /// Near field of the state on the executor.
    near_field: Option<E::NearField>,
    /// Ranks that share the training. The moments and statistics of the state are those of this
    /// rank's Gaussians.
    ranks: Ranks,
    own_loss: Option<Box<dyn PictureLoss<E> + Send>>,
}

impl<E: Executor> Trainer<E> {
    /// Starts a training from points, or from random points if there are none.
    ///
    /// # Errors
    ///
    /// [`TrainError::NoViews`], [`TrainError::NoPoints`], [`TrainError::Picture`] if random points
    /// need one that cannot be decoded, [`TrainError::SeveralLights`] for several views per step
    /// under several lights, or [`TrainError::Executor`] if data cannot be uploaded.
    pub fn new(
        exec: E,
        settings: Settings,
        views: &(impl PictureSource + ?Sized),
        points: &[Point],
    ) -> Result<Self, TrainError<E::Error>> {
        let mut pictures = views.pictures();
        let cameras = pictures.cameras();
        if cameras.is_empty() {
            return Err(TrainError::NoViews);
        }
        let random = if points.is_empty() {
            let silhouettes = silhouettes(pictures.as_mut(), cameras.len()).map_err(TrainError::Picture)?;
            points_within(settings.random_points, [0.0; 3], &cameras, &silhouettes, settings.seed)
        } else {
            Vec::new()
        };
        let points = if points.is_empty() { &random } else { points };
        if points.is_empty() {
            return Err(TrainError::NoPoints);
        }
        let start = gaussians(points, &settings.profile, settings.seed);
        let light = initial_light(&settings.profile, settings.seed);
        let light_count = views_by_light(&cameras).len();
        let exposures = settings.profile.exposure.map(|_| exposure::identities(cameras.len()));
        let state = initial_state(start, light, light_count, exposures);
        let mut trainer = Self::from_state(exec, settings, pictures, &state)?;
        trainer.disable_background_specular()?;
        trainer.sample()?;
        trainer.scale_light()?;
        Ok(trainer)
    }

    /// Resumes a training from its state, with the same settings and views. On the same kind of
    /// executor the result is the same to the last bit.
    ///
    /// # Errors
    ///
    /// [`TrainError::NoViews`], [`TrainError::OtherRun`] for a state of other settings or views, or
    /// [`TrainError::Executor`] if data cannot be uploaded.
    pub fn resume(
        exec: E,
        settings: Settings,
        views: &(impl PictureSource + ?Sized),
        state: &TrainingState<Vec<f32>>,
    ) -> Result<Self, TrainError<E::Error>> {
        Self::from_state(exec, settings, views.pictures(), state)
    }

    fn from_state(
        mut exec: E,
        settings: Settings,
        pictures: Box<dyn Pictures>,
        state: &TrainingState<Vec<f32>>,
    ) -> Result<Self, TrainError<E::Error>> {
        let cameras = pictures.cameras();
        if cameras.is_empty() {
            return Err(TrainError::NoViews);
        }
        let views_by_light = views_by_light(&cameras);
        if views_by_light.len() > 1 && settings.profile.views_per_step > 1 {
            return Err(TrainError::SeveralLights);
        }
        check_state(state, &settings, cameras.len(), views_by_light.len())
            .map_err(|what| TrainError::OtherRun { what })?;
        let extent = extent_of_cameras(cameras.iter());
        let near = near_of(extent);
        let cameras: Vec<Camera> = cameras.into_iter().map(|camera| Camera { near, ..camera }).collect();
        let is_halved = settings.profile.coarse_until > 0.0 && all_can_be_halved(&cameras);
        let half = |camera: &Camera| camera.resized(camera.width / 2, camera.height / 2);
        let halved = if is_halved { cameras.iter().map(half).collect() } else { Vec::new() };
        let near_field = state.near_field.as_ref().map(|near_field| upload_near_field(&mut exec, near_field));
        let near_field = near_field.transpose()?;
        let scene = upload_scene(&mut exec, &state.scene)?;
        let other_lights = state.other_lights.iter().map(|light| upload_fitted_light(&mut exec, light));
        let other_lights = other_lights.collect::<Result<_, _>>()?;
        Ok(Self {
            exec,
            pictures: PictureSchedule::new(pictures, &settings, cameras.len(), is_halved),
            settings,
            cameras: [cameras, halved],
            views_by_light,
            extent,
            state: with_scene(state, scene, other_lights),
            near_field,
            ranks: Ranks::alone(),
            own_loss: None,
        })
    }

    /// Shares the training with other ranks that were started or resumed with the same settings and
    /// join at the same step. Then all of them take the same steps and snapshots. The result is the
    /// same to the last bit on any number of ranks with the same kind of executor. `description`
    /// identifies data outside of the trainer, such as a checksum of the pictures.
    ///
    /// # Errors
    ///
    /// [`TrainError::SeveralLights`] under several lights, [`TrainError::Exchange`] if a rank is
    /// gone or differs, [`TrainError::Executor`] if arrays cannot be read back.
    pub fn join(&mut self, exchange: Box<dyn Exchange>, description: &str) -> Result<(), TrainError<E::Error>> {
        if self.views_by_light.len() > 1 {
            return Err(TrainError::SeveralLights);
        }
        let mut ranks = Ranks::of(exchange);
        let start = format!("{:?} {} {description}", self.settings, self.state.iteration);
        ranks.check_alike("settings or pictures", start.as_bytes()).map_err(TrainError::Exchange)?;
        ranks.check_parameters(&mut self.exec, &self.state.scene)?;
        ranks.keep_own(&mut self.exec, &mut self.state.scene)?;
        self.pictures.share(ranks.rank(), ranks.size());
        self.ranks = ranks;
        Ok(())
    }

    /// Uploads the pictures of the next step, and returns whether `wish` is true on any rank, such
    /// as a request to stop. All ranks must call it.
    ///
    /// # Errors
    ///
    /// [`TrainError::Picture`] on all ranks if one of them cannot decode a picture: the training is
    /// unchanged and can be saved. [`TrainError::Executor`] if a picture cannot be uploaded,
    /// [`TrainError::Exchange`] if a rank is gone.
    pub fn prepare(&mut self, wish: bool) -> Result<bool, TrainError<E::Error>> {
        let prepared = if self.is_finished() { Ok(()) } else { self.prepare_own() };
        let own = match prepared {
            Ok(()) => Answer::of(wish),
            Err(TrainError::Picture(error)) => Answer::Fault(error),
            Err(error) => return Err(error),
        };
        match self.ranks.agree(own).map_err(TrainError::Exchange)? {
            Answer::Fault(error) => Err(TrainError::Picture(error)),
            answer => Ok(answer == Answer::Yes),
        }
    }

    /// Uploads this rank's pictures of the next step.
    fn prepare_own(&mut self) -> Result<(), TrainError<E::Error>> {
        self.pictures.prepare(&mut self.exec, &self.state.order, self.state.iteration + 1)
    }

    /// Returns whether `wish` is true on any rank, such as a request to stop. All ranks must call
    /// it.
    ///
    /// # Errors
    ///
    /// [`TrainError::Exchange`] if a rank is gone.
    pub fn agree(&mut self, wish: bool) -> Result<bool, TrainError<E::Error>> {
        let answer = self.ranks.agree(Answer::of(wish)).map_err(TrainError::Exchange)?;
        Ok(answer == Answer::Yes)
    }

    /// Messages to other ranks so far; `None` for a training on one rank.
    pub fn traffic(&self) -> Option<Traffic> {
        self.ranks.traffic()
    }

    /// Copies the state of the training to the host. All ranks must call it.
    ///
    /// # Errors
    ///
    /// [`TrainError::Executor`] if arrays cannot be read back; [`TrainError::Exchange`] if a rank
    /// is gone.
    pub fn snapshot(&mut self) -> Result<TrainingState<Vec<f32>>, TrainError<E::Error>> {
        self.ranks.gather(&mut self.exec, &mut self.state.scene)?;
        let scene = download_scene(&mut self.exec, &self.state.scene)?;
        self.ranks.keep_own(&mut self.exec, &mut self.state.scene)?;
        let other_lights = self.state.other_lights.iter().map(|light| download_fitted_light(&mut self.exec, light));
        Ok(with_scene(&self.state, scene, other_lights.collect::<Result<_, _>>()?))
    }

    /// Takes one step, and densifies by the schedule. The report is that of the last view of the
    /// step.
    ///
    /// # Errors
    ///
    /// [`TrainError::Picture`] if one cannot be decoded: the training is unchanged.
    /// [`TrainError::Executor`] if a stage fails.
    pub fn step(&mut self) -> Result<(StepReport, DensifyReport), TrainError<E::Error>> {
        self.prepare_own()?;
        let Prepared { views, order } = self.pictures.take_prepared();
        self.state.order = order;
        self.state.iteration += 1;
        let number = self.state.iteration;
        let light = self.cameras[0][views[0]].light;
        self.swap_light(light);
        let fitted = self.fit_all(&views);
        self.swap_light(light);
        let reports = fitted?;
        for (position, (view, report)) in views.iter().zip(&reports).enumerate() {
            self.note(report);
            self.expose(*view, position, report);
        }
        let densified = self.refine()?;
        if number.is_multiple_of(LIGHT_SCALE_EVERY) {
            self.scale_light()?;
        }
        self.renew_near_field()?;
        Ok((reports.last().copied().unwrap_or_default(), densified))
    }

    /// Sets or removes a loss on pictures in addition to those of the profile. Checkpoints do not
    /// contain it: set it again after [`Trainer::resume`], and on every rank.
    pub fn set_own_loss(&mut self, loss: Option<Box<dyn PictureLoss<E> + Send>>) {
        self.own_loss = loss;
    }

    /// Changes the Gaussians between steps, on the host: a step of a loss on their attributes, or a
    /// constraint. Adam's moments are unchanged. All ranks must make the same changes.
    ///
    /// # Errors
    ///
    /// [`TrainError::Executor`] if arrays cannot be copied.
    ///
    /// # Panics
    ///
    /// If the number of Gaussians or their layout changes.
    pub fn edit(&mut self, edit: impl FnOnce(&mut Gaussians<Vec<f32>>)) -> Result<(), TrainError<E::Error>> {
        let gaussians = &mut self.state.scene.gaussians;
        let mut edited = download_gaussians(&mut self.exec, gaussians)?;
        edit(&mut edited);
        let is_same = (edited.count, edited.layout) == (gaussians.count, gaussians.layout);
        assert!(is_same, "the number of Gaussians and their layout are those of the training");
        *gaussians = self.exec.upload_gaussians(&edited)?;
        Ok(())
    }

    /// Ends the training after `steps` more steps, at least one, if it would take more. Learning
    /// rates fall from their current values to their last ones, everything that depends on progress
    /// advances, and no Gaussians are added. [`Trainer::settings`] then describe the shorter
    /// training: [`Trainer::resume`] needs them. All ranks must call it.
    pub fn finish_early(&mut self, steps: u32) {
        let from = self.state.iteration;
        let to = from.saturating_add(steps.max(1));
        if to < self.settings.iterations {
            self.settings.profile = self.settings.profile.ending_at(from, to);
            self.settings.iterations = to;
            self.pictures.end_at(to);
        }
    }

    /// Swaps the first light with another of a number, from 0.
    fn swap_light(&mut self, number: u32) {
        let TrainingState { scene, other_lights, .. } = &mut self.state;
        let other = (number as usize).checked_sub(1).and_then(|index| other_lights.get_mut(index));
        if let (Some(first), Some(other)) = (&mut scene.light, other) {
            core::mem::swap(first, other);
        }
    }

    /// Fits view-dependent colours and materials, as they are due, to some views under the current
    /// light. Returns the reports of the first.
    fn fit_all(&mut self, views: &[usize]) -> Result<Vec<StepReport>, TrainError<E::Error>> {
        let number = self.state.iteration;
        let rules = self.rules_at(number, Channels::Training);
        let material_rules = RenderRules { traces_near: self.near_field.is_some(), ..physical_rules(&rules) };
        let weights = self.settings.profile.weights_at(self.done(number));
        let profile = &self.settings.profile;
        let rates = profile.rates_at(self.done(number - 1));
        let environment_rate = rates.environment.at(number);
        let rates = rates_by_plane(profile.layout, &rates, self.extent, number);
        let layout = profile.layout;
        let iterations = self.settings.iterations;
        if profile.physical.is_some_and(|physical| physical.is_only_materials(number, iterations)) {
            let rates = material_rates(layout, &rates);
            let shared = StepSettings { rules: material_rules, weights, rates, environment_rate, is_observed: true };
            return self.fit(views, &shared);
        }
        let physical = profile.physical.filter(|physical| physical.is_due(number, iterations));
        let shared =
            StepSettings { rules, weights, rates: view_rates(layout, &rates), environment_rate, is_observed: true };
        let reports = self.fit(views, &shared)?;
        if let Some(physical) = physical {
            let mean_light = self.mean_light()?;
            let weights = physical_weights(&self.settings.profile.weights, physical.weight, mean_light);
            let shared = StepSettings {
                rules: material_rules,
                weights,
                rates: physical_rates(layout, &rates),
                environment_rate,
                is_observed: false,
            };
            let material_reports = self.fit(views, &shared)?;
            self.state.nonfinite += material_reports.iter().map(|report| report.nonfinite).sum::<usize>();
        }
        Ok(reports)
    }

    /// Takes Adam's step against the gradients of some views; returns the report of each.
    fn fit(&mut self, views: &[usize], shared: &StepSettings) -> Result<Vec<StepReport>, TrainError<E::Error>> {
        let number = self.state.iteration;
        let profile = &self.settings.profile;
        let updates = Updates {
            views: views.len(),
            first: self.pictures.visits(number).start,
            rates: &shared.rates,
            environment_rate: shared.environment_rate,
            radiance_max: profile.light.map_or(f32::INFINITY, |light| light.radiance_max),
            is_observed: shared.is_observed,
        };
        let turns = self.pictures.turns(number, views);
        let of = |Turn { visit, picture }: &Turn| TrainingStep {
            camera: &self.cameras[usize::from(picture.is_halved)][picture.view],
            target: self.pictures.target(*picture),
            background: self.settings.background,
            exposure: self.state.exposures.as_ref().map(|exposures| &exposures.maps[picture.view]),
            near_field: self.near_field.as_ref(),
            rules: &shared.rules,
            weights: &shared.weights,
            is_observed: updates.is_observed,
            rates: updates.rates,
            environment_rate: updates.environment_rate,
            radiance_max: updates.radiance_max,
            number: u32::try_from(*visit).unwrap_or(u32::MAX),
            light_number: light_number(*visit, self.cameras[0][picture.view].light, &self.views_by_light),
            own_loss: self.own_loss.as_deref().map(|loss| OwnLoss { loss, view: picture.view }),
        };
        let own: Vec<_> = turns.iter().map(of).collect();
        self.ranks.step(&mut self.exec, &mut self.state.scene, &own, &updates)
    }

    fn note(&mut self, report: &StepReport) {
        const MEMORY: f64 = 0.98;
        let now = psnr(report.loss.squared.max(1e-10));
        self.state.psnr = Some(self.state.psnr.map_or(now, |mean| MEMORY * mean + (1.0 - MEMORY) * now));
        self.state.nonfinite += report.nonfinite;
    }

    /// Takes Adam's step for the exposure of a picture, by its position in the step. The step
    /// number is the number of the pass.
    fn expose(&mut self, view: usize, position: usize, report: &StepReport) {
        let visit = self.pictures.visits(self.state.iteration).start + position as u64;
        let turn = ((visit - 1) / self.cameras[0].len() as u64) as u32 + 1;
        let schedule = self.settings.profile.exposure;
        if let (Some(exposures), Some(grad), Some(schedule)) = (&mut self.state.exposures, &report.exposure, schedule) {
            let light = self.cameras[0][view].light;
            let peers = |other: usize| self.cameras[0][other].light == light;
            self.state.nonfinite +=
                exposure::step(exposures, view, peers, grad, schedule.at(self.state.iteration), turn);
        }
    }

    /// Rendering rules at an iteration: harmonics are enabled band by band.
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
            traces_near: profile.reflections == Reflections::Near && self.near_field.is_some(),
            ..RenderRules::full(profile.shading, profile.scheme, channels)
        }
    }

    /// Progress of the training at an iteration, in \[0, 1\].
    fn done(&self, iteration: u32) -> f32 {
        iteration as f32 / self.settings.iterations.max(1) as f32
    }

    /// Densifies and resets by the schedule; if anything is due, with all moments on every rank.
    fn refine(&mut self) -> Result<DensifyReport, TrainError<E::Error>> {
        let plan = self.settings.profile.densification;
        let k = self.state.iteration;
        let is_reset = plan.reset_every > 0 && k.is_multiple_of(plan.reset_every);
        if !k.is_multiple_of(plan.every) && !is_reset && k != self.settings.iterations {
            return Ok(DensifyReport::default());
        }
        self.ranks.gather(&mut self.exec, &mut self.state.scene)?;
        let report = self.refine_whole()?;
        self.ranks.keep_own(&mut self.exec, &mut self.state.scene)?;
        Ok(report)
    }

    fn refine_whole(&mut self) -> Result<DensifyReport, TrainError<E::Error>> {
        let plan = self.settings.profile.densification;
        let k = self.state.iteration;
        let mut report = DensifyReport::default();
        if let Some(rules) = plan.rules_at(k, self.settings.iterations, self.extent) {
            let key = RandomKey { seed: self.settings.seed, stream: u64::from(k) };
            let SceneState { gaussians, moments, statistics, .. } = &mut self.state.scene;
            report = self.exec.densify(gaussians, moments, statistics, &rules, plan.count_max, key)?;
        }
        if plan.reset_every > 0 && k < plan.until && k.is_multiple_of(plan.reset_every) {
            let SceneState { gaussians, moments, .. } = &mut self.state.scene;
            self.exec.limit_plane(gaussians, moments, OPACITY, logit(0.01), None)?;
        }
        if k.is_multiple_of(plan.every) || k == self.settings.iterations {
            self.disable_background_specular()?;
        }
        // The last parameters are fitted to fixed filters, as in Mip-Splatting.
        if k.is_multiple_of(plan.every) && k + plan.every <= self.settings.iterations {
            self.sample()?;
        }
        Ok(report)
    }

    /// Fuses the views of the scene into a near field if one is due.
    fn renew_near_field(&mut self) -> Result<(), TrainError<E::Error>> {
        let Settings { iterations, ref profile, .. } = self.settings;
        let iteration = self.state.iteration;
        let Some(schedule) = profile.near_field.filter(|schedule| schedule.is_due(iteration, iterations)) else {
            return Ok(());
        };
        let rules = RenderRules { is_lit: false, ..self.rules_at(iteration, Channels::Training) };
        let mut gaussians = download_gaussians(&mut self.exec, &self.state.scene.gaussians)?;
        let is_of_materials =
            profile.physical.is_some_and(|physical| physical.is_only_materials(iteration, iterations));
        let sky = if gaussians.layout.is_physical { self.mean_sky()? } else { None };
        let scene = &self.state.scene.gaussians;
        let exec = &mut self.exec;
        let mut render = |camera: &Camera, picture: UnlitPicture| {
            let rules = match picture {
                UnlitPicture::Depths => rules,
                UnlitPicture::Layers => RenderRules { channels: Channels::Layers, ..rules },
                UnlitPicture::Materials => physical_rules(&RenderRules { channels: Channels::Layers, ..rules }),
            };
            render_view(exec, scene, None, camera, &rules)
        };
        let sky = sky.as_ref().map(|sky| UnderSky { sky, is_of_materials });
        let found = near_field::fused(&gaussians, &self.cameras[0], schedule.voxels, sky, &mut render)?;
        if gaussians.layout.is_physical {
            let surroundings = found.as_ref().and_then(|found| Some(&found.near_field).zip(found.ambient.as_ref()));
            near_field::set_ambient(&mut gaussians, surroundings);
            self.state.scene.gaussians = self.exec.upload_gaussians(&gaussians)?;
        }
        self.state.near_field = found.map(|found| found.near_field);
        let uploaded = self.state.near_field.as_ref().map(|near_field| upload_near_field(&mut self.exec, near_field));
        self.near_field = uploaded.transpose()?;
        Ok(())
    }

    /// Mean sky of the pictures; none without a light.
    fn mean_sky(&mut self) -> Result<Option<Sky>, TrainError<E::Error>> {
        let TrainingState { scene, other_lights, .. } = &self.state;
        let mut skies = Vec::new();
        for (number, (light, _)) in scene.light.iter().chain(other_lights).enumerate() {
            let own = self.cameras[0].iter().filter(|camera| camera.light as usize == number).copied();
            let turns = near_field::lights_from_world(&own.collect::<Vec<_>>());
            let sky = Sky::new(&download_light(&mut self.exec, light)?).turned(&turns);
            skies.push((sky, self.views_by_light[number] as f32 / self.cameras[0].len() as f32));
        }
        Ok(Sky::mean(&skies))
    }

    /// Sets the 3D filters of Gaussians that have one, from the views at full size.
    fn sample(&mut self) -> Result<(), TrainError<E::Error>> {
        if self.settings.profile.layout.is_smoothed {
            self.exec.sampling(&mut self.state.scene.gaussians, &self.cameras[0])?;
        }
        Ok(())
    }

    /// Scales a light to its mean radiance, if that is known. Materials adapt in the next steps.
    fn scale_light(&mut self) -> Result<(), TrainError<E::Error>> {
        let Some(mean) = self.settings.profile.light_mean else { return Ok(()) };
        let TrainingState { scene, other_lights, .. } = &mut self.state;
        for (light, _) in scene.light.iter_mut().chain(other_lights) {
            let mut scaled = download_light(&mut self.exec, light)?;
            light_scale::scale_to(&mut scaled, mean);
            *light = scaled.with_values(self.exec.upload(&scaled.values)?);
        }
        Ok(())
    }

    /// Mean radiance of the light over all directions and colours, if the loss on metalness needs
    /// it; else 0.
    fn mean_light(&mut self) -> Result<f32, TrainError<E::Error>> {
        let is_read = self.settings.profile.weights.metalness != 0.0;
        let Some((light, _)) = self.state.scene.light.as_ref().filter(|_| is_read) else { return Ok(0.0) };
        let mean = light_scale::mean_radiance(&download_light(&mut self.exec, light)?);
        Ok(mean.iter().sum::<f32>() / 3.0)
    }

    /// Disables specular reflection of Gaussians outside of the foreground.
    fn disable_background_specular(&mut self) -> Result<(), TrainError<E::Error>> {
        let Profile { layout, foreground, .. } = self.settings.profile;
        if layout.is_shaded() && foreground.is_some() {
            let SceneState { gaussians, moments, .. } = &mut self.state.scene;
            for plane in TINT..TINT + 3 {
                self.exec.limit_plane(gaussians, moments, plane, TINT_LOGIT_OFF, foreground)?;
            }
        }
        Ok(())
    }

    /// Steps taken so far.
    pub fn iteration(&self) -> u32 {
        self.state.iteration
    }
    /// Returns whether all steps are taken.
    pub fn is_finished(&self) -> bool {
        self.state.iteration >= self.settings.iterations
    }
    /// PSNR of the training pictures, in dB, a running mean.
    pub fn psnr(&self) -> Option<f64> {
        self.state.psnr
    }
    /// Gradients skipped so far because they were not finite.
    pub fn nonfinite(&self) -> usize {
        self.state.nonfinite
    }
    /// Current Gaussians.
    pub fn gaussians(&self) -> &Gaussians<E::Array> {
        &self.state.scene.gaussians
    }
    /// Current light, if there is one.
    pub fn environment(&self) -> Option<&Environment<E::Array>> {
        self.state.scene.light.as_ref().map(|(light, _)| light)
    }
    /// Exposures in the order of the views, if they are learned.
    pub fn exposures(&self) -> Option<&ExposureState> {
        self.state.exposures.as_ref()
    }
    /// Settings of the training.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
    /// The executor, for rendering between steps.
    pub fn executor(&mut self) -> &mut E {
        &mut self.exec
    }

    /// Copies the scene to the host: Gaussians, and the light if there is one.
    ///
    /// # Errors
    ///
    /// [`TrainError::Executor`] if arrays cannot be read back.
    pub fn download(&mut self) -> Result<HostScene, TrainError<E::Error>> {
        let SceneState { gaussians, light, .. } = &self.state.scene;
        let gaussians = download_gaussians(&mut self.exec, gaussians)?;
        let environment = light.as_ref().map(|(light, _)| download_light(&mut self.exec, light)).transpose()?;
        let others = self.state.other_lights.iter().map(|(light, _)| download_light(&mut self.exec, light));
        let other_lights = others.collect::<Result<_, _>>()?;
        Ok(HostScene { gaussians, environment, other_lights, near_field: self.state.near_field.clone() })
    }
}

fn upload_near_field<E: Executor>(exec: &mut E, near_field: &NearField<Vec<f32>>) -> Result<E::NearField, E::Error> {
    exec.upload_near_field(&near_field.with_values(near_field.values.as_slice()))
}

/// A scene in host memory.
#[derive(Clone, Debug, PartialEq)]
pub struct HostScene {
    /// The Gaussians.
    pub gaussians: Gaussians<Vec<f32>>,
    /// The first light, if there is one.
    pub environment: Option<Environment<Vec<f32>>>,
    /// The lights of other groups of pictures, in the order of [`Camera::light`] from 1.
    pub other_lights: Vec<Environment<Vec<f32>>>,
    /// The near field, if there is one.
    pub near_field: Option<NearField<Vec<f32>>>,
}

/// Number of views under each light, up to the last light of any view.
fn views_by_light(cameras: &[Camera]) -> Vec<u64> {
    let mut counts = vec![0; cameras.iter().map(|camera| camera.light as usize + 1).max().unwrap_or(1)];
    cameras.iter().for_each(|camera| counts[camera.light as usize] += 1);
    counts
}

/// Number of a visit among those of pictures under a light, from 1, as if its pictures were spread
/// evenly over each pass.
fn light_number(visit: u64, light: u32, views_by_light: &[u64]) -> u32 {
    let number = (visit - 1) * views_by_light[light as usize] / views_by_light.iter().sum::<u64>() + 1;
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// Returns whether views at half their size are still large enough to train on.
fn all_can_be_halved(cameras: &[Camera]) -> bool {
    const SIZE_MIN: u32 = 64;
    cameras.iter().all(|camera| camera.width.min(camera.height) >= 2 * SIZE_MIN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        own_loss::{HostLoss, HostPicture},
        profile::by_name,
        view::View,
    };
    use glam::Vec3;
    use specula_core::{
        rules::channel,
        scene::{ALBEDO, DIFFUSE, MEAN},
    };
    use specula_cpu::CpuExecutor;

    const ITERATIONS: u32 = 40;

    /// Three views of two points under two lights.
    fn views() -> [View; 3] {
        [0, 1, 1].map(|light| {
            let eye = Vec3::new(3.0, light as f32, 0.5);
            let camera = Camera { light, ..Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.7, 32, 32) };
            View {
                name: light.to_string(),
                camera,
                rgba: vec![100 + 80 * light as u8; 32 * 32 * 4],
                unclipped: None,
                normals: None,
            }
        })
    }

    fn settings() -> Settings {
        let mut profile = by_name("specula", ITERATIONS).expect("a profile").relightable().under_several_lights();
        profile.light.as_mut().expect("a light").resolution = 16;
        Settings { profile, iterations: ITERATIONS, seed: 0, background: [1.0; 3], random_points: 0 }
    }

    fn trainer(settings: Settings) -> Result<Trainer<CpuExecutor>, TrainError<specula_cpu::CpuError>> {
        let points = [0.0, 0.2].map(|z| Point { position: [0.0, 0.0, z], color: [0.5; 3] });
        Trainer::new(CpuExecutor::new(), settings, &views(), &points)
    }

    fn take(trainer: &mut Trainer<CpuExecutor>, steps: u32) {
        for _ in 0..steps {
            trainer.step().expect("the CPU trains");
        }
    }

    #[test]
    fn a_step_changes_the_light_of_its_picture() {
        let mut trainer = trainer(settings()).expect("there are views");
        let mut steps = [0; 2];
        for _ in 0..12 {
            let before = trainer.download().expect("the CPU gives back");
            trainer.step().expect("the CPU trains");
            let after = trainer.download().expect("the CPU gives back");
            let has_changed = [before.environment != after.environment, before.other_lights != after.other_lights];
            assert!(has_changed[0] != has_changed[1], "one of them: {has_changed:?}");
            steps[usize::from(has_changed[1])] += 1;
        }
        assert_eq!(steps, [4, 8], "as many as pictures");
    }

    #[test]
    fn a_loss_of_the_caller_moves_what_it_sees_and_none_changes_nothing() {
        // Less depth Σ w t means less coverage.
        let fitted = |loss: Option<f32>| {
            let mut trainer = trainer(settings()).expect("there are views");
            if let Some(weight) = loss {
                trainer.set_own_loss(Some(Box::new(HostLoss(move |picture: &HostPicture<'_>, grad: &mut [f32]| {
                    assert_eq!(picture.camera.light, u32::from(picture.view > 0), "the view's own camera");
                    assert!(
                        picture.transmittance().iter().all(|passed| (0.0..=1.0).contains(passed)),
                        "shares of light"
                    );
                    let depths = picture.plane_mut(grad, channel::DEPTH).expect("a shaded profile has depths");
                    depths.iter_mut().for_each(|grad| *grad += weight);
                }))));
            }
            take(&mut trainer, 9);
            trainer.download().expect("the CPU gives back").gaussians
        };
        let opacity = |gaussians: &Gaussians<Vec<f32>>| gaussians.get::<1>(0, OPACITY)[0];
        let (without, zero, less, more) = (fitted(None), fitted(Some(0.0)), fitted(Some(1.0)), fitted(Some(-1.0)));
        assert!(without == zero, "a gradient of zero");
        let opacities = [&less, &without, &more].map(opacity);
        assert!(opacities[0] < opacities[1] && opacities[1] < opacities[2], "{opacities:?}");
    }

    #[test]
    fn edited_gaussians_are_trained_on() {
        let mut trainer = trainer(settings()).expect("there are views");
        take(&mut trainer, 3);
        let height = |gaussians: &Gaussians<Vec<f32>>| gaussians.get::<3>(1, MEAN)[2];
        trainer.edit(|gaussians| gaussians.set(1, MEAN, [0.0, 0.0, 0.5])).expect("the CPU gives back");
        assert_eq!(height(&trainer.download().expect("the CPU gives back").gaussians), 0.5);
        take(&mut trainer, 1);
        let moved = height(&trainer.download().expect("the CPU gives back").gaussians);
        assert!(moved != 0.5 && (moved - 0.5).abs() < 0.1, "{moved}");
    }

    #[test]
    fn a_training_ends_early_and_resumes_to_the_same_bits() {
        let mut trainer = trainer(settings()).expect("there are views");
        take(&mut trainer, 10);
        let rate = |trainer: &Trainer<CpuExecutor>, step: u32| trainer.settings().profile.rates.mean.at(step);
        let [now, last] = [10, ITERATIONS].map(|step| rate(&trainer, step));
        trainer.finish_early(ITERATIONS);
        assert_eq!(trainer.settings(), &settings(), "it does not become longer");
        trainer.finish_early(8);
        assert_eq!(trainer.settings().iterations, 18);
        for (step, expected) in [(10, now), (18, last)] {
            assert!((rate(&trainer, step) / expected - 1.0).abs() < 1e-5, "rate of step {step}");
        }
        take(&mut trainer, 3);
        let (state, shortened) = (trainer.snapshot().expect("the CPU gives back"), trainer.settings().clone());
        let mut resumed =
            Trainer::resume(CpuExecutor::new(), shortened, &views(), &state).expect("settings are those of the state");
        for trainer in [&mut trainer, &mut resumed] {
            take(trainer, 5);
            assert!(trainer.is_finished());
        }
        let [one, other] = [trainer, resumed].map(|mut trainer| trainer.snapshot().expect("the CPU gives back"));
        assert!(one == other, "the same bits");
    }

    #[test]
    #[should_panic(expected = "number of Gaussians")]
    fn an_edit_keeps_the_number_of_gaussians() {
        let mut trainer = trainer(settings()).expect("there are views");
        let _ = trainer.edit(|gaussians| *gaussians = Gaussians { count: 0, layout: gaussians.layout, values: vec![] });
    }

    #[test]
    fn numbers_of_a_light_are_those_of_the_visits_to_its_pictures() {
        let numbers = |light: u32| [1, 2, 3, 4, 301].map(|visit| light_number(visit, light, &[1, 2]));
        assert_eq!([numbers(0), numbers(1)], [[1, 1, 1, 2, 101], [1, 1, 2, 3, 201]]);
    }

    #[test]
    fn only_materials_are_fitted_after_the_start() {
        let mut trainer = trainer(settings()).expect("there are views");
        let layout = trainer.gaussians().layout;
        let albedo = layout.physical_planes().expect("materials") + ALBEDO;
        let planes = |trainer: &mut Trainer<CpuExecutor>| {
            let scene = trainer.download().expect("the CPU gives back").gaussians;
            [DIFFUSE, albedo].map(|plane| scene.get::<3>(0, plane))
        };
        let [diffuse, albedo] = planes(&mut trainer);
        take(&mut trainer, 3);
        let [begun, same] = planes(&mut trainer);
        assert!(begun != diffuse && same == albedo, "view-dependent colours find the surface");
        take(&mut trainer, 25);
        let [begun, _] = planes(&mut trainer);
        take(&mut trainer, 4);
        let [kept, fitted] = planes(&mut trainer);
        assert!(kept == begun && fitted != albedo, "then only materials");
        assert_eq!(layout.sh_degree, None, "no residual harmonics");
    }

    #[test]
    fn several_views_per_step_are_refused_under_several_lights() {
        let Settings { profile, .. } = settings();
        let refused = trainer(Settings { profile: profile.for_batches(2), ..settings() });
        assert!(matches!(refused, Err(TrainError::SeveralLights)));
    }
}
