//! A training allocates no more memory once it has seen its pictures.

use specula_core::{
    camera::Camera,
    color::Picture,
    executor::{Executor, TrainingStep},
    expose::{Exposure, IDENTITY},
    pipeline::train_step,
    rules::{Channels, RenderRules},
    scene::RadianceActivation,
    state::{AdamMoments, SceneState, Statistics},
};
use specula_cpu::CpuExecutor;
use specula_tests::strategies::{random_cloud, random_environment};
use specula_train::profile::by_name;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Allocations of the last steps of a training, when all views have been seen several times.
fn allocations(profile: &str, exposure: Option<&Exposure<f32>>) -> usize {
    let profile = by_name(profile, 100).expect("a profile of that name");
    let mut exec = CpuExecutor::new();
    let cloud = random_cloud(300, profile.layout, 3);
    let camera = |angle: f32| {
        let eye = glam::Vec3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 1.5);
        Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 96, 80)
    };
    let cameras = [1.0, 2.0, 3.0].map(camera);
    let rgba = vec![200; 96 * 80 * 4];
    let target = exec.target(&Picture::of_bytes(96, 80, &rgba)).expect("the bytes fit");
    let zeros = |len: usize| AdamMoments { mean: vec![0.0; len], square: vec![0.0; len] };
    let moments = zeros(cloud.values.len());
    let light = profile.light.map(|_| {
        let light = random_environment(16, RadianceActivation::Exponential, 3);
        let moments = zeros(light.values.len());
        (light, moments)
    });
    let statistics = Statistics { grad_sum: vec![0.0; cloud.count], view_count: vec![0.0; cloud.count] };
    let rates = vec![1e-4; cloud.layout.plane_count()];
    let channels = if cloud.layout.is_shaded() { Channels::Training } else { Channels::Color };
    let mut scene = SceneState { gaussians: cloud, moments, statistics, light };
    let rules = RenderRules::full(profile.shading, profile.scheme, channels);
    let mut counter = Region::new(ALLOCATOR);
    for number in 1..=12 {
        if number == 10 {
            counter.reset();
        }
        let step = TrainingStep {
            camera: &cameras[number as usize % cameras.len()],
            target: &target,
            background: [1.0; 3],
            exposure,
            near_field: None,
            rules: &rules,
            weights: &profile.weights,
            is_observed: true,
            rates: &rates,
            environment_rate: 1e-3,
            radiance_max: 100.0,
            number,
            light_number: number,
            own_loss: None,
        };
        train_step(&mut exec, &mut scene, &step).expect("the CPU trains");
    }
    let change = counter.change();
    change.allocations + change.reallocations
}

/// One test, so that nothing else counts.
#[test]
fn a_step_takes_no_memory_once_all_views_were_seen() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    for profile in ["3dgs", "specula", "paper"] {
        for exposure in [None, Some(&IDENTITY)] {
            let count = pool.install(|| allocations(profile, exposure));
            assert_eq!(count, 0, "{profile}: a step allocates, exposed as {exposure:?}");
        }
    }
    let counter = Region::new(ALLOCATOR);
    drop(core::hint::black_box(vec![1_u8; 10]));
    assert_eq!(counter.change().allocations, 1, "the counter counts");
}
