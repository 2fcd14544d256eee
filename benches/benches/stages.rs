//! One group for each stage, on the torus at 800 × 800; throughput in what the stage works on. What there is to do is
//! printed first: it does not depend on the machine.

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use specula_benches::{camera, environment, torus, work};
use specula_core::{
    camera::Camera,
    executor::{Executor, Moments, RenderRules, Renderer, Statistics},
    pipeline::{Fit, Step, render, train_step},
    plan::{Channels, Needs, Plan},
    prefilter::LevelRange,
    scene::{Environment, Gaussians, TINT},
};
use specula_cpu::{CpuExecutor, blend::SplatGrads, loss::Target, order::sort_in_space, prefilter::Light};
use specula_io::{
    cameras,
    model_folder::{self, Model},
};
use specula_train::profile::{Profile, by_name};
use std::path::Path;

/// The program's allocator, so that the times are those of the program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const GAUSSIANS: usize = 100_000;
const SIZE: u32 = 800;
const LIGHT: usize = 64;
/// Light per pixel, 12 channels; light per Gaussian, 8 channels; no light, 3 channels.
const PROFILES: [&str; 3] = ["3dgs", "paper", "specula"];
/// Sizes of pictures and clouds for whole steps.
const STEPS: [(u32, usize); 2] = [(400, 50_000), (800, 200_000)];
const SAMPLES: usize = 20;
/// Views of a trained model among which the hardest is taken.
const TRAINED_VIEWS: usize = 8;

/// A scene and everything that a training knows of it.
struct Scene {
    profile: Profile,
    rules: RenderRules,
    camera: Camera,
    cloud: Gaussians<Vec<f32>>,
    moments: Moments<Vec<f32>>,
    environment: Environment<Vec<f32>>,
    environment_moments: Moments<Vec<f32>>,
    statistics: Statistics<Vec<f32>>,
    target: Target,
    rates: Vec<f32>,
}

impl Scene {
    fn new(exec: &mut CpuExecutor, profile: &str, size: u32, count: usize) -> Self {
        let profile = by_name(profile, 7000).expect("a profile of that name");
        let channels = if profile.layout.is_shaded() { Channels::Training } else { Channels::Color };
        let cloud = torus(count, &profile);
        let environment = environment(LIGHT);
        let zeros = |len: usize| Moments { mean: vec![0.0; len], square: vec![0.0; len] };
        let grey = vec![128; (size * size * 4) as usize];
        Self {
            rules: RenderRules::full(profile.shading, profile.scheme, channels),
            camera: camera(size),
            moments: zeros(cloud.values.len()),
            environment_moments: zeros(environment.values.len()),
            statistics: Statistics { grad_sum: vec![0.0; count], view_count: vec![0.0; count] },
            target: exec.target(size as usize, size as usize, &grey).expect("the bytes fit"),
            rates: vec![0.0; cloud.layout.plane_count()],
            profile,
            cloud,
            environment,
        }
    }

    /// One step that changes nothing: all rates are zero.
    fn train(&mut self, exec: &mut CpuExecutor) {
        let step = Step {
            camera: &self.camera,
            target: &self.target,
            background: [1.0; 3],
            rules: &self.rules,
            weights: &self.profile.weights,
            rates: &self.rates,
            environment_rate: 0.0,
            radiance_max: 100.0,
            number: 1,
        };
        let light = self.profile.light.map(|_| (&mut self.environment, &mut self.environment_moments));
        let mut fit = Fit {
            gaussians: &mut self.cloud,
            moments: &mut self.moments,
            environment: light,
            statistics: &mut self.statistics,
        };
        train_step(exec, &mut fit, &step).expect("the CPU trains");
    }
}

/// One bench of a group, which takes what `prepare` gives and is not timed for it.
fn bench<I, O>(
    criterion: &mut Criterion,
    stage: &str,
    name: &str,
    throughput: Throughput,
    mut prepare: impl FnMut() -> I,
    mut run: impl FnMut(I) -> O,
) {
    let mut group = criterion.benchmark_group(stage);
    group.sample_size(SAMPLES).throughput(throughput);
    group.bench_function(BenchmarkId::from_parameter(name), |bench| {
        bench.iter_batched(&mut prepare, &mut run, BatchSize::PerIteration);
    });
    group.finish();
}

fn stages(criterion: &mut Criterion) {
    PROFILES.iter().for_each(|profile| stages_of(criterion, profile));
}

