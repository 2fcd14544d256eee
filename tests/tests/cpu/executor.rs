//! The CPU executor against the independent renderer, and against itself on other threads, beyond
//! what [`conformance`](super::conformance) asks of every executor.

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
use specula_core::{
    activation::{logit, sigmoid},
    camera::Camera,
    cutoffs::ALPHA_MIN,
    densify::DensifyRules,
    environment::texels,
    executor::{DensifyReport, Executor, RandomKey, Renderer},
    expose::expose,
    optimise::Schedule,
    pipeline::render,
    prefilter::PrefilterScheme,
    region::Ball,
    rules::{Channels, RenderRules},
    scene::{DIFFUSE, Gaussians, Layout, MEAN, OPACITY, RadianceActivation, TINT},
    sh,
    shade::ShadingRules,
    state::{AdamMoments, ExposureState, Statistics},
    vector::{Vec3, vec3},
};
use specula_cpu::{CpuError, CpuExecutor, frame::Frame};
use specula_tests::{
    brute,
    compare::{SAME_FRAME, assert_psnr, psnr},
    independent::{rays, surface::gaussians},
    strategies::random_cloud,
    stress::too_many_splats,
};
use specula_train::{
    profile::{NearFieldSchedule, Reflections, by_name, exposure_rate},
    start::Point,
    trainer::{HostScene, Settings, TINT_LOGIT_OFF, Trainer},
    view::View,
};
use std::sync::Arc;

/// Difference in 8 bits among the field's own renderers.
const AS_THE_FIELD_RENDERS: f64 = 50.0;
const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.3];

fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at(glam::Vec3::new(2.0, -3.0, 1.5), glam::Vec3::new(0.2, 0.0, 0.1), glam::Vec3::Z, 0.7, width, height)
}

