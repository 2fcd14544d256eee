//! Whole trainings on the GPU executor, against those on the CPU executor and against themselves.

use core::{cell::RefCell, ops::RangeInclusive};
use specula_core::{
    camera::Camera,
    executor::{Executor, Renderer},
    expose::{Exposure, expose},
    metrics::quantize,
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules},
    scene::{BLOCK, Gaussians, Layout, RadianceActivation},
    shade::ShadingRules,
    state::{AdamMoments, Statistics},
    vector::vec3,
};
use specula_cpu::{CpuExecutor, stages::prefilter::Light};
use specula_gpu::{
    GpuExecutor, KernelSet, SplatGrads,
    stages::blend_vjp::{ReplayDivision, formulas::GEOMETRY},
};
use specula_tests::{
    device::{executor, executor_in_chunks_of},
    strategies::{random_cloud, random_environment},
};
use specula_train::{
    evaluate::{mean_quality, measure_view, render_view},
    exchange::{RANK_TIMEOUT, threads},
    profile::{Profile, by_name, exposure_rate},
    start::Point,
    trainer::{HostScene, Settings, Trainer},
    view::View,
};
use std::sync::LazyLock;

/// Tolerance in dB between two trainings that start equal and diverge by rounding.
const SAME_QUALITY: f64 = 0.05;
/// The same for deferred shading: the CPU executor's own results lie 0.09 dB apart once the points
/// that it starts from are moved by 1e-7.
const SAME_QUALITY_OF_MIRRORS: f64 = 0.15;
/// Number of trainings on the CPU executor, each from slightly moved points, that measure the
/// spread of results with densification, where each decision affects all that follow.
const GROWN: u64 = 6;
/// By so much, of the scene's size.
const MOVED: f32 = 1e-6;
const SIZE: u32 = 48;
const VIEWS: usize = 20;
/// Views that are measured.
const UNSEEN: usize = 6;
const POINTS: u64 = 400;
const ITERATIONS: u32 = 200;

/// Views 1 to `VIEWS + UNSEEN`, rendered once for all tests of a process.
static ALL_VIEWS: LazyLock<Vec<View>> = LazyLock::new(|| {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let environment = random_environment(16, RadianceActivation::Exponential, 21);
    let mut exec = CpuExecutor::new();
    let light = exec.prefilter(&environment, rules.scheme, rules.levels).expect("16 is a power of two");
    (1..=VIEWS + UNSEEN).map(|number| rendered_view(&mut exec, &light, &rules, number)).collect()
});

/// Copy of a view, counted from 1.
fn view(number: usize) -> View {
    ALL_VIEWS[number - 1].clone()
}

fn views(numbers: RangeInclusive<usize>) -> Vec<View> {
    numbers.map(view).collect()
}

/// Rendered view of a cloud from a place on a circle around it.
fn rendered_view(exec: &mut CpuExecutor, light: &Light, rules: &RenderRules, number: usize) -> View {
    let turn = number as f32 * 0.7;
    let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 1.0);
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, SIZE, SIZE);
    let cloud = random_cloud(60, Layout::shaded(Some(1)), 21);
    let image = render_view(exec, &cloud, Some(light), &camera, rules).expect("the CPU renders");
    let size = (SIZE * SIZE) as usize;
    let rgba = (0..size).flat_map(|pixel| {
        let alpha = 1.0 - image.values[3 * size + pixel];
        let straight = |c: usize| quantize(image.values[c * size + pixel] / alpha.max(1e-3));
        [straight(0), straight(1), straight(2), quantize(alpha)]
    });
    View { name: number.to_string(), camera, rgba: rgba.collect(), unclipped: None, normals: None }
}

fn settings(name: &str) -> Settings {
    settings_for(name, ITERATIONS)
}

/// Lets the rates of the default profile fall to a tenth, as in trainings of 7000 iterations: the
/// scatter of the last steps of shorter ones is not to be compared.
fn settle(profile: &mut Profile, iterations: u32) {
    if profile.name == "specula" {
        profile.rates = profile.rates.falling(0.1, iterations);
    }
}

fn settings_for(name: &str, iterations: u32) -> Settings {
    let mut profile = by_name(name, iterations).expect("a profile of that name");
    profile.densification.every = 20;
    settle(&mut profile, iterations);
    if let Some(light) = &mut profile.light {
        light.resolution = profile.scheme.resolution_min();
    }
    Settings { profile, iterations, seed: 3, background: [1.0; 3], random_points: 0 }
}

