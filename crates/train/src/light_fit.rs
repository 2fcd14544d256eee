//! Fit of a light to pictures of a scene whose geometry and materials are known: a training in
//! which only the light moves.

use crate::{
    initial_state::initial_state,
    profile::{Densification, LightStart, NearFieldSchedule, PhysicalSchedule, Profile, Rates, by_name},
    trainer::Settings,
};
use specula_core::{
    environment::number_of,
    loss::LossWeights,
    near_field::NearField,
    optimise::Schedule,
    prefilter::PrefilterScheme,
    scene::{Environment, Gaussians, Layout, RadianceActivation},
    shade::ShadingRules,
    state::TrainingState,
};

/// Learning rate of the light until it cools; that of a training.
const RATE: f32 = 2e-2;
/// Share of the fit after which the rate falls to zero.
const COOL_FROM: f32 = 0.5;
/// Initial radiance.
const RADIANCE: f32 = 0.5;

/// Settings of a fit to a scene with physical materials, for a light of a resolution. Pictures
/// saturate at white.
///
/// # Panics
///
/// If the layout has no physical materials.
pub fn settings(
    layout: Layout,
    (shading, scheme): (ShadingRules, PrefilterScheme),
    resolution: usize,
    iterations: u32,
    background: [f32; 3],
) -> Settings {
    assert!(layout.is_physical, "only physical materials are valid under another light");
    let base = by_name("specula", iterations).expect("a profile of that name");
    let resting = base.rates.map(|_| Schedule::constant(0.0));
    let profile = Profile {
        name: "fit-light",
        layout,
        shading,
        scheme,
        light: Some(LightStart {
            resolution,
            activation: RadianceActivation::Exponential,
            radiance: RADIANCE,
            radiance_max: f32::INFINITY,
        }),
        weights: LossWeights { absolute: 0.8, dssim: 0.2, saturates: true, ..LossWeights::NONE },
        objects: None,
        physical: Some(PhysicalSchedule { from: 0.0, every: 1, only_from: 0.0, ..PhysicalSchedule::DEFAULT }),
        // The surface is that of the state and never due.
        near_field: Some(NearFieldSchedule { from: 2.0, ..NearFieldSchedule::DEFAULT }),
        coarse_until: 0.0,
        rates: Rates { environment: Schedule::constant(RATE), ..resting },
        cool_from: COOL_FROM,
        densification: Densification {
            from: u32::MAX,
            until: u32::MAX,
            every: 1_000_000,
            reset_every: 0,
            ..base.densification
        },
        ..base
    };
    Settings { profile, iterations, seed: 0, background, random_points: 0 }
}

/// Uniform light before a fit.
pub fn uniform_light(resolution: usize) -> Environment<Vec<f32>> {
    let activation = RadianceActivation::Exponential;
    let empty = Environment { resolution, activation, values: Vec::new() };
    Environment { values: vec![number_of(activation, RADIANCE); empty.len_of_values()], ..empty }
}

/// State of a fit before its first step.
pub fn state(
    gaussians: Gaussians<Vec<f32>>,
    light: Environment<Vec<f32>>,
    near_field: Option<NearField<Vec<f32>>>,
) -> TrainingState<Vec<f32>> {
    TrainingState { near_field, ..initial_state(gaussians, Some(light), 1, None) }
}
