//! Scene on the device, shared by the viewer, which sets its lights, and the page's requests.

use specula_core::{
    camera::Camera,
    pack::Storage,
    rules::RenderRules,
    scene::{Environment, Image},
};
use specula_gpu::{GpuError, GpuExecutor};
use specula_scene::{RenderBackend, Scene, SceneError, UploadedScene, lamps::SceneLamps};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Scene on the device.
#[derive(Clone, Debug)]
pub(crate) struct SharedScene(Arc<Mutex<UploadedScene<GpuExecutor<Storage>>>>);

impl SharedScene {
    pub(crate) fn new(scene: UploadedScene<GpuExecutor<Storage>>) -> Self {
        Self(Arc::new(Mutex::new(scene)))
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, UploadedScene<GpuExecutor<Storage>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RenderBackend for SharedScene {
    /// Frames are rendered by the page's requests, which do not block.
    fn render(&mut self, _: usize, _: &Camera, _: &RenderRules) -> Result<Image<Vec<f32>>, SceneError> {
        Err(GpuError::Refused { reason: "pictures of a page are read later".to_owned() }.into())
    }

    fn set_light(&mut self, slot: usize, light: &Environment<Vec<f32>>, rules: &RenderRules) -> Result<(), SceneError> {
        self.lock().set_light(slot, light, rules)
    }

    fn add_lamps(&mut self, slot: usize, lamps: &SceneLamps) -> Result<(), SceneError> {
        self.lock().add_lamps(slot, lamps)
    }

    fn set_scene(&mut self, scene: &Scene) -> Result<(), SceneError> {
        self.lock().set_scene(scene)
    }
}
