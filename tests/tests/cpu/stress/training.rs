//! Trainings of scenes in unusual units, of Gaussians of very different size, and under a sun.

use super::assert_at_most;
use specula_core::{
    camera::{Camera, near_of},
    executor::Renderer,
    metrics::quantize,
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules},
    scene::{LOG_SCALE, Layout, RadianceActivation},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_tests::strategies::{random_cloud, random_environment};
use specula_train::{
    evaluate::{mean_quality, measure_view, render_view},
    profile::by_name,
    start::{Point, gaussians, random_points},
    trainer::{Settings, Trainer},
    view::{View, extent_of},
};
use std::sync::OnceLock;

/// By how much a training may end below its twin, in dB.
const AS_GOOD: f64 = 0.2;
/// By how much the mean PSNR of the pictures of a training may fall below the highest that it had,
/// in dB.
const FALL: f64 = 1.0;
const SIZE: u32 = 40;
const VIEWS: usize = 16;
/// Views that are measured.
const UNSEEN: usize = 6;
const POINTS: u64 = 400;
const ITERATIONS: u32 = 100;

/// Units of the fitted scene, and the radiance of a spot of its light.
#[derive(Clone, Copy, Debug)]
struct Scene {
    unit: f32,
    sun: f32,
}

/// Scene of units of one.
const TWIN: Scene = Scene { unit: 1.0, sun: 2.0 };

impl Scene {
    /// A cloud that shines, seen from places on a circle around it.
    fn views(&self, numbers: core::ops::RangeInclusive<usize>) -> Vec<View> {
        let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
        let cloud = random_cloud(60, Layout::shaded(Some(1)), 21);
        let mut environment = random_environment(16, RadianceActivation::Identity, 21);
        environment.values[3 * 1000..][..3].fill(self.sun);
        let mut exec = CpuExecutor::new();
        let light = exec.prefilter(&environment, rules.scheme, rules.levels).expect("16 is a power of two");
        let mut view = |number: usize| {
            let camera = camera(number);
            let image = render_view(&mut exec, &cloud, Some(&light), &camera, &rules).expect("the CPU renders");
            let camera = Camera { position: camera.position * self.unit, ..camera };
            View { name: number.to_string(), camera, rgba: straight(&image.values), unclipped: None, normals: None }
        };
        numbers.map(&mut view).collect()
    }

    /// Those of a training.
    fn seen(&self) -> Vec<View> {
        self.views(1..=VIEWS)
    }

    fn points(&self) -> Vec<Point> {
        let place = |k: u64, axis: u64| 1.6 * (random::uniform(1, axis, k) - 0.5) * self.unit;
        (0..POINTS).map(|k| Point { position: [place(k, 0), place(k, 1), place(k, 2)], color: [0.5; 3] }).collect()
    }

    /// Mean PSNR of views that a training did not see, in dB.
    fn quality(&self, trainer: &mut Trainer<CpuExecutor>) -> f64 {
        let (scene, settings) = (trainer.download().expect("the CPU gives back"), trainer.settings().clone());
        let numbers = scene.gaussians.values.iter().chain(scene.environment.iter().flat_map(|light| &light.values));
        assert!(numbers.into_iter().all(|x| x.is_finite()), "a number is not finite");
        let (mut exec, profile) = (CpuExecutor::new(), &settings.profile);
        let rules = RenderRules::full(profile.shading, profile.scheme, Channels::Color);
        let light = scene.environment.as_ref();
        let light =
            light.map(|light| exec.prefilter(light, rules.scheme, rules.levels).expect("it was filtered before"));
        let near = near_of(extent_of(&self.seen()));
        let unseen = self.views(VIEWS + 1..=VIEWS + UNSEEN).into_iter().map(|view| {
            let camera = Camera { near, ..view.camera };
            let image = render_view(&mut exec, &scene.gaussians, light.as_ref(), &camera, &rules);
            measure_view(&image.expect("the CPU renders"), &view, settings.background)
        });
        mean_quality(&unseen.collect::<Vec<_>>()).psnr
    }
}

fn camera(number: usize) -> Camera {
    let turn = number as f32 * 0.7;
    let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 1.0);
    Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, SIZE, SIZE)
}

/// Premultiplied planes and transmittance as bytes of straight colours and alpha.
fn straight(planes: &[f32]) -> Vec<u8> {
    let size = (SIZE * SIZE) as usize;
    let pixel = |pixel: usize| {
        let alpha = 1.0 - planes[3 * size + pixel];
        let straight = |c: usize| quantize(planes[c * size + pixel] / alpha.max(1e-3));
        [straight(0), straight(1), straight(2), quantize(alpha)]
    };
    (0..size).flat_map(pixel).collect()
}

fn settings(name: &str, iterations: u32) -> Settings {
    let mut profile = by_name(name, iterations).expect("a profile of that name");
    // Each decision to split or to clone moves all that follow, and with it the quality by half a
    // decibel.
    profile.densification.until = 0;
    if let Some(light) = &mut profile.light {
        light.resolution = 16;
    }
    Settings { profile, iterations, seed: 3, background: [1.0; 3], random_points: 0 }
}