/// Points that a training starts from, moved in one of many ways; 0 for not at all.
fn points(variant: u64) -> Vec<Point> {
    let moved = |k: u64, axis: u64| if variant == 0 { 0.0 } else { MOVED * random::uniform(1 + variant, axis, k) };
    let place = |k: u64, axis: u64| 1.6 * (random::uniform(1, axis, k) - 0.5) + moved(k, axis);
    (0..POINTS).map(|k| Point { position: [place(k, 0), place(k, 1), place(k, 2)], color: [0.5; 3] }).collect()
}

/// Training of a number of steps.
fn train<E: Executor>(exec: E, settings: Settings, steps: u32) -> (HostScene, usize) {
    train_with(exec, settings, &points(0), steps, |_, _| ())
}

/// Training of a number of steps; a hook runs on the executor before each of them.
fn train_with<E: Executor>(
    exec: E,
    settings: Settings,
    points: &[Point],
    steps: u32,
    before: impl Fn(&mut E, u32),
) -> (HostScene, usize) {
    let views = views(1..=VIEWS);
    let mut trainer = Trainer::new(exec, settings, &views, points).expect("there are views");
    for step in 0..steps {
        before(trainer.executor(), step);
        trainer.step().expect("the executor trains");
    }
    (trainer.download().expect("the executor gives back"), trainer.nonfinite())
}

/// Mean PSNR of views that no training saw, in dB.
fn quality(exec: &mut CpuExecutor, scene: &HostScene, settings: &Settings) -> f64 {
    quality_on(exec, scene, settings, &views(VIEWS + 1..=VIEWS + UNSEEN))
}

fn quality_on(exec: &mut CpuExecutor, scene: &HostScene, settings: &Settings, views: &[View]) -> f64 {
    let profile = &settings.profile;
    let rules = RenderRules::full(profile.shading, profile.scheme, Channels::Color);
    let light = scene.environment.as_ref();
    let light = light.map(|light| exec.prefilter(light, rules.scheme, rules.levels).expect("it was filtered before"));
    let measured = views.iter().map(|view| {
        let image = render_view(exec, &scene.gaussians, light.as_ref(), &view.camera, &rules);
        measure_view(&image.expect("the CPU renders"), view, settings.background)
    });
    mean_quality(&measured.collect::<Vec<_>>()).psnr
}

#[test]
fn trainings_on_both_executors_end_as_good() {
    /// Fewer than other trainings take, since they are of three profiles.
    const STEPS: u32 = 90;
    for (name, apart) in [("3dgs", SAME_QUALITY), ("paper", SAME_QUALITY), ("specula", SAME_QUALITY_OF_MIRRORS)] {
        let mut settings = settings_for(name, STEPS);
        settings.profile.densification.until = 0;
        compare(&settings, apart);
    }
}

#[test]
fn trainings_under_a_network_end_as_good_on_both_executors_and_the_same_twice() {
    /// Fewer than other trainings take: a software driver needs a second for each.
    const STEPS: [u32; 2] = [40, 8];
    let mut settings = settings_for("paper", STEPS[0]);
    settings.profile = settings.profile.with_light_network(STEPS[0]);
    settings.profile.densification.until = 0;
    compare(&settings, SAME_QUALITY);
    let Some(gpu) = executor() else { return };
    let (once, _) = train(gpu, settings.clone(), STEPS[1]);
    let (twice, _) = train(executor().expect("there was one before"), settings, STEPS[1]);
    assert!(once.environment.as_ref().is_some_and(|light| light.is_network()), "the light is a network");
    assert!(once == twice, "a second run differs");
}

#[test]
fn trainings_that_densify_end_as_good_as_they_do_when_their_points_are_moved_a_little() {
    let Some(gpu) = executor() else { return };
    let settings = settings("specula");
    let (grown, nonfinite) = train(gpu, settings.clone(), ITERATIONS);
    let mut cpu = CpuExecutor::new();
    let ours = quality(&mut cpu, &grown, &settings);
    assert_eq!(nonfinite, 0, "every gradient is finite");

    let trainings = (0..GROWN).map(|variant| {
        let (scene, _) = train_with(CpuExecutor::new(), settings.clone(), &points(variant), ITERATIONS, |_, _| ());
        (quality(&mut cpu, &scene, &settings), scene.gaussians.count)
    });
    let (qualities, counts): (Vec<f64>, Vec<usize>) = trainings.unzip();
    let low = qualities.iter().copied().fold(f64::INFINITY, f64::min);
    let high = qualities.iter().copied().fold(0.0, f64::max);
    println!("{ours:.3} and {qualities:.3?} dB, {} and {counts:?} Gaussians", grown.gaussians.count);
    let [least, most] = within(low, high);
    assert!(least < ours && ours < most, "{ours} dB on the GPU, {qualities:?} on the CPU");
    let wide_counts = counts.iter().map(|count| *count as f64);
    let [least, most] = within(wide_counts.clone().fold(f64::INFINITY, f64::min), wide_counts.fold(0.0, f64::max));
    let count = grown.gaussians.count as f64;
    assert!(least < count && count < most, "{count} Gaussians on the GPU, {counts:?} on the CPU");
}

