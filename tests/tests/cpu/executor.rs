//! The CPU executor against the plain pipeline, against the independent renderer, and against
//! itself on other threads.

use specula_core::{
    activation::{logit, sigmoid},
    antialias::LowPass,
    camera::Camera,
    cutoffs::ALPHA_MIN,
    densify::DensifyRules,
    double::Double,
    environment::texels,
    executor::{DensifyReport, Executor, RandomKey, Renderer, StepReport, TrainingStep},
    expose::expose,
    loss::{LossWeights, NormalForm},
    near_field::NearField,
    optimise::Schedule,
    pipeline::render,
    prefilter::{LevelRange, PrefilterScheme},
    region::Ball,
    rules::{Channels, RenderRules},
    scene::{
        DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS,
        RadianceActivation, TINT,
    },
    sh,
    shade::ShadingRules,
    state::{AdamMoments, ExposureState, Statistics},
    vector::{Vec3, vec3},
};
use specula_cpu::{
    CpuError, CpuExecutor,
    frame::Frame,
    stages::{
        blend_vjp::SplatGrads,
        loss::Target,
        prefilter::{Light, LightGrad},
        project::Splats,
    },
};
use specula_tests::{
    brute,
    compare::{assert_psnr, psnr, relative_difference},
    independent::{rays, surface::gaussians},
    near_fields::{polished, random_near_field},
    plain::{self, lift_environment, lift_gaussians, prefilter},
    strategies::{random_cloud, random_environment, under_turned_light},
    stress::{Case, every_case, results::Results, too_many_splats},
};
use specula_train::{
    profile::{NearFieldSchedule, Reflections, by_name, exposure_rate},
    start::Point,
    trainer::{HostScene, Settings, TINT_LOGIT_OFF, Trainer},
    view::View,
};

/// `f32` on lanes against `f64`: rounding of a few hundred operations, 1e-5, is 100 dB; a single
/// pixel on the other side of the cut at 1/255 brings a small picture down to 85 dB.
const SAME_FRAME: f64 = 80.0;
/// Gradients of a small picture in `f32`, by attribute, relative to the largest.
const SAME_GRADIENT: f64 = 2e-4;
/// Difference in 8 bits among the field's own renderers.
const AS_THE_FIELD_RENDERS: f64 = 50.0;
const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.3];
const RESOLUTION: usize = 16;

fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at(glam::Vec3::new(2.0, -3.0, 1.5), glam::Vec3::new(0.2, 0.0, 0.1), glam::Vec3::Z, 0.7, width, height)
}

/// Light looked up by Gaussians, and by pixels.
const BOTH: [ShadingRules; 2] = [ShadingRules::PAPER, ShadingRules::DEFERRED];

fn rules(shading: ShadingRules, channels: Channels) -> RenderRules {
    RenderRules::full(shading, PrefilterScheme::Exact, channels)
}

fn weights() -> LossWeights {
    LossWeights {
        absolute: 0.5,
        squared: 0.3,
        dssim: 0.2,
        normal: 0.1,
        normal_form: NormalForm::Cosine,
        smoothness: 0.2,
        coverage: 0.1,
        sparse: 1e-3,
        residual: 1e-2,
        ..LossWeights::NONE
    }
}

