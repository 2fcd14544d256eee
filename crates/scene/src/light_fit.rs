//! Light of pictures of a scene: geometry and materials are held, and the light is fitted.

use crate::{
    ExecutorChoice, Scene, SceneError,
    training::{Observer, Start, Training},
};
use specula_core::scene::Environment;
use specula_train::{light_fit, pictures::PictureSource, start::Point};

/// Number of times that light between surfaces is computed again, from the light so far.
const ROUNDS: u32 = 3;

/// Pictures that a light is fitted to, and how.
pub struct LightFit<'a> {
    /// Pictures under the light, with cameras in the world of the scene.
    pub pictures: &'a dyn PictureSource,
    /// Background behind transparent pictures, in sRGB.
    pub background: [f32; 3],
    /// Number of steps.
    pub iterations: u32,
    /// Executor.
    pub executor: ExecutorChoice,
}

impl core::fmt::Debug for LightFit<'_> {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(out, "LightFit({} steps)", self.iterations)
    }
}

impl Scene {
    /// Fits a light, a cube map of the resolution of other lights, to pictures of the scene by
    /// gradient descent: it starts uniform, and only the light changes. Texels that no picture
    /// shows, in a reflection or on a matte surface, hardly change.
    ///
    /// `progress` is called after each step with its number and the running mean of the PSNR in
    /// dB; if it returns false, the fit ends and the result is `None`.
    ///
    /// # Errors
    ///
    /// [`SceneError::NoMaterials`] for a scene without physical materials; failures of the
    /// executor.
    pub fn fit_light(
        &self,
        fit: &LightFit<'_>,
        progress: impl FnMut(u32, Option<f64>) -> bool,
    ) -> Result<Option<Environment<Vec<f32>>>, SceneError> {
        if !self.gaussians.layout.is_physical {
            return Err(SceneError::NoMaterials);
        }
        let resolution = self.resolution_of_others();
        let mut scene = self.clone();
        let mut light = light_fit::uniform_light(resolution);
        let mut watch = Watch { pictures: fit.pictures, progress, before: 0, is_stopped: false };
        for round in 0..ROUNDS {
            let [before, after] = [round, round + 1].map(|done| fit.iterations * done / ROUNDS);
            if before == after {
                continue;
            }
            scene.put_under(light);
            let (layout, model) = (scene.gaussians.layout, &scene.shading_model);
            let rules = (model.shading, model.scheme);
            let settings = light_fit::settings(layout, rules, resolution, after - before, fit.background);
            let start = scene.light.clone().expect("it was put under a light");
            let state = light_fit::state(scene.gaussians.clone(), start, scene.near_field().cloned());
            let start = Start::Checkpoint(&state);
            watch.before = before;
            let mut training = Training::new(&fit.executor, settings, fit.pictures, &start, &mut watch)?;
            if training.run(&[], &mut watch)?.is_interrupted {
                return Ok(None);
            }
            light = training.scene()?.light.expect("a fit has a light");
        }
        Ok(Some(light))
    }
}

/// Observer of a fit, which ends with a failure of its device.
struct Watch<'a, F> {
    pictures: &'a dyn PictureSource,
    progress: F,
    /// Steps of earlier rounds.
    before: u32,
    is_stopped: bool,
}

impl<F: FnMut(u32, Option<f64>) -> bool> Observer for Watch<'_, F> {
    type Error = SceneError;

    fn is_device_failure(_: &SceneError) -> bool {
        false
    }
    fn origin(&self) -> (&dyn PictureSource, &[Point]) {
        (self.pictures, &[])
    }
    fn is_interrupted(&self) -> bool {
        self.is_stopped
    }
    fn after_step(&mut self, training: &Training) {
        self.is_stopped |= !(self.progress)(self.before + training.iteration(), training.psnr());
    }
    fn note(&mut self, note: crate::training::Note<SceneError>) {
        if self.before == 0 {
            tracing::info!("{note}");
        }
    }
}