fn rules(shading: ShadingRules, channels: Channels) -> RenderRules {
    RenderRules::full(shading, PrefilterScheme::Exact, channels)
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

#[test]
fn an_exposure_of_a_picture_is_one_of_every_gaussian() {
    /// Maps colours between 0.1 and 0.9 to positive ones, so none is clamped.
    const EXPOSURE: [[f32; 4]; 3] = [[0.7, 0.1, 0.1, 0.05], [0.2, 0.8, 0.0, 0.1], [0.0, 0.1, 0.9, 0.02]];
    let mut cloud = random_cloud(80, Layout::radiance(0), 4);
    let mut exposed = cloud.clone();
    for gaussian in 0..cloud.count {
        // The first harmonic is (colour − ½) / Y₀.
        let first = sh::basis(vec3(0.0_f32, 0.0, 1.0), 1)[0];
        let color = cloud.get::<3>(gaussian, DIFFUSE).map(|x| 0.5 + 0.4 * x.tanh());
        let [r, g, b] = color;
        let seen: Vec3<f32> = expose(&EXPOSURE, vec3(r, g, b), 1.0);
        cloud.set(gaussian, DIFFUSE, color.map(|x| (x - 0.5) / first));
        exposed.set(gaussian, DIFFUSE, seen.to_array().map(|x| (x - 0.5) / first));
    }
    let (mut exec, camera) = (CpuExecutor::new(), camera(70, 45));
    let rules = rules(ShadingRules::PAPER, Channels::Color);
    let mut picture =
        |cloud: &Gaussians<Vec<f32>>| render(&mut exec, cloud, None, &camera, &rules).expect("it renders");
    let (frame, expected) = (picture(&cloud), picture(&exposed));
    let frame = exec.expose(frame, &EXPOSURE).expect("the CPU exposes");
    let (ours, expected) = (wide(&numbers_of(&frame)), wide(&numbers_of(&expected)));
    assert_psnr(&ours, &expected, SAME_FRAME);
}

#[test]
fn more_splats_in_tiles_than_a_word_counts_are_refused() {
    let (cloud, camera) = too_many_splats();
    let mut exec = CpuExecutor::new();
    let splats = exec.project(&cloud, &camera).expect("the CPU projects");
    let refused = exec.bin(&splats, &camera).expect_err("there are 2³² and more");
    assert_eq!(refused, CpuError::TooManySplats);
}

#[test]
fn a_cancelled_picture_fails_and_the_next_one_is_unaffected() {
    let (cloud, camera) = (random_cloud(80, Layout::shaded(Some(1)), 4), camera(70, 45));
    let cancel = Arc::new(AtomicBool::new(false));
    let mut exec = CpuExecutor::new();
    exec.set_cancel(Some(cancel.clone()));
    for rules in [ShadingRules::PAPER, ShadingRules::DEFERRED].map(|shading| rules(shading, Channels::Color)) {
        let mut picture = |is_cancelled: bool| {
            cancel.store(is_cancelled, Relaxed);
            render(&mut exec, &cloud, None, &camera, &rules).map(|frame| numbers_of(&frame))
        };
        let before = picture(false).expect("the CPU renders");
        assert_eq!(picture(true), Err(CpuError::Cancelled));
        assert_eq!(picture(false), Ok(before));
    }
    // Between two stages, too.
    let frame = render(&mut exec, &cloud, None, &camera, &rules(ShadingRules::PAPER, Channels::Training));
    cancel.store(true, Relaxed);
    let rules = rules(ShadingRules::DEFERRED, Channels::Training);
    let shaded = exec.shade_pixels(frame.expect("the CPU renders"), None, &camera, &rules);
    assert_eq!(shaded.err(), Some(CpuError::Cancelled));
}

/// Channels and transmittance of a frame, plane by plane.
fn numbers_of(frame: &Frame) -> Vec<f32> {
    let [width, height] = frame.size();
    let mut numbers = vec![0.0; (frame.channel_count() + 1) * width * height];
    frame.read(&mut numbers);
    numbers
}

/// The executor's picture of a plain cloud and the independent renderer's, red then green then
/// blue.
fn both(cloud: &Gaussians<Vec<f32>>, camera: &Camera) -> [Vec<f64>; 2] {
    let mut exec = CpuExecutor::new();
    let frame =
        render(&mut exec, cloud, None, camera, &rules(ShadingRules::PAPER, Channels::Color)).expect("the CPU renders");
    let (width, height) = (camera.width as usize, camera.height as usize);
    let numbers = numbers_of(&frame);
    let (colors, passed) = numbers.split_at(3 * width * height);
    let planes = colors.chunks(width * height).zip(BACKGROUND);
    let ours = planes
        .flat_map(|(plane, behind)| plane.iter().zip(passed).map(move |(x, t)| f64::from(x + t * behind)))
        .collect();
    let picture = brute::render(&gaussians(cloud), &rays::RayView::of(camera), BACKGROUND.map(f64::from));
    [ours, [0, 1, 2].iter().flat_map(|c| picture.iter().map(|rgb| rgb[*c])).collect()]
}

#[test]
fn a_plain_cloud_renders_as_the_field_renders_it() {
    for seed in 1..4 {
        for layout in [Layout::radiance(3), Layout::radiance(3).antialiased()] {
            let [ours, independent] = both(&random_cloud(300, layout, seed), &camera(100, 80));
            println!("seed {seed}: {:.1} dB", psnr(&ours, &independent));
            assert_psnr(&ours, &independent, AS_THE_FIELD_RENDERS);
        }
    }
}

/// With `SPECULA_DATA` naming a folder with `splats/*.ply` in INRIA's layout, real scenes are
/// compared too.
#[test]
fn a_trained_ply_renders_as_the_field_renders_it() {
    let Some(folder) = std::env::var_os("SPECULA_DATA") else {
        eprintln!("skipped: SPECULA_DATA does not name a folder with splats/*.ply");
        return;
    };
    let files = std::fs::read_dir(std::path::Path::new(&folder).join("splats")).expect("the folder has splats");
    for file in files.filter_map(|entry| Some(entry.ok()?.path())) {
        let Ok(read) = specula_io::gaussian_ply::read(&file) else { continue };
        let cloud = read.gaussians;
        let middle = glam::Vec3::from([0, 1, 2].map(|k| median(cloud.plane(k).collect())));
        let eye = middle + glam::Vec3::new(0.5, -0.7, -2.5);
        let camera = Camera::look_at(eye, middle, -glam::Vec3::Y, 0.9, 400, 400);
        let [ours, independent] = both(&cloud, &camera);
        println!("{}: {:.1} dB", file.display(), psnr(&ours, &independent));
        assert_psnr(&ours, &independent, AS_THE_FIELD_RENDERS);
    }
}

fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}

/// Settings of a short training.
fn settings(name: &str) -> Settings {
    let mut profile = by_name(name, 60).expect("a profile of that name");
    profile.densification.every = 10;
    profile.exposure = (name == "specula").then(|| exposure_rate(60));
    Settings { profile, iterations: 60, seed: 3, background: [1.0; 3], random_points: 0 }
}

/// The same, anti-aliased.
fn antialiased(name: &str) -> Settings {
    let mut settings = settings(name);
    settings.profile.layout = settings.profile.layout.antialiased();
    settings
}

/// Settings of a short training of smooth Gaussians, whose reflected rays hit the scene itself
/// from step 18 on.
fn reflecting() -> Settings {
    let mut settings = settings("specula");
    settings.profile.start.roughness = 0.2;
    settings.profile.reflections = Reflections::Near;
    settings.profile.near_field = Some(NearFieldSchedule { from: 0.3, every: 0.3, voxels: 24 });
    settings
}