/// Light around a near field.
fn surrounded(exec: &mut CpuExecutor, light: Light, near_field: &NearField<Vec<f32>>) -> Light {
    let uploaded = exec.upload_near_field(&near_field.with_values(&near_field.values));
    exec.surround(light, &uploaded.expect("the near field is whole"))
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

#[test]
fn a_shaded_frame_is_that_of_the_plain_pipeline_in_every_layer() {
    let plain = Layout::shaded(Some(3));
    for (seed, shading, layout) in [
        (1_u64, ShadingRules::PAPER, plain),
        (2, ShadingRules::DEFERRED, plain),
        (3, ShadingRules::DEFERRED, plain.antialiased()),
        (4, ShadingRules::PAPER, Layout { low_pass: LowPass::Compensated, ..plain }),
        (5, ShadingRules::PHYSICAL, Layout::shaded(None).physical()),
        (6, ShadingRules::PHYSICAL, plain.physical().antialiased()),
        (9, ShadingRules::PAPER, plain),
    ] {
        let activation = [RadianceActivation::Identity, RadianceActivation::Exponential][seed as usize % 2];
        let (cloud, environment) = (random_cloud(80, layout, seed), random_environment(RESOLUTION, activation, seed));
        let camera = if seed.is_multiple_of(3) { under_turned_light(camera(70, 45)) } else { camera(70, 45) };
        let mut exec = CpuExecutor::new();
        let light =
            exec.prefilter(&environment, PrefilterScheme::Exact, LevelRange::ALL).expect("16 is a power of two");
        let rules = rules(shading, Channels::Layers);
        let frame = render(&mut exec, &cloud, Some(&light), &camera, &rules).expect("the CPU renders");

        let operator = plain::Operator::new(RESOLUTION);
        let light = prefilter::<Double>(&lift_environment(&environment), &operator);
        let exact = plain::render(&lift_gaussians(&cloud), Some(&light), &camera, &rules);
        let exact: Vec<f64> = exact.values.iter().map(|x| x.0).collect();
        let ours = wide(&numbers_of(&frame));
        println!("seed {seed}: {:.1} dB", psnr(&ours, &exact));
        assert_psnr(&ours, &exact, SAME_FRAME);
    }
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
fn gradients_are_those_of_the_plain_pipeline() {
    for seed in 5..7 {
        let layout = Layout::shaded(Some(3));
        BOTH.into_iter().for_each(|shading| gradients_agree(shading, layout, None, seed));
        gradients_agree(ShadingRules::DEFERRED, layout.antialiased(), None, seed);
        gradients_agree(ShadingRules::DEFERRED, layout, Some(&random_near_field(60, seed)), seed);
        gradients_agree(ShadingRules::PHYSICAL, layout.physical(), None, seed);
        gradients_agree(ShadingRules::PHYSICAL, layout.physical(), Some(&random_near_field(60, seed)), seed);
    }
}

/// Target of a picture and the weights of its losses.
struct Comparison<'a> {
    camera: &'a Camera,
    target: &'a Target,
    rules: &'a RenderRules,
    weights: &'a LossWeights,
}

/// Forward to the loss and back: splats, their gradients, and that of the light where pixels looked
/// it up.
fn back_to_splats(
    exec: &mut CpuExecutor,
    cloud: &Gaussians<Vec<f32>>,
    light: &Light,
    view: &Comparison<'_>,
) -> (Splats, SplatGrads, Option<LightGrad>) {
    let Comparison { camera, target, rules, weights } = view;
    let mut splats = exec.project(cloud, camera).expect("the CPU projects");
    let colors = exec.shade(cloud, camera, &mut splats, Some(light), rules).expect("the CPU shades");
    let tiles = exec.bin(&splats, camera).expect("the CPU bins");
    let mut frame = exec.blend(&splats, &colors, &tiles, camera).expect("the CPU blends");
    let is_deferred = rules.is_deferred(cloud.layout);
    if is_deferred {
        if rules.traces_near {
            frame = exec.trace(frame, light, camera).expect("the CPU traces");
        }
        frame = exec.shade_pixels(frame, Some(light), camera, rules).expect("the CPU shades");
    }
    let mut frame_grad = exec.loss(&frame, target, camera, weights, BACKGROUND).expect("sizes agree");
    let mut light_grad = None;
    if is_deferred {
        (frame_grad, light_grad) =
            exec.shade_pixels_vjp(&frame, Some(light), camera, rules, frame_grad).expect("the CPU goes back");
    }
    let grads = exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, camera).expect("the CPU goes back");
    (splats, grads, light_grad)
}

/// Relative difference of gradients of physical materials. The split-sum table is linear between
/// its entries: pixels within rounding of one may take the slope on its other side.
const SAME_PHYSICAL_GRADIENT: f64 = 1e-3;

/// Planes of each attribute.
const GROUPS: [(&str, core::ops::Range<usize>); 10] = [
    ("means", MEAN..LOG_SCALE),
    ("scales", LOG_SCALE..QUAT),
    ("quats", QUAT..OPACITY),
    ("opacity", OPACITY..DIFFUSE),
    ("diffuse", DIFFUSE..TINT),
    ("tint", TINT..ROUGHNESS),
    ("roughness", ROUGHNESS..NORMAL_RESIDUAL_1),
    ("first normal residual", NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2),
    ("second normal residual", NORMAL_RESIDUAL_2..NORMAL_RESIDUAL_2 + 3),
    ("residual harmonics", NORMAL_RESIDUAL_2 + 3..NORMAL_RESIDUAL_2 + 3 + 48),
];

