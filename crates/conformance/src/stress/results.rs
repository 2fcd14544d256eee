//! Results of an executor for a case: a picture, and the gradients of a training step.

use super::Case;
use crate::compare::LEAST_SMOOTHNESS;
use specula_core::{
    color::Picture,
    executor::{Executor, StepReport, TrainingStep},
    loss::{LossReport, LossWeights, NormalForm},
    pipeline::{render, train_step},
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians},
    shade::ShadingRules,
    state::{AdamMoments, SceneState, Statistics},
};

/// Every loss that has a gradient of its own.
const WEIGHTS: LossWeights = LossWeights {
    absolute: 0.5,
    squared: 0.3,
    dssim: 0.2,
    normal: 0.1,
    normal_form: NormalForm::Distance,
    smoothness: 0.2,
    sparse_coverage: 0.05,
    residual_image: 0.05,
    coverage: 0.1,
    sparse: 1e-3,
    residual: 1e-2,
    ..LossWeights::NONE
};

/// Results of an executor for a case.
#[derive(Clone, Debug)]
pub struct Results {
    /// The picture, channel after channel, and its transmittance.
    pub picture: Vec<f64>,
    /// A tenth of the gradients of the Gaussians and of the light behind them, and the lengths that
    /// densification goes by.
    pub gradient: Vec<f64>,
    /// Values of the losses.
    pub losses: Vec<f64>,
    /// Gradients that were not finite.
    pub nonfinite: usize,
}

impl Results {
    /// A picture of the case, and a step of training.
    pub fn new<E: Executor>(exec: &mut E, case: &Case, shading: ShadingRules) -> Self {
        let rules = RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training);
        let mut scene = Scene::new(exec, case);
        let picture = scene.picture(exec, case, &rules);
        let StepReport { loss, nonfinite, .. } = scene.step(exec, case, &rules);
        let LossReport { total, absolute, squared, ssim, normal, smoothness, coverage } = loss;
        let losses = vec![total, absolute, squared, ssim, normal, smoothness + LEAST_SMOOTHNESS, coverage];
        Self { picture, gradient: scene.gradient(exec), losses, nonfinite }
    }
}

/// A case where an executor keeps it.
struct Scene<A> {
    state: SceneState<A>,
    lens: [usize; 3],
}

impl<A> Scene<A> {
    fn new<E: Executor<Array = A>>(exec: &mut E, case: &Case) -> Self {
        let Gaussians { count, values, .. } = &case.cloud;
        let zeros = vec![0.0; values.len()];
        let mut upload = |values| exec.upload_gaussians(&case.cloud.with_values(values)).expect("numbers fit");
        let [gaussians, mean, square] = [values, &zeros, &zeros].map(&mut upload);
        let mut upload = |values: &[f32]| exec.upload(values).expect("numbers fit");
        let texels = case.environment.as_ref().map_or(0, |light| light.values.len());
        let mut zeros = |len: usize| upload(&vec![0.0; len]);
        let [light_mean, light_square, grad_sum, view_count] = [texels, texels, *count, *count].map(&mut zeros);
        let environment = case.environment.as_ref().map(|light| {
            let Environment { resolution, activation, values } = light;
            Environment { resolution: *resolution, activation: *activation, values: upload(values) }
        });
        let light_moments = AdamMoments { mean: light_mean, square: light_square };
        Self {
            state: SceneState {
                gaussians,
                moments: AdamMoments { mean: mean.values, square: square.values },
                statistics: Statistics { grad_sum, view_count },
                light: environment.map(|light| (light, light_moments)),
            },
            lens: [values.len(), texels, *count],
        }
    }

    fn picture<E: Executor<Array = A>>(&self, exec: &mut E, case: &Case, rules: &RenderRules) -> Vec<f64> {
        let light = self.state.light.as_ref();
        let light = light
            .map(|(light, _)| exec.prefilter(light, rules.scheme, rules.levels).expect("the resolution is allowed"));
        let frame =
            render(exec, &self.state.gaussians, light.as_ref(), &case.camera, rules).expect("the executor renders");
        let channels = rules.blended(case.cloud.layout).count() + 1;
        let mut values = vec![0.0; channels * (case.camera.width * case.camera.height) as usize];
        exec.read_frame(&frame, &mut values).expect("the frame has that size");
        wide(&values)
    }

    /// A step that moves nothing but the running means, which then are a tenth of the gradients.
    fn step<E: Executor<Array = A>>(&mut self, exec: &mut E, case: &Case, rules: &RenderRules) -> StepReport {
        let [width, height] = [case.camera.width as usize, case.camera.height as usize];
        let target = exec.target(&Picture::of_bytes(width, height, &case.picture())).expect("the bytes fit");
        let step = TrainingStep {
            camera: &case.camera,
            target: &target,
            background: case.background,
            exposure: None,
            near_field: None,
            rules,
            weights: &WEIGHTS,
            is_observed: true,
            rates: &vec![0.0; case.cloud.layout.plane_count()],
            environment_rate: 0.0,
            radiance_max: f32::MAX,
            number: 1,
            light_number: 1,
            own_loss: None,
        };
        train_step(exec, &mut self.state, &step).expect("the executor trains")
    }

    fn gradient<E: Executor<Array = A>>(&self, exec: &mut E) -> Vec<f64> {
        let mut download = |array: &A, len: usize| {
            let mut values = vec![0.0; len];
            exec.download(array, &mut values).expect("numbers come back");
            values
        };
        let SceneState { gaussians, moments, statistics, light } = &self.state;
        let gaussian_moments = download(&moments.mean, self.lens[0]);
        let light_moments = light.as_ref().map_or_else(Vec::new, |(_, moments)| download(&moments.mean, self.lens[1]));
        let lengths = download(&statistics.grad_sum, self.lens[2]);
        let Gaussians { count, layout, .. } = *gaussians;
        // Without the padding of the last block.
        let gaussian_moments = Gaussians { count, layout, values: gaussian_moments };
        let planes = (0..layout.plane_count()).flat_map(|plane| gaussian_moments.plane(plane).collect::<Vec<f32>>());
        wide(&planes.chain(light_moments).chain(lengths).collect::<Vec<f32>>())
    }
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}