/// Interval for one more result beside these: the range of those known, widened by its own width on
/// either side.
fn within(least: f64, most: f64) -> [f64; 2] {
    let apart = most - least;
    [least - apart, most + apart]
}

fn compare(settings: &Settings, apart: f64) {
    let Some(gpu) = executor() else { return };
    let (ours, nonfinite) = train(gpu, settings.clone(), settings.iterations);
    let (theirs, _) = train(CpuExecutor::new(), settings.clone(), settings.iterations);
    let (start, _) = train(CpuExecutor::new(), settings.clone(), 0);
    let mut cpu = CpuExecutor::new();
    let [one, other, before] = [&ours, &theirs, &start].map(|scene| quality(&mut cpu, scene, settings));
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
    for kernels in KernelSet::ALL {
        let Some(mut gpu) = executor() else { return };
        gpu.set_kernels(kernels);
        let (first, _) = train(gpu, settings("specula"), STEPS);
        let mut small = executor().expect("there was one before");
        small.set_kernels(kernels);
        let parts = small.replay_division();
        small.set_replay_division(ReplayDivision { slots_max: 100, ..parts });
        let (again, _) = train(small, settings("specula"), STEPS);
        assert_ne!(first.gaussians.count as u64, POINTS, "densification took part");
        assert!(first == again, "{kernels:?}: a second run with capacity for fewer splats at once differs");
    }
}

#[test]
fn two_ranks_with_a_device_each_train_as_one_does_to_the_last_bit() {
    const STEPS: u32 = 12;
    let Some(gpu) = executor() else { return };
    let mut settings = settings("specula");
    settings.profile = settings.profile.for_batches(3);
    let plan = &mut settings.profile.densification;
    (plan.from, plan.every) = (0, 5);
    let (expected, _) = train(gpu, settings.clone(), STEPS);
    let ranks = threads(2, RANK_TIMEOUT).into_iter().map(|exchange| {
        let settings = settings.clone();
        std::thread::spawn(move || {
            let exec = executor().expect("there was one before");
            let mut trainer = Trainer::new(exec, settings, &views(1..=VIEWS), &points(0)).expect("there are views");
            trainer.join(Box::new(exchange), "").expect("both are there");
            (0..STEPS).for_each(|_| {
                trainer.step().expect("the executor trains");
            });
            trainer.download().expect("the executor gives back")
        })
    });
    for rank in ranks.collect::<Vec<_>>() {
        assert!(rank.join().expect("no rank panics") == expected, "a rank differs");
    }
    assert_ne!(expected.gaussians.count as u64, POINTS, "densification took part");
}

/// Training of a number of steps that is interrupted after some of them, and resumes from its
/// snapshot on the other executor.
fn train_in_turns([first, second]: [GpuExecutor; 2], settings: &Settings, turns: [u32; 2]) -> (HostScene, usize) {
    let views = views(1..=VIEWS);
    let mut trainer = Trainer::new(first, settings.clone(), &views, &points(0)).expect("there are views");
    for _ in 0..turns[0] {
        trainer.step().expect("the executor trains");
    }
    let snapshot = trainer.snapshot().expect("the executor gives back");
    let mut trainer = Trainer::resume(second, settings.clone(), &views, &snapshot).expect("it is the same training");
    for _ in 0..turns[1] {
        trainer.step().expect("the executor trains");
    }
    (trainer.download().expect("the executor gives back"), trainer.gaussians().values.chunk_count())
}