fn gradients_agree(shading: ShadingRules, layout: Layout, near_field: Option<&NearField<Vec<f32>>>, seed: u64) {
    let still = camera(40, 33);
    [still, under_turned_light(still)]
        .iter()
        .for_each(|camera| gradients_agree_in(camera, shading, layout, near_field, seed));
}

fn gradients_agree_in(
    camera: &Camera,
    shading: ShadingRules,
    layout: Layout,
    near_field: Option<&NearField<Vec<f32>>>,
    seed: u64,
) {
    let cloud = random_cloud(40, layout, seed);
    let cloud = if near_field.is_some() { polished(cloud) } else { cloud };
    assert_eq!(GROUPS[9].1.end, layout.sh_end(), "no plane is left out");
    let mut environment = random_environment(RESOLUTION, RadianceActivation::Exponential, seed);
    let rules = RenderRules { traces_near: near_field.is_some(), ..rules(shading, Channels::Training) };
    // Every other scene is overexposed.
    let saturates = seed.is_multiple_of(2);
    let weights = LossWeights { saturates, ..weights() };
    let mut rgba: Vec<u8> = (0..40 * 33 * 4).map(|k| (k * 37 % 251) as u8).collect();
    if saturates {
        rgba.chunks_exact_mut(8).for_each(|two| two[..4].fill(255));
        environment.values.iter_mut().for_each(|number| *number += 1.5);
    }
    let mut exec = CpuExecutor::new();
    let light = exec.prefilter(&environment, rules.scheme, rules.levels).expect("16 is a power of two");
    let light = near_field.map_or(light.clone(), |near_field| surrounded(&mut exec, light, near_field));
    let target = exec.target(40, 33, &rgba).expect("the bytes fit");
    let view = Comparison { camera, target: &target, rules: &rules, weights: &weights };
    let (splats, grads, light_grad) = back_to_splats(&mut exec, &cloud, &light, &view);
    let (grad, gaussian_light_grad) =
        exec.gaussians_vjp(&cloud, camera, &splats, Some(&light), &rules, &weights, &grads).expect("the CPU goes back");
    let light_grad = light_grad.or(gaussian_light_grad).expect("there is a light");
    let environment_grad = exec.prefilter_vjp(&environment, &light, &light_grad).expect("the CPU goes back");

    let over = |c: usize| {
        rgba.chunks_exact(4).map(move |pixel| {
            let alpha = f64::from(pixel[3]) / 255.0;
            Double(f64::from(pixel[c]) / 255.0 * alpha + (1.0 - alpha) * f64::from(BACKGROUND[c]))
        })
    };
    let target = plain::Target {
        srgb: over(0).chain(over(1)).chain(over(2)).collect(),
        alpha: Some(rgba.chunks_exact(4).map(|pixel| Double(f64::from(pixel[3]) / 255.0)).collect()),
        background: BACKGROUND,
    };
    let view = plain::View { camera, target: &target, rules: &rules, weights: &weights, near_field };
    let operator = plain::Operator::new(RESOLUTION);
    let lifted = (lift_environment(&environment), lift_gaussians(&cloud));
    let tolerance = if shading == ShadingRules::PHYSICAL { SAME_PHYSICAL_GRADIENT } else { SAME_GRADIENT };
    let (_, exact, _) = plain::loss_and_gradient(&lifted.1, Some((&lifted.0, &operator)), &view);

    let filter_grads = layout.filter_plane().into_iter().flat_map(|plane| grad.plane(plane));
    assert!(filter_grads.into_iter().all(|grad| grad == 0.0), "filters have no gradient");
    for (name, planes) in GROUPS {
        let ours: Vec<f64> = planes.clone().flat_map(|plane| wide(&grad.plane(plane).collect::<Vec<_>>())).collect();
        let theirs: Vec<f64> = planes
            .flat_map(|plane| (0..cloud.count).map(move |k| (k, plane)))
            .map(|(k, plane)| exact.gaussians.values[exact.gaussians.index_of(k, plane)].0)
            .collect();
        let difference = relative_difference(&ours, &theirs);
        println!("{:?}, seed {seed}, {name}: {difference:.1e}", shading.form);
        assert!(difference < tolerance, "{name} differ by {difference:e}");
    }
    let theirs: Vec<f64> = exact.environment.expect("there is a light").iter().map(|x| x.0).collect();
    let difference = relative_difference(&wide(&environment_grad), &theirs);
    println!("{:?}, seed {seed}, light: {difference:.1e}", shading.form);
    assert!(difference < tolerance, "the light's gradient differs by {difference:e}");
}