fn stages_of(criterion: &mut Criterion, name: &str) {
    let mut exec = CpuExecutor::new();
    let scene = Scene::new(&mut exec, name, SIZE, GAUSSIANS);
    let Scene { profile, rules, camera, cloud, environment, target, .. } = &scene;
    let light = exec.prefilter(environment, profile.scheme, LevelRange::ALL).expect("64 is a power of two");
    let light = profile.light.map(|_| light);
    let light = light.as_ref();
    let splats = exec.project(cloud, camera).expect("the CPU projects");
    let colors = exec.shade(cloud, camera, &splats, light, rules).expect("the CPU shades");
    let tiles = exec.bin(&splats, camera).expect("the CPU bins");
    let blended = exec.blend(&splats, &colors, &tiles, camera).expect("the CPU blends");
    let is_deferred = rules.is_deferred(cloud.layout);
    let mut frame = blended.clone();
    if is_deferred {
        frame = exec.shade_pixels(frame, light, camera).expect("the CPU shades pixels");
    }
    let (_, picture_grad) = exec.loss(&frame, target, camera, &profile.weights, [1.0; 3]).expect("sizes agree");
    let mut frame_grad = picture_grad.clone();
    let mut light_grad = None;
    if is_deferred {
        (frame_grad, light_grad) = exec.shade_pixels_vjp(&frame, light, camera, frame_grad).expect("the CPU goes back");
    }
    let grads: SplatGrads =
        exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, camera).expect("the CPU goes back");
    let (grad, of_gaussians) =
        exec.gaussians_vjp(cloud, camera, &splats, light, rules, &profile.weights, &grads).expect("the CPU goes back");

    let work = work::count(&splats, &tiles);
    println!("{name}: {work}");
    let gaussians = || Throughput::Elements(GAUSSIANS as u64);
    let pixels = || Throughput::Elements(u64::from(SIZE * SIZE));
    let texels = || Throughput::Elements((6 * LIGHT * LIGHT) as u64);
    let pairs = || Throughput::Elements(work.processed as u64);

    if let (Some(light), Some(light_grad)) = (light, &light_grad.or(of_gaussians)) {
        let levels = LevelRange::ALL;
        bench(criterion, "prefilter", name, texels(), || (), |()| exec.prefilter(environment, profile.scheme, levels));
        bench(
            criterion,
            "prefilter_vjp",
            name,
            texels(),
            || (),
            |()| exec.prefilter_vjp(environment, light, light_grad),
        );
    }
    frame_stages(criterion, &mut exec, name, &View { cloud, light, camera, rules });
    bench(criterion, "blend_plainly", name, pairs(), || (), |()| work::blend_plainly(&splats, &colors, &tiles, camera));
    if is_deferred {
        bench(
            criterion,
            "shade_pixels_vjp",
            name,
            pixels(),
            || picture_grad.clone(),
            |grad| exec.shade_pixels_vjp(&frame, light, camera, grad),
        );
    }
    bench(criterion, "loss", name, pixels(), || (), |()| exec.loss(&frame, target, camera, &profile.weights, [1.0; 3]));
    bench(
        criterion,
        "blend_vjp",
        name,
        pairs(),
        || (),
        |()| exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, camera),
    );
    bench(
        criterion,
        "gaussians_vjp",
        name,
        gaussians(),
        || (),
        |()| exec.gaussians_vjp(cloud, camera, &splats, light, rules, &profile.weights, &grads),
    );
    let (mut values, mut moments) = (cloud.clone(), scene.moments.clone());
    bench(
        criterion,
        "optimise",
        name,
        gaussians(),
        || grad.clone(),
        |grad| exec.optimise(&mut values, &mut moments, grad, &scene.rates, 1),
    );
}

/// A scene as it is looked at.
struct View<'a> {
    cloud: &'a Gaussians<Vec<f32>>,
    light: Option<&'a Light>,
    camera: &'a Camera,
    rules: &'a RenderRules,
}

