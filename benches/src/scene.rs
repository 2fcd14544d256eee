//! The torus under its sky on any executor: for training and for rendering.

use crate::{camera, environment, torus};
use specula_core::{
    camera::Camera,
    color::Picture,
    executor::{Executor, Renderer, TrainingStep},
    loss::LossWeights,
    near_field::NearField,
    pipeline::train_step,
    prefilter::LevelRange,
    rules::RenderRules,
    scene::{Environment, Gaussians, Layout},
    state::{AdamMoments, SceneState, Statistics},
};

/// Texels along an edge of the sky's faces.
pub const LIGHT: usize = 64;

/// Scene with everything that a training needs.
#[derive(Debug)]
pub struct Scene<E: Executor> {
    /// Rendering rules.
    pub rules: RenderRules,
    /// Weights of the losses.
    pub weights: LossWeights,
    /// Camera of the picture.
    pub camera: Camera,
    /// The Gaussians, and the sky if they are shaded, with their moments.
    pub state: SceneState<E::Array>,
    /// Surface for the stage that traces rays, which is not measured without one.
    pub near_field: Option<NearField<Vec<f32>>>,
    /// Grey, to be compared with.
    pub target: E::Target,
    /// Learning rates, all zero.
    pub rates: Vec<f32>,
}

/// Scene for rendering.
#[derive(Debug)]
pub struct View<'a, E: Renderer> {
    /// The Gaussians.
    pub cloud: &'a Gaussians<E::Array>,
    /// Their light.
    pub light: Option<&'a E::Light>,
    /// Camera of the picture.
    pub camera: &'a Camera,
    /// Rendering rules.
    pub rules: &'a RenderRules,
}

impl<E: Executor> Scene<E> {
    /// Creates the torus of `count` Gaussians, in a picture of `size` × `size` pixels.
    ///
    /// # Errors
    ///
    /// Any error of the executor.
    pub fn new(
        exec: &mut E,
        layout: Layout,
        rules: &RenderRules,
        weights: &LossWeights,
        size: u32,
        count: usize,
    ) -> Result<Self, E::Error> {
        let cloud = torus(count, layout);
        let light = layout.is_shaded().then(|| upload_sky(exec));
        let grey = vec![128; (size * size * 4) as usize];
        Ok(Self {
            rules: *rules,
            weights: *weights,
            camera: camera(size),
            state: SceneState {
                moments: AdamMoments { mean: zeros_of(exec, &cloud)?, square: zeros_of(exec, &cloud)? },
                light: light.transpose()?,
                statistics: Statistics { grad_sum: zeros(exec, count)?, view_count: zeros(exec, count)? },
                gaussians: exec.upload_gaussians(&cloud)?,
            },
            near_field: None,
            target: exec.target(&Picture::of_bytes(size as usize, size as usize, &grey))?,
            rates: vec![0.0; layout.plane_count()],
        })
    }

    /// The sky, filtered.
    ///
    /// # Errors
    ///
    /// Any error of the executor.
    pub fn filtered(&self, exec: &mut E) -> Result<Option<E::Light>, E::Error> {
        let light = self.state.light.as_ref();
        light.map(|(light, _)| exec.prefilter(light, self.rules.scheme, LevelRange::ALL)).transpose()
    }

    /// The sky, filtered, around the near field; `None` without either.
    ///
    /// # Errors
    ///
    /// Any error of the executor.
    pub fn surrounded(&self, exec: &mut E) -> Result<Option<E::Light>, E::Error> {
        let Some(near_field) = &self.near_field else { return Ok(None) };
        let near_field = exec.upload_near_field(&near_field.with_values(near_field.values.as_slice()))?;
        self.filtered(exec)?.map(|light| exec.surround(light, &near_field)).transpose()
    }

    /// One step that changes nothing, as all rates are zero.
    ///
    /// # Errors
    ///
    /// Any error of the executor.
    pub fn train(&mut self, exec: &mut E) -> Result<(), E::Error> {
        let step = TrainingStep {
            camera: &self.camera,
            target: &self.target,
            background: [1.0; 3],
            exposure: None,
            near_field: None,
            rules: &self.rules,
            weights: &self.weights,
            is_observed: true,
            rates: &self.rates,
            environment_rate: 0.0,
            radiance_max: 100.0,
            number: 1,
            light_number: 1,
            own_loss: None,
        };
        train_step(exec, &mut self.state, &step).map(drop)
    }
}

fn zeros<E: Renderer>(exec: &mut E, len: usize) -> Result<E::Array, E::Error> {
    exec.upload(&vec![0.0; len])
}

/// As many as the Gaussians have.
fn zeros_of<E: Renderer>(exec: &mut E, cloud: &Gaussians<Vec<f32>>) -> Result<E::Array, E::Error> {
    Ok(exec.upload_gaussians(&cloud.with_values(vec![0.0; cloud.values.len()]))?.values)
}

fn zero_moments<E: Renderer>(exec: &mut E, len: usize) -> Result<AdamMoments<E::Array>, E::Error> {
    Ok(AdamMoments { mean: zeros(exec, len)?, square: zeros(exec, len)? })
}

fn upload_sky<E: Renderer>(exec: &mut E) -> Result<(Environment<E::Array>, AdamMoments<E::Array>), E::Error> {
    let sky = environment(LIGHT);
    Ok((sky.with_values(exec.upload(&sky.values)?), zero_moments(exec, sky.values.len())?))
}