/// The quality of a training from these points, all of whose gradients are finite.
fn trained(scene: Scene, points: &[Point], settings: &Settings) -> f64 {
    let mut trainer =
        Trainer::new(CpuExecutor::new(), settings.clone(), &scene.seen(), points).expect("there are views");
    while !trainer.is_finished() {
        trainer.step().expect("the CPU trains");
    }
    assert_eq!(trainer.nonfinite(), 0, "{scene:?}: every gradient is finite");
    scene.quality(&mut trainer)
}

/// Quality of the scene of units of one, which is trained once.
fn twin() -> f64 {
    static TRAINED: OnceLock<f64> = OnceLock::new();
    *TRAINED.get_or_init(|| trained(TWIN, &TWIN.points(), &settings("specula", ITERATIONS)))
}

#[test]
fn scenes_in_any_units_train_as_well_as_in_units_of_one() {
    for unit in [1e-4, 1e4] {
        let scene = Scene { unit, ..TWIN };
        let own = trained(scene, &scene.points(), &settings("specula", ITERATIONS));
        println!("units of {unit:e}: {own:.3} dB, in units of one {:.3} dB", twin());
        assert_at_most("what units cost, in dB", twin() - own, AS_GOOD);
    }
}

#[test]
fn random_points_fill_scenes_in_any_units() {
    for unit in [1e-4, 1.0, 1e4] {
        let views = Scene { unit, ..TWIN }.seen();
        let points = random_points(200, &views, 1);
        let farthest = points.iter().flat_map(|point| point.position).fold(0.0_f32, |most, x| most.max(x.abs()));
        assert!(farthest > 0.3 * unit && farthest < 3.0 * unit, "units of {unit:e}: up to {farthest:e}");
    }
}

#[test]
fn gaussians_of_very_different_size_train_as_well_as_equal_ones() {
    let settings = settings("specula", 3 * ITERATIONS);
    let twin = trained(TWIN, &TWIN.points(), &settings);
    // A cluster of a thousandth of the scene's size, and some points that Gaussians as large as the
    // scene start from.
    let mut points = TWIN.points();
    let draw = |k: u64, axis: u64| random::uniform(2, axis, k) - 0.5;
    let scattered = |k: u64, size: f32| Point { position: [0, 1, 2].map(|axis| size * draw(k, axis)), color: [0.5; 3] };
    points.extend((0..100).map(|k| scattered(k, 1e-3)));
    points.extend((100..110).map(|k| scattered(k, 10.0)));
    let start = gaussians(&points, &settings.profile, 1);
    let sizes = start.plane(LOG_SCALE).fold([f32::MAX, f32::MIN], |[low, high], x| [low.min(x), high.max(x)]);
    assert!(sizes[1] - sizes[0] > 1e3_f32.ln(), "sizes from e^{} to e^{}", sizes[0], sizes[1]);
    let own = trained(TWIN, &points, &settings);
    println!("sizes from {:.0e} to {:.0e}: {own:.3} dB, equal ones {twin:.3} dB", sizes[0].exp(), sizes[1].exp());
    assert_at_most("what different sizes cost, in dB", twin - own, AS_GOOD);
}

/// Pictures under a sun are whiter, and therefore come out better.
#[test]
fn a_sun_of_ten_thousand_trains_as_well_as_a_lamp() {
    let sunny = Scene { sun: 1e4, ..TWIN };
    let own = trained(sunny, &sunny.points(), &settings("specula", ITERATIONS));
    println!("under a sun: {own:.3} dB, under a lamp {:.3} dB", twin());
    assert_at_most("what a sun costs, in dB", twin() - own, AS_GOOD);
}

#[test]
fn an_opacity_reset_is_recovered_within_300_steps() {
    const RESET: u32 = 100;
    let mut settings = settings("3dgs", RESET + 300);
    settings.profile.densification.reset_every = RESET;
    settings.profile.densification.until = RESET + 1;
    let mut trainer =
        Trainer::new(CpuExecutor::new(), settings, &TWIN.seen(), &TWIN.points()).expect("there are views");
    let mut to = |step: u32| {
        while trainer.iteration() < step {
            trainer.step().expect("the CPU trains");
        }
        TWIN.quality(&mut trainer)
    };
    let [before, after, last] = [RESET - 1, RESET, RESET + 300].map(&mut to);
    println!("reset: {before:.2} dB before, {after:.2} dB after, {last:.2} dB 300 steps later");
    assert!(after < before - 0.5, "a reset is seen");
    assert_at_most("what a reset costs in the end, in dB", before - last, 0.0);
}

/// In small units, with all that happens in a training.
#[test]
fn no_phase_of_a_training_loses_quality() {
    let scene = Scene { unit: 1e-4, ..TWIN };
    let mut settings = settings("specula", 2 * ITERATIONS);
    settings.profile.densification = by_name("specula", 2 * ITERATIONS).expect("a profile").densification;
    settings.profile.densification.every = 20;
    let mut trainer =
        Trainer::new(CpuExecutor::new(), settings, &scene.seen(), &scene.points()).expect("there are views");
    let (mut highest, mut fall) = (f64::NEG_INFINITY, 0.0);
    while !trainer.is_finished() {
        trainer.step().expect("the CPU trains");
        let now = trainer.psnr().expect("a step was taken");
        highest = f64::max(highest, now);
        fall = f64::max(fall, highest - now);
    }
    assert_eq!(trainer.nonfinite(), 0, "every gradient is finite");
    assert!(trainer.gaussians().count as u64 > POINTS, "densification took part");
    assert_at_most("fall below the best, in dB", fall, FALL);
}
