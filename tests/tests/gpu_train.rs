//! Whole trainings on the GPU executor, against those on the CPU executor and against themselves.

use specula_core::{
    camera::Camera,
    executor::{Executor, RenderRules, Renderer},
    metrics::quantize,
    plan::Channels,
    prefilter::PrefilterScheme,
    random,
    scene::{Layout, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::blend_vjp::ReplayParts;
use specula_tests::{
    device::executor,
    strategies::{random_cloud, random_environment},
};
use specula_train::{
    evaluate::{mean_quality, measure_view, render_view},
    profile::by_name,
    start::Point,
    trainer::{HostScene, Settings, Trainer},
    view::View,
};

/// What two trainings may end apart by, in dB: they start equal, and rounding sends them on ways of their own.
const SAME_QUALITY: f64 = 0.05;
/// And where light is looked up by pixels: the CPU executor's own results lie 0.09 dB apart once the points that it
/// starts from are moved by 1e-7.
const SAME_QUALITY_OF_MIRRORS: f64 = 0.15;
/// And where Gaussians are split and cloned, of which each decision moves all that follow: there it is 0.4 dB.
const SAME_QUALITY_OF_GROWN: f64 = 0.5;
const SIZE: u32 = 48;
const VIEWS: usize = 20;
/// Views that are measured.
const UNSEEN: usize = 6;
const POINTS: u64 = 400;
const ITERATIONS: u32 = 200;

/// A cloud that shines, seen from a place on a circle around it.
fn view(number: usize) -> View {
    let turn = number as f32 * 0.7;
    let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 1.0);
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, SIZE, SIZE);
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let (cloud, environment) =
        (random_cloud(60, Layout::shaded(Some(1)), 21), random_environment(16, RadianceActivation::Exponential, 21));
    let mut exec = CpuExecutor::new();
    let light = exec.prefilter(&environment, rules.scheme, rules.levels).expect("16 is a power of two");
    let image = render_view(&mut exec, &cloud, Some(&light), &camera, &rules).expect("the CPU renders");
    let size = (SIZE * SIZE) as usize;
    let rgba = (0..size).flat_map(|pixel| {
        let alpha = 1.0 - image.values[3 * size + pixel];
        let straight = |c: usize| quantize(image.values[c * size + pixel] / alpha.max(1e-3));
        [straight(0), straight(1), straight(2), quantize(alpha)]
    });
    View { name: number.to_string(), camera, rgba: rgba.collect(), normals: None }
}

fn settings(name: &str) -> Settings {
    let mut profile = by_name(name, ITERATIONS).expect("a profile of that name");
    profile.densification.every = 20;
    if let Some(light) = &mut profile.light {
        light.resolution = light.resolution.min(profile.scheme.resolution_min().max(16));
    }
    Settings { profile, iterations: ITERATIONS, seed: 3, background: [1.0; 3], random_points: 0 }
}

/// A training of so many steps.
fn train<E: Executor>(exec: E, settings: Settings, steps: u32) -> (HostScene, usize)
where
    E::Error: core::fmt::Debug,
{
    let views: Vec<View> = (1..=VIEWS).map(view).collect();
    let place = |k: u64, axis: u64| 1.6 * (random::uniform(1, axis, k) - 0.5);
    let points: Vec<Point> =
        (0..POINTS).map(|k| Point { position: [place(k, 0), place(k, 1), place(k, 2)], color: [0.5; 3] }).collect();
    let mut trainer = Trainer::new(exec, settings, &views, &points).expect("there are views");
    for _ in 0..steps {
        trainer.step().expect("the executor trains");
    }
    (trainer.download().expect("the executor gives back"), trainer.nonfinite())
}

/// Mean PSNR of views that no training saw, in dB.
fn quality(scene: &HostScene, settings: &Settings) -> f64 {
    let (mut exec, profile) = (CpuExecutor::new(), &settings.profile);
    let rules = RenderRules::full(profile.shading, profile.scheme, Channels::Color);
    let light = scene.environment.as_ref();
    let light = light.map(|light| exec.prefilter(light, rules.scheme, rules.levels).expect("it was filtered before"));
    let unseen = (VIEWS + 1..=VIEWS + UNSEEN).map(view).map(|view| {
        let image = render_view(&mut exec, &scene.gaussians, light.as_ref(), &view.camera, &rules);
        measure_view(&image.expect("the CPU renders"), &view, settings.background)
    });
    mean_quality(&unseen.collect::<Vec<_>>()).psnr
}

#[test]
fn trainings_on_both_executors_end_as_good() {
    for (name, apart) in [("3dgs", SAME_QUALITY), ("paper", SAME_QUALITY), ("specula", SAME_QUALITY_OF_MIRRORS)] {
        let mut settings = settings(name);
        settings.profile.densification.until = 0;
        compare(&settings, apart);
    }
}

#[test]
fn trainings_that_densify_end_as_good_as_they_do_when_their_points_are_moved_a_little() {
    compare(&settings("specula"), SAME_QUALITY_OF_GROWN);
}

fn compare(settings: &Settings, apart: f64) {
    let Some(gpu) = executor() else { return };
    let (ours, nonfinite) = train(gpu, settings.clone(), ITERATIONS);
    let (theirs, _) = train(CpuExecutor::new(), settings.clone(), ITERATIONS);
    let (start, _) = train(CpuExecutor::new(), settings.clone(), 0);
    let [one, other, before] = [&ours, &theirs, &start].map(|scene| quality(scene, settings));
    let name = settings.profile.name;
    println!("{name}: {one:.3} and {other:.3} dB, {} and {} Gaussians", ours.gaussians.count, theirs.gaussians.count);
    assert_eq!(nonfinite, 0, "{name}: every gradient is finite");
    assert!(one > before + 1.0, "{name} learns something: {before} dB at first");
    assert!((one - other).abs() < apart, "{name} ends at {one} dB on the GPU and at {other} on the CPU");
    let same_count = ours.gaussians.count.abs_diff(theirs.gaussians.count) * 50 < theirs.gaussians.count;
    assert!(same_count, "{name} ends with {} Gaussians and with {}", ours.gaussians.count, theirs.gaussians.count);
}

#[test]
fn a_training_is_the_same_to_the_last_bit_twice_and_whatever_its_buffers_hold() {
    const STEPS: u32 = 45;
    let Some(gpu) = executor() else { return };
    let (first, _) = train(gpu, settings("specula"), STEPS);
    let mut small = executor().expect("there was one before");
    let parts = small.replay_parts();
    small.set_replay_parts(ReplayParts { slots_max: 100, ..parts });
    let (again, _) = train(small, settings("specula"), STEPS);
    assert_ne!(first.gaussians.count as u64, POINTS, "densification took part");
    assert!(first == again, "a second run with room for fewer splats at once differs");
}