/// The stages of a picture, then all of them for its colours alone.
fn frame_stages(criterion: &mut Criterion, exec: &mut CpuExecutor, name: &str, view: &View<'_>) {
    let View { cloud, light, camera, rules } = *view;
    let splats = exec.project(cloud, camera).expect("the CPU projects");
    let colors = exec.shade(cloud, camera, &splats, light, rules).expect("the CPU shades");
    let tiles = exec.bin(&splats, camera).expect("the CPU bins");
    let blended = exec.blend(&splats, &colors, &tiles, camera).expect("the CPU blends");
    let gaussians = || Throughput::Elements(cloud.count as u64);
    let pixels = || Throughput::Elements(u64::from(camera.width) * u64::from(camera.height));
    let pairs = Throughput::Elements(work::count(&splats, &tiles).processed as u64);

    bench(criterion, "project", name, gaussians(), || (), |()| exec.project(cloud, camera));
    bench(criterion, "shade", name, gaussians(), || (), |()| exec.shade(cloud, camera, &splats, light, rules));
    bench(criterion, "sort", name, gaussians(), || (), |()| exec.depth_order(&splats));
    bench(criterion, "bin", name, gaussians(), || (), |()| exec.bin(&splats, camera));
    bench(criterion, "blend", name, pairs, || (), |()| exec.blend(&splats, &colors, &tiles, camera));
    if rules.is_deferred(cloud.layout) {
        let blended = || blended.clone();
        bench(criterion, "shade_pixels", name, pixels(), blended, |frame| exec.shade_pixels(frame, light, camera));
    }
    let colors_only = RenderRules { channels: Channels::Color, ..*rules };
    bench(criterion, "frame", name, pixels(), || (), |()| render(exec, cloud, light, camera, &colors_only));
}

fn steps(criterion: &mut Criterion) {
    for (profile, (size, count)) in PROFILES.iter().flat_map(|profile| STEPS.map(|step| (profile, step))) {
        let mut exec = CpuExecutor::new();
        let mut scene = Scene::new(&mut exec, profile, size, count);
        let name = format!("{profile}, {count} at {size}");
        let steps = Throughput::Elements(1);
        bench(criterion, "train_step", &name, steps, || (), |()| scene.train(&mut exec));
    }
}

/// A scene in which nothing shines, under a light, rendered by its plan: what is left is plain Gaussian splatting.
fn diffuse(criterion: &mut Criterion) {
    const NO_TINT: f32 = -100.0;
    let mut exec = CpuExecutor::new();
    let Scene { mut cloud, camera, environment, rules, .. } = Scene::new(&mut exec, "specula", SIZE, GAUSSIANS);
    (0..cloud.count).for_each(|index| cloud.set(index, TINT, [NO_TINT; 3]));
    let rules = RenderRules { channels: Channels::Color, ..rules };
    let plan = Plan::new(cloud.layout, &Needs::of(&cloud).under(Some(&environment)), None, &rules);
    assert!(plan.unlit.is_some(), "a scene without tint needs no light");
    let view = View { cloud: &cloud, light: None, camera: &camera, rules: &plan.rules };
    frame_stages(criterion, &mut exec, "diffuse", &view);
}

/// A trained model from the hardest of its first views. `SPECULA_MODEL` names its folder.
fn trained(criterion: &mut Criterion) {
    let Some(folder) = std::env::var_os("SPECULA_MODEL") else {
        println!("no trained model is rendered; name its folder in SPECULA_MODEL");
        return;
    };
    let folder = Path::new(&folder);
    let Model { gaussians: mut cloud, light, info, .. } = model_folder::open(folder).expect("a model's folder");
    let cameras = cameras::read(&folder.join("cameras.json")).expect("a model has its cameras");
    sort_in_space(&mut cloud);
    let profile = by_name(&info.expect("specula trained it").profile, 30_000).expect("a profile of that name");
    let full = RenderRules::full(profile.shading, profile.scheme, Channels::Color);
    let plan = Plan::new(cloud.layout, &Needs::of(&cloud).under(light.as_ref()), None, &full);
    let mut exec = CpuExecutor::new();
    let light = light.map(|light| exec.prefilter(&light, profile.scheme, LevelRange::ALL).expect("specula wrote it"));
    let work_from = |exec: &mut CpuExecutor, camera: &Camera| {
        let splats = exec.project(&cloud, camera).expect("the CPU projects");
        work::count(&splats, &exec.bin(&splats, camera).expect("the CPU bins"))
    };
    let views = cameras.iter().take(TRAINED_VIEWS).map(|(_, camera)| camera);
    let camera = views.max_by_key(|camera| work_from(&mut exec, camera).processed).expect("a model has cameras");
    println!("trained: {} Gaussians, {}", cloud.count, work_from(&mut exec, camera));
    frame_stages(
        criterion,
        &mut exec,
        "trained",
        &View { cloud: &cloud, light: light.as_ref(), camera, rules: &plan.rules },
    );
}

criterion_group!(benches, stages, diffuse, trained, steps);
criterion_main!(benches);
