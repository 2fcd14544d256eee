//! Materials and light of a model against the ground truth of its data set.

use crate::{failure::Failure, progress};
use core::borrow::Borrow;
use glam::Vec3;
use specula_core::camera::Camera;
use specula_io::{materials::Materials, model_folder::ModelInfo};
use specula_report::{
    light::{self, LightPair, LightQuality},
    materials::MaterialQuality,
};
use specula_scene::{RenderOptions, Scene, SceneError, light_file::MapUp, orientation};
use std::path::Path;

/// Up direction of a scene: the recorded one, else the estimate from cameras, else +z.
pub(crate) fn up_of<'a>(info: Option<&ModelInfo>, cameras: impl Iterator<Item = &'a Camera> + Clone) -> Vec3 {
    orientation::recorded_or_estimated(info, cameras).map_or(Vec3::Z, |found| orientation::up(&found))
}

/// Measures the materials of a scene ([`MaterialQuality::measure`]), with progress.
pub(crate) fn measure_materials<T: Borrow<Materials>>(
    scene: &Scene,
    options: &RenderOptions,
    cameras: &[Camera],
    truth: impl FnMut(usize) -> Result<T, SceneError>,
) -> Result<Option<MaterialQuality>, Failure> {
    let work = progress::work("measuring materials", cameras.len() as u64);
    let progress = |done| work.done(done as u64, String::new);
    let measured = MaterialQuality::measure(scene, options, cameras, truth, progress)?;
    work.finish();
    Ok(measured)
}

/// Compares the learned light of a scene of physical materials with the true one of a data set;
/// `None` if either is missing. `up` is the scene's up direction.
pub(crate) fn measure_light(
    scene: &Scene,
    dataset: &Path,
    up: Vec3,
) -> Result<Option<(LightPair, LightQuality)>, Failure> {
    if !scene.gaussians.layout.is_physical {
        return Ok(None);
    }
    let orientation = MapUp::Scene.orientation(up);
    let (compared, warnings) = light::compare_with_truth(scene.light.as_ref(), dataset, orientation)?;
    warnings.iter().for_each(|warning| tracing::info!("{warning}"));
    Ok(compared)
}