/// Short training on a number of threads.
fn train(threads: usize, name: &str) -> (HostScene, Option<ExposureState>) {
    train_with_pause(threads, &settings(name), None)
}

/// Training, optionally interrupted after some steps and resumed from its state.
fn train_with_pause(threads: usize, settings: &Settings, pause: Option<u32>) -> (HostScene, Option<ExposureState>) {
    let views: Vec<View> = (0..4)
        .map(|k| {
            let turn = k as f32 * 1.6;
            let eye = glam::Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), 1.0);
            let rgba = (0..48 * 48 * 4).map(|byte| (byte * (k + 3) % 253) as u8).collect();
            let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 48, 48);
            View { name: k.to_string(), camera, rgba, unclipped: None, normals: None }
        })
        .collect();
    let points: Vec<Point> = (0..700)
        .map(|k| {
            let place = |axis: u64| specula_core::random::uniform(1, axis, k) - 0.5;
            Point { position: [place(0), place(1), place(2)], color: [0.5, 0.4, 0.3] }
        })
        .collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be had");
    pool.install(|| {
        let mut trainer = Trainer::new(CpuExecutor::new(), settings.clone(), &views, &points).expect("there are views");
        while !trainer.is_finished() {
            if Some(trainer.iteration()) == pause {
                let snapshot = trainer.snapshot().expect("the CPU gives back");
                trainer =
                    Trainer::resume(CpuExecutor::new(), settings.clone(), &views, &snapshot).expect("there are views");
            }
            trainer.step().expect("the CPU trains");
        }
        (trainer.download().expect("the CPU gives back"), trainer.exposures().cloned())
    })
}

/// Number of Gaussians that no pixel shows.
fn invisible_in(cloud: &Gaussians<Vec<f32>>) -> usize {
    let opacity = |index: usize| cloud.get::<1>(index, OPACITY).map(sigmoid)[0];
    (0..cloud.count).filter(|index| opacity(*index) < ALPHA_MIN).count()
}

#[test]
fn removing_invisible_gaussians_changes_no_picture() {
    let mut cloud = random_cloud(300, Layout::shaded(Some(1)), 7);
    for index in (0..cloud.count).step_by(3) {
        cloud.set(index, OPACITY, [logit(if index % 2 == 0 { 0.999 * ALPHA_MIN } else { 1e-6 })]);
    }
    let invisible = invisible_in(&cloud);
    let rules = rules(ShadingRules::PAPER, Channels::Layers);
    let mut exec = CpuExecutor::new();
    let picture = |exec: &mut CpuExecutor, cloud: &Gaussians<Vec<f32>>| {
        numbers_of(&render(exec, cloud, None, &camera(64, 64), &rules).expect("the CPU renders"))
    };
    let before = picture(&mut exec, &cloud);
    let zeros = vec![0.0; cloud.values.len()];
    let mut moments = AdamMoments { mean: zeros.clone(), square: zeros };
    let mut statistics = Statistics { grad_sum: vec![f32::MAX; cloud.count], view_count: vec![1.0; cloud.count] };
    let key = RandomKey { seed: 1, stream: 2 };
    let report = exec
        .densify(&mut cloud, &mut moments, &mut statistics, &DensifyRules::INVISIBLE, usize::MAX, key)
        .expect("the CPU densifies");
    assert_eq!(report, DensifyReport { cloned: 0, split: 0, pruned: invisible });
    assert!(invisible >= 100 && cloud.count == 300 - invisible, "{invisible} of 300 were invisible");
    assert!(before == picture(&mut exec, &cloud), "the picture is another");
}

#[test]
fn a_training_ends_without_gaussians_that_no_picture_shows() {
    let mut settings = settings("specula");
    settings.profile.densification.opacity_min = 0.0;
    // From one half on, sparsity drives opacities to either side.
    settings.profile.start.opacity = 0.5;
    settings.profile.weights.sparse = 1.0;
    settings.profile.rates.opacity = Schedule::constant(0.3);
    let (finished, _) = train_with_pause(2, &settings, None);
    settings.profile.densification.until = 61;
    let (kept, _) = train_with_pause(2, &settings, None);
    assert_eq!(invisible_in(&finished.gaussians), 0, "of {}", finished.gaussians.count);
    assert!(finished.gaussians.count > 10, "{} are left", finished.gaussians.count);
    let kept = invisible_in(&kept.gaussians);
    assert!(kept > 100, "{kept} would be invisible where densification has not ended");
}

#[test]
fn a_resumed_training_continues_to_the_last_bit() {
    for name in ["specula", "3dgs"] {
        for settings in [settings(name), antialiased(name), reflecting()] {
            assert_eq!(
                train_with_pause(2, &settings, None),
                train_with_pause(2, &settings, Some(33)),
                "{name} does not continue as it would have"
            );
        }
    }
}

