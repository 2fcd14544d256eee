//! State of a training before its first step, and whether a state belongs to a training.

use crate::{
    profile::{KnownLight, Profile},
    trainer::Settings,
};
use specula_core::{
    environment::number_of,
    light_network::initial_weight,
    scene::{Environment, Gaussians, len_of_values},
    state::{AdamMoments, ExposureState, FittedLight, SceneState, Statistics, TrainingState},
};

/// State before the first step: all lights are the same, moments and statistics are zero.
pub(crate) fn initial_state(
    gaussians: Gaussians<Vec<f32>>,
    environment: Option<Environment<Vec<f32>>>,
    light_count: usize,
    exposures: Option<ExposureState>,
) -> TrainingState<Vec<f32>> {
    let zeros = |len: usize| AdamMoments { mean: vec![0.0; len], square: vec![0.0; len] };
    let with_moments = |light: Environment<Vec<f32>>| {
        let moments = zeros(light.values.len());
        (light, moments)
    };
    let scene = SceneState {
        moments: zeros(gaussians.values.len()),
        statistics: Statistics { grad_sum: vec![0.0; gaussians.count], view_count: vec![0.0; gaussians.count] },
        light: environment.map(with_moments),
        gaussians,
    };
    let other_lights = scene.light.iter().cycle().take(light_count - 1).cloned().collect();
    let (near_field, order) = (None, Vec::new());
    TrainingState { scene, other_lights, near_field, exposures, order, iteration: 0, psnr: None, nonfinite: 0 }
}

/// Compares a state with the settings and the numbers of views and lights; the error names the
/// first mismatch.
pub(crate) fn check_state(
    state: &TrainingState<Vec<f32>>,
    settings: &Settings,
    view_count: usize,
    light_count: usize,
) -> Result<(), &'static str> {
    let SceneState { gaussians: Gaussians { count, layout, values }, moments, statistics, light } = &state.scene;
    let profile = &settings.profile;
    let has_moments =
        |moments: &AdamMoments<Vec<f32>>, len: usize| [moments.mean.len(), moments.square.len()] == [len; 2];
    let is_light = |(light, moments): &FittedLight<Vec<f32>>| {
        let len = light.len_of_values();
        profile.light.is_some_and(|start| {
            (light.resolution, light.activation) == (start.resolution, start.activation)
                && light.values.len() == len
                && has_moments(moments, len)
        })
    };
    let lights = || light.iter().chain(&state.other_lights);
    let expected_lights = if profile.light.is_some() { light_count } else { 0 };
    let are_exposures = match (&state.exposures, profile.exposure) {
        (Some(ExposureState { maps, moments }), Some(_)) => {
            [maps.len(), moments.mean.len(), moments.square.len()] == [view_count; 3]
        }
        (None, None) => true,
        _ => false,
    };
    let Statistics { grad_sum, view_count: seen } = statistics;
    let checks = [
        (*layout == profile.layout, "the Gaussians have other attributes"),
        (values.len() == len_of_values(*count, *layout), "numbers of Gaussians are missing"),
        (has_moments(moments, values.len()), "moments of Gaussians are missing"),
        ([grad_sum.len(), seen.len()] == [*count; 2], "statistics of Gaussians are missing"),
        (lights().all(is_light) && light.is_some() == profile.light.is_some(), "the light is another"),
        (lights().count() == expected_lights, "the lights are those of other groups of pictures"),
        (state.near_field.is_none() || profile.near_field.is_some(), "there is a surface for reflections"),
        (are_exposures, "the exposures are of other photographs"),
        (state.order.iter().all(|view| (*view as usize) < view_count), "there are fewer views"),
    ];
    checks.into_iter().find(|(fits, _)| !fits).map_or(Ok(()), |(_, what)| Err(what))
}

/// Light before the first step, if the profile has one.
pub(crate) fn initial_light(profile: &Profile, seed: u64) -> Option<Environment<Vec<f32>>> {
    /// Radiance below which a known light counts as black.
    const BLACK: f32 = 1e-6;
    let start = profile.light?;
    let number = number_of(start.activation, start.radiance);
    let empty = Environment { resolution: start.resolution, activation: start.activation, values: Vec::new() };
    if let Some(KnownLight(radiance)) = &profile.known_light {
        let values = radiance.iter().map(|radiance| number_of(start.activation, radiance.max(BLACK))).collect();
        return Some(Environment { values, ..empty });
    }
    let first = |index| if empty.is_network() { initial_weight(index, number, seed) } else { number };
    let values = (0..empty.len_of_values()).map(first).collect();
    Some(Environment { values, ..empty })
}
