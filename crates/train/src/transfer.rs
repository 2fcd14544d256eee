//! Copies of a scene between the host and an executor.

use specula_core::{
    executor::Executor,
    scene::{Environment, Gaussians, len_of_values},
    state::{AdamMoments, FittedLight, SceneState, Statistics, TrainingState},
};

/// Uploads a scene with its moments and statistics.
pub(crate) fn upload_scene<E: Executor>(
    exec: &mut E,
    scene: &SceneState<Vec<f32>>,
) -> Result<SceneState<E::Array>, E::Error> {
    let SceneState { gaussians, moments, statistics, light } = scene;
    let light = light.as_ref().map(|light| upload_fitted_light(exec, light)).transpose()?;
    let mut upload = |values| exec.upload_gaussians(&gaussians.with_values(values));
    Ok(SceneState {
        light,
        gaussians: upload(&gaussians.values)?,
        moments: AdamMoments { mean: upload(&moments.mean)?.values, square: upload(&moments.square)?.values },
        statistics: Statistics {
            grad_sum: exec.upload(&statistics.grad_sum)?,
            view_count: exec.upload(&statistics.view_count)?,
        },
    })
}

/// Downloads a scene with its moments and statistics.
pub(crate) fn download_scene<E: Executor>(
    exec: &mut E,
    scene: &SceneState<E::Array>,
) -> Result<SceneState<Vec<f32>>, E::Error> {
    let SceneState { gaussians, moments, statistics, light } = scene;
    Ok(SceneState {
        light: light.as_ref().map(|light| download_fitted_light(exec, light)).transpose()?,
        gaussians: download_gaussians(exec, gaussians)?,
        moments: download_moments(exec, moments, len_of_values(gaussians.count, gaussians.layout))?,
        statistics: Statistics {
            grad_sum: download(exec, &statistics.grad_sum, gaussians.count)?,
            view_count: download(exec, &statistics.view_count, gaussians.count)?,
        },
    })
}

/// Uploads a light with its moments.
pub(crate) fn upload_fitted_light<E: Executor>(
    exec: &mut E,
    (light, moments): &FittedLight<Vec<f32>>,
) -> Result<FittedLight<E::Array>, E::Error> {
    let light = light.with_values(exec.upload(&light.values)?);
    Ok((light, AdamMoments { mean: exec.upload(&moments.mean)?, square: exec.upload(&moments.square)? }))
}

/// Downloads a light with its moments.
pub(crate) fn download_fitted_light<E: Executor>(
    exec: &mut E,
    (light, moments): &FittedLight<E::Array>,
) -> Result<FittedLight<Vec<f32>>, E::Error> {
    Ok((download_light(exec, light)?, download_moments(exec, moments, light.len_of_values())?))
}

/// Copy of a state, with its scene and the other lights in other memory.
pub(crate) fn with_scene<A, B>(
    state: &TrainingState<A>,
    scene: SceneState<B>,
    other_lights: Vec<FittedLight<B>>,
) -> TrainingState<B> {
    let TrainingState { near_field, exposures, order, iteration, psnr, nonfinite, .. } = state;
    TrainingState {
        scene,
        other_lights,
        near_field: near_field.clone(),
        exposures: exposures.clone(),
        order: order.clone(),
        iteration: *iteration,
        psnr: *psnr,
        nonfinite: *nonfinite,
    }
}

/// Downloads Gaussians.
pub(crate) fn download_gaussians<E: Executor>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
) -> Result<Gaussians<Vec<f32>>, E::Error> {
    let len = len_of_values(gaussians.count, gaussians.layout);
    Ok(gaussians.with_values(download(exec, &gaussians.values, len)?))
}

/// Downloads a light.
pub(crate) fn download_light<E: Executor>(
    exec: &mut E,
    light: &Environment<E::Array>,
) -> Result<Environment<Vec<f32>>, E::Error> {
    Ok(light.with_values(download(exec, &light.values, light.len_of_values())?))
}

/// Downloads an array of `len` numbers.
pub(crate) fn download<E: Executor>(exec: &mut E, array: &E::Array, len: usize) -> Result<Vec<f32>, E::Error> {
    let mut values = vec![0.0; len];
    exec.download(array, &mut values)?;
    Ok(values)
}

/// Downloads moments of `len` numbers.
pub(crate) fn download_moments<E: Executor>(
    exec: &mut E,
    moments: &AdamMoments<E::Array>,
    len: usize,
) -> Result<AdamMoments<Vec<f32>>, E::Error> {
    Ok(AdamMoments { mean: download(exec, &moments.mean, len)?, square: download(exec, &moments.square, len)? })
}