#[test]
fn a_training_is_the_same_to_the_last_bit_in_pieces() {
    const TURNS: [u32; 2] = [12, 13];
    for name in ["specula", "3dgs"] {
        let mut settings = settings(name);
        let plan = &mut settings.profile.densification;
        (plan.from, plan.every, plan.reset_every) = (0, 10, 15);
        let executors = || {
            let bytes = |gaussians: usize| (4 * settings.profile.layout.plane_count() * gaussians) as u64;
            Some([executor_in_chunks_of(bytes(64))?, executor_in_chunks_of(bytes(112))?])
        };
        let (Some(gpu), Some(divided)) = (executor(), executors()) else { return };
        let (expected, _) = train(gpu, settings.clone(), TURNS.iter().sum());
        let (actual, pieces) = train_in_turns(divided, &settings, TURNS);
        assert_ne!(expected.gaussians.count as u64, POINTS, "{name}: densification took part");
        assert!(pieces > 3, "{name}: {pieces} pieces");
        assert!(actual == expected, "{name}: a training in pieces differs");
    }
}

#[test]
fn a_training_is_the_same_to_the_last_bit_whatever_the_capacity_of_its_steps() {
    const STEPS: u32 = 25;
    const CAPACITIES: [usize; 4] = [0, 1, 700, 1 << 20];
    let Some(gpu) = executor() else { return };
    let mut settings = settings("specula");
    settings.profile.densification.from = 0;
    settings.profile.exposure = Some(exposure_rate(STEPS));
    let first = train(gpu, settings.clone(), STEPS);
    let another = executor().expect("there was one before");
    let again = train_with(another, settings, &points(0), STEPS, |exec, step| {
        exec.set_pair_capacity(CAPACITIES[step as usize % CAPACITIES.len()]);
    });
    assert_ne!(first.0.gaussians.count as u64, POINTS, "densification took part");
    assert!(first == again, "steps that had to be taken again differ");
}

#[test]
fn a_step_waits_for_the_device_once() {
    let Some(gpu) = executor() else { return };
    let waits = RefCell::new(Vec::new());
    train_with(gpu, settings("specula"), &points(0), 12, |exec, _| waits.borrow_mut().push(exec.gpu().waits()));
    let waits = waits.into_inner();
    let step_waits: Vec<usize> = waits.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // The first step has none before it; some may find out that others need more than those before.
    assert!(step_waits.iter().filter(|waits| **waits == 1).count() >= 8, "{step_waits:?}");
}

#[test]
fn a_step_without_room_changes_nothing_and_says_so() {
    let Some(mut gpu) = executor() else { return };
    let cloud = random_cloud(60, Layout::radiance(0), 5);
    let camera = view(1).camera;
    let Gaussians { count, layout, values } = &cloud;
    let upload = |gpu: &mut GpuExecutor, values: &[f32]| gpu.upload(values).expect("numbers fit");
    let mut gaussians = Gaussians { count: *count, layout: *layout, values: upload(&mut gpu, values) };
    let zeros = vec![0.0; values.len()];
    let mut moments = AdamMoments { mean: upload(&mut gpu, &zeros), square: upload(&mut gpu, &zeros) };
    let mut statistics =
        Statistics { grad_sum: upload(&mut gpu, &zeros[..*count]), view_count: upload(&mut gpu, &zeros[..*count]) };
    let mut grad = values.clone();
    grad[3] = f32::NAN;
    for capacity in [0, 1 << 20] {
        gpu.set_pair_capacity(capacity);
        let splats = gpu.project(&gaussians, &camera).expect("the device projects");
        gpu.bin_for_step(&splats, &camera).expect("the device sorts");
        let planes = GEOMETRY + 3;
        let splat_grads = upload(&mut gpu, &vec![1.0; count.next_multiple_of(BLOCK) * planes]);
        let splat_grads = SplatGrads::new(3, splat_grads);
        gpu.observe(&mut statistics, &splats, &splat_grads, &camera).expect("the device adds");
        let grad = Gaussians { count: *count, layout: *layout, values: upload(&mut gpu, &grad) };
        gpu.optimise(&mut gaussians, &mut moments, grad, &vec![0.1; layout.plane_count()], 1).expect("it steps");
        // The first of both also finds the number of bits that distinguish depths.
        let report = gpu.report().expect("the device tells");
        let mut now = [values.clone(), zeros[..*count].to_vec()];
        gpu.download(&gaussians.values, &mut now[0]).expect("numbers come back");
        gpu.download(&statistics.view_count, &mut now[1]).expect("numbers come back");
        if capacity == 0 {
            assert_eq!(report, None, "the step is to be taken again");
            assert!(now == [values.clone(), zeros[..*count].to_vec()], "nothing is changed");
        } else {
            assert_eq!(report.map(|report| report.nonfinite), Some(1), "what was left out is counted once");
            assert!(now[0] != *values && now[1] != zeros[..*count], "everything is changed");
        }
    }
}