#[test]
fn an_update_at_once_is_that_of_two_stages() {
    for shading in BOTH {
        let cloud = random_cloud(90, Layout::shaded(Some(3)), 7);
        let environment = random_environment(RESOLUTION, RadianceActivation::Exponential, 7);
        let (camera, rules, weights) = (camera(64, 48), rules(shading, Channels::Training), weights());
        let mut exec = CpuExecutor::new();
        let target = exec.target(64, 48, &[120; 64 * 48 * 4]).expect("the bytes fit");
        let light = exec.prefilter(&environment, rules.scheme, LevelRange::ALL).expect("16 is a power of two");
        let view = Comparison { camera: &camera, target: &target, rules: &rules, weights: &weights };
        let (splats, grads, _) = back_to_splats(&mut exec, &cloud, &light, &view);
        let rates: Vec<f32> = (0..cloud.layout.plane_count()).map(|plane| 1e-3 * plane as f32).collect();
        let step = TrainingStep {
            camera: &camera,
            target: &target,
            background: BACKGROUND,
            exposure: None,
            near_field: None,
            rules: &rules,
            weights: &weights,
            is_observed: true,
            rates: &rates,
            environment_rate: 0.0,
            radiance_max: 1.0,
            number: 3,
        };
        let moments = AdamMoments { mean: vec![1e-4; cloud.values.len()], square: vec![1e-6; cloud.values.len()] };
        let (mut at_once, mut moments_at_once) = (cloud.clone(), moments.clone());
        let light_grad = exec
            .update(&mut at_once, &mut moments_at_once, &splats, Some(&light), &grads, &step)
            .expect("the CPU updates");
        let report = exec.report().expect("the CPU counts");
        let (mut in_two, mut moments_in_two) = (cloud, moments);
        let (grad, light_grad_in_two) = exec
            .gaussians_vjp(&in_two, &camera, &splats, Some(&light), &rules, &weights, &grads)
            .expect("the CPU goes back");
        exec.optimise(&mut in_two, &mut moments_in_two, grad, &rates, 3).expect("the CPU optimises");
        let report_of_two = exec.report().expect("the CPU counts");
        assert_eq!(at_once.values, in_two.values, "Gaussians");
        assert_eq!(moments_at_once.mean, moments_in_two.mean, "means");
        assert_eq!(moments_at_once.square, moments_in_two.square, "squares");
        let left_out = |report: Option<StepReport>| report.expect("the capacity suffices").nonfinite;
        assert_eq!(left_out(report), left_out(report_of_two), "what was left out");
        let mut environment_grad = |light_grad: Option<_>| {
            light_grad.map(|grad| exec.prefilter_vjp(&environment, &light, &grad).expect("the CPU goes back"))
        };
        assert_eq!(environment_grad(light_grad), environment_grad(light_grad_in_two), "the light's gradient");
    }
}

#[test]
fn pictures_and_gradients_are_finite_at_every_edge() {
    let mut exec = CpuExecutor::new();
    for case in every_case() {
        for shading in case.shadings() {
            let Results { picture, gradient, losses, nonfinite } = Results::new(&mut exec, &case, *shading);
            let is_finite = [picture, gradient, losses].iter().flatten().all(|x| x.is_finite());
            assert!(is_finite, "{} ({:?}): a number is not finite", case.name, shading.form);
            assert_eq!(nonfinite, 0, "{} ({:?}): gradients are not finite", case.name, shading.form);
        }
    }
}

#[test]
fn pictures_and_gradients_of_materials_are_finite_at_every_edge() {
    let mut exec = CpuExecutor::new();
    for case in every_case().iter().map(Case::with_materials) {
        let Results { picture, gradient, losses, nonfinite } = Results::new(&mut exec, &case, ShadingRules::PHYSICAL);
        let is_finite = [picture, gradient, losses].iter().flatten().all(|x| x.is_finite());
        assert!(is_finite, "{}: a number is not finite", case.name);
        assert_eq!(nonfinite, 0, "{}: gradients are not finite", case.name);
    }
}

#[test]
fn more_splats_in_tiles_than_a_word_counts_are_refused() {
    let (cloud, camera) = too_many_splats();
    let mut exec = CpuExecutor::new();
    let splats = exec.project(&cloud, &camera).expect("the CPU projects");
    let refused = exec.bin(&splats, &camera).expect_err("there are 2³² and more");
    assert_eq!(refused, CpuError::TooManySplats);
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
            View { name: k.to_string(), camera, rgba, normals: None }
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