#[test]
fn a_training_that_reflects_itself_is_the_same_to_the_last_bit_on_any_number_of_threads() {
    let once = train_with_pause(1, &reflecting(), None);
    let near_field = once.0.near_field.as_ref().expect("rays meet the scene itself");
    assert_eq!(near_field.check(), Ok(()));
    assert!(once == train_with_pause(3, &reflecting(), None));
    let mut without = reflecting();
    without.profile.near_field = None;
    let far = train_with_pause(1, &without, None);
    assert!(far.0.near_field.is_none() && far.0.gaussians != once.0.gaussians, "reflections take part");
}

#[test]
fn an_antialiased_training_is_the_same_to_the_last_bit_on_any_number_of_threads() {
    let settings = antialiased("specula");
    let once = train_with_pause(1, &settings, None);
    assert_ne!(once.0.gaussians.count, 700, "densification took part");
    let plane = settings.profile.layout.filter_plane().expect("it has a filter");
    assert!(once.0.gaussians.plane(plane).all(|deviation| deviation > 0.0), "children have filters");
    assert_eq!(once, train_with_pause(5, &settings, None), "it differs on five threads");
}

#[test]
fn a_training_under_a_network_is_the_same_to_the_last_bit_on_any_number_of_threads_and_resumed() {
    for name in ["specula", "paper"] {
        let mut settings = settings(name);
        settings.profile.light.as_mut().expect("it has a light").resolution = 16;
        settings.profile = settings.profile.with_light_network(settings.iterations);
        let once = train_with_pause(1, &settings, None);
        let light = once.0.environment.as_ref().expect("it has a light");
        assert!(light.is_network() && light.values.iter().all(|weight| weight.is_finite()), "{name}: weights");
        let radiance = texels(light).flatten();
        let [least, most] = radiance.fold([f32::MAX, 0.0], |[least, most], x| [least.min(x), most.max(x)]);
        assert!(least < 0.9 * most, "{name}: the light was learned, from {least} to {most}");
        assert_eq!(once, train_with_pause(2, &settings, None), "{name} differs on two threads");
        assert_eq!(once, train_with_pause(2, &settings, Some(settings.iterations / 2)), "{name} differs when resumed");
    }
}

#[test]
fn a_training_is_the_same_to_the_last_bit_on_any_number_of_threads_and_twice() {
    for name in ["specula", "3dgs"] {
        let once = train(1, name);
        assert_ne!(once.0.gaussians.count, 700, "densification took part");
        assert_eq!(once, train(1, name), "two runs of {name} differ");
        assert_eq!(once, train(2, name), "{name} differs on two threads");
        assert_eq!(once, train(5, name), "{name} differs on five threads");
    }
}

/// Largest change in sixty steps of Adam with gradients that are negligible beside its ε.
const NO_STEP: f32 = 1e-12;

#[test]
fn gaussians_outside_of_the_foreground_reflect_nothing_and_do_not_train_the_light() {
    for name in ["specula", "paper"] {
        let mut settings = settings(name);
        let light = settings.profile.light.expect("it has a light");
        let start = match light.activation {
            RadianceActivation::Identity => light.radiance,
            _ => light.radiance.ln(),
        };
        let farthest_from_start = |scene: &HostScene| {
            let light = &scene.environment.as_ref().expect("it has a light").values;
            light.iter().map(|number| (number - start).abs()).fold(0.0, f32::max)
        };
        settings.profile.foreground = Some(Ball { center: [9.0; 3], radius: 1.0 });
        let (nothing_in_it, _) = train_with_pause(2, &settings, None);
        assert!(farthest_from_start(&nothing_in_it) < NO_STEP, "{name}: the light has moved");

        let ball = Ball { center: [0.5, 0.0, 0.0], radius: 0.5 };
        settings.profile.foreground = Some(ball);
        let (some_in_it, _) = train_with_pause(2, &settings, None);
        let gaussians = &some_in_it.gaussians;
        let tint = |k: usize| gaussians.get::<3>(k, TINT);
        let (near, far): (Vec<usize>, Vec<usize>) =
            (0..gaussians.count).partition(|k| ball.contains(gaussians.get(*k, MEAN)));
        assert!(far.len() > 100 && far.iter().all(|k| tint(*k) == [TINT_LOGIT_OFF; 3]), "{name}: nothing far reflects");
        let shining = near.iter().filter(|k| tint(**k).iter().all(|raw| *raw > -10.0)).count();
        assert!(shining > 100, "{name}: {shining} of {} near reflect", near.len());
        assert!(farthest_from_start(&some_in_it) > 1e-3, "{name}: the light is learned from them");
    }
}