/// Steps until exposures are found: each photograph comes fifteen times.
const EXPOSED_ITERATIONS: u32 = 300;
/// Least gain of unseen views by learned exposures, in dB.
const GAINED: f64 = 3.0;
/// Remaining error of an estimated exposure, a root mean square.
const UNEXPLAINED: f32 = 0.2;

/// Exposure of a photograph: darker or brighter, a little tinted, with a veil. None is so bright
/// that colours clip.
fn exposure_of(number: usize) -> Exposure<f32> {
    let draw = |row: u64, k: u64| random::uniform(77, number as u64, 4 * row + k) - 0.5;
    let gain = 0.6 + 0.3 * draw(3, 0);
    let entry = |row: u64, k: u64| match k {
        3 => 0.06 * draw(row, k),
        _ if row == k => gain + 0.1 * draw(row, k),
        _ => 0.06 * draw(row, k),
    };
    [0, 1, 2].map(|row| [0, 1, 2, 3].map(|k| entry(row, k)))
}

/// Mean exposure of the training photographs.
fn mean_exposure() -> Exposure<f32> {
    let mut mean = [[0.0; 4]; 3];
    for number in 1..=VIEWS {
        let own = exposure_of(number);
        mean.as_flattened_mut().iter_mut().zip(own.as_flattened()).for_each(|(sum, x)| *sum += x / VIEWS as f32);
    }
    mean
}

/// A straight colour as a photograph shows it.
fn exposed(exposure: &Exposure<f32>, [r, g, b]: [f32; 3]) -> [f32; 3] {
    expose(exposure, vec3(r, g, b), 1.0).to_array()
}

/// Straight colours of a view's pixels.
fn colors_of(view: &View) -> impl Iterator<Item = [f32; 3]> + '_ {
    view.rgba.chunks_exact(4).map(|pixel| [pixel[0], pixel[1], pixel[2]].map(|byte| f32::from(byte) / 255.0))
}

/// A view as a photograph shows it.
fn photograph(number: usize, exposure: &Exposure<f32>) -> View {
    let mut view = view(number);
    let shown: Vec<[f32; 3]> = colors_of(&view).map(|color| exposed(exposure, color)).collect();
    view.rgba
        .chunks_exact_mut(4)
        .zip(shown)
        .for_each(|(pixel, color)| pixel[..3].copy_from_slice(&color.map(quantize)));
    view
}

/// Difference of the photographs from the scene under the exposures that were found, as a share of
/// their difference from the scene.
fn unexplained(found: &[Exposure<f32>]) -> f32 {
    let mean = mean_exposure();
    let (mut rest, mut all) = (0.0, 0.0);
    for (number, found) in (1..).zip(found) {
        let own = exposure_of(number);
        for color in colors_of(&view(number)) {
            let (scene, truth) = (exposed(&mean, color), exposed(&own, color));
            let square = |shown: [f32; 3]| (0..3).map(|c| (shown[c] - truth[c]).powi(2)).sum::<f32>();
            rest += square(exposed(found, scene));
            all += square(scene);
        }
    }
    (rest / all).sqrt()
}

#[test]
fn exposures_are_found_and_leave_the_scene_unchanged() {
    let mean = mean_exposure();
    let differently: Vec<View> = (1..=VIEWS).map(|number| photograph(number, &exposure_of(number))).collect();
    let unseen: Vec<View> = (VIEWS + 1..=VIEWS + UNSEEN).map(|number| photograph(number, &mean)).collect();
    let mut cpu = CpuExecutor::new();
    let mut learn = |is_exposing: bool| {
        let mut settings = settings_for("specula", EXPOSED_ITERATIONS);
        settings.profile.densification.until = 0;
        if is_exposing {
            settings.profile = settings.profile.exposing(EXPOSED_ITERATIONS);
        }
        let mut trainer =
            Trainer::new(CpuExecutor::new(), settings.clone(), &differently, &points(0)).expect("there are views");
        while !trainer.is_finished() {
            trainer.step().expect("the CPU trains");
        }
        let scene = trainer.download().expect("the CPU gives back");
        (quality_on(&mut cpu, &scene, &settings, &unseen), trainer.exposures().cloned())
    };
    let ((without, none), (with, found)) = (learn(false), learn(true));
    assert_eq!(none, None, "nothing is learned that was not asked for");
    let unexplained = unexplained(&found.expect("they were learned").maps);
    println!("{without:.2} dB, {with:.2} with exposures, which leave {unexplained:.3} unexplained");
    assert!(with > without + GAINED, "{with} dB with exposures, {without} without");
    assert!(unexplained < UNEXPLAINED, "exposures leave {unexplained}");
}
