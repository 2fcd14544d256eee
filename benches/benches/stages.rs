//! One group for each stage, on the torus; throughput in what the stage works on.

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use specula_benches::{camera, environment, torus};
use specula_core::{
    executor::{Executor, Moments, RenderRules},
    pipeline::render,
    plan::Channels,
    prefilter::LevelRange,
};
use specula_cpu::CpuExecutor;
use specula_train::profile::{Profile, by_name};

/// The program's allocator, so that the times are those of the program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const GAUSSIANS: usize = 100_000;
const SIZE: u32 = 400;
const PROFILES: [&str; 2] = ["3dgs", "specula"];

fn rules_of(profile: &Profile) -> RenderRules {
    let channels = if profile.layout.is_shaded() { Channels::Training } else { Channels::Color };
    RenderRules::full(profile.shading, profile.scheme, channels)
}

fn stages(criterion: &mut Criterion) {
    for name in PROFILES {
        let profile = by_name(name, 7000).expect("a profile of that name");
        stages_of(criterion, &profile);
    }
}

fn stages_of(criterion: &mut Criterion, profile: &Profile) {
    let mut exec = CpuExecutor::new();
    let (camera, rules) = (camera(SIZE), rules_of(profile));
    let mut cloud = torus(GAUSSIANS, profile);
    let light_source = environment(64);
    let light = exec.prefilter(&light_source, profile.scheme, LevelRange::ALL).expect("64 is a power of two");
    let light = profile.light.map(|_| light);
    let splats = exec.project(&cloud, &camera).expect("the CPU projects");
    let colors = exec.shade(&cloud, &camera, &splats, light.as_ref(), &rules).expect("the CPU shades");
    let tiles = exec.bin(&splats, &camera).expect("the CPU bins");
    let mut frame = exec.blend(&splats, &colors, &tiles, &camera).expect("the CPU blends");
    let grey = vec![128; (SIZE * SIZE * 4) as usize];
    let target = exec.target(SIZE as usize, SIZE as usize, &grey).expect("the bytes fit");
    let is_deferred = rules.is_deferred(cloud.layout);
    let blended = frame.clone();
    if is_deferred {
        frame = exec.shade_pixels(frame, light.as_ref(), &camera).expect("the CPU shades pixels");
    }
    let (_, picture_grad) = exec.loss(&frame, &target, &camera, &profile.weights, [1.0; 3]).expect("sizes agree");
    let (frame_grad, of_pixels) = if is_deferred {
        exec.shade_pixels_vjp(&frame, light.as_ref(), &camera, picture_grad.clone()).expect("the CPU goes back")
    } else {
        (picture_grad.clone(), None)
    };
    let grads = exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, &camera).expect("the CPU goes back");
    let mut moments = Moments { mean: vec![0.0; cloud.values.len()], square: vec![0.0; cloud.values.len()] };
    let rates = vec![0.0; cloud.layout.plane_count()];

    let gaussians = Throughput::Elements(GAUSSIANS as u64);
    let intersections = Throughput::Elements(tiles.intersection_count() as u64);
    let pixels = Throughput::Elements(u64::from(SIZE * SIZE));
    macro_rules! group {
        ($stage:literal, $throughput:expr, $run:expr) => {
            let mut group = criterion.benchmark_group($stage);
            group.sample_size(20).throughput($throughput);
            group.bench_function(BenchmarkId::from_parameter(profile.name), |bench| bench.iter(|| $run));
            group.finish();
        };
    }
    let (grad, of_gaussians) = exec
        .gaussians_vjp(&cloud, &camera, &splats, light.as_ref(), &rules, &profile.weights, &grads)
        .expect("the CPU goes back");
    if let (Some(light), Some(light_grad)) = (&light, &of_pixels.or(of_gaussians)) {
        let texels = Throughput::Elements(6 * 64 * 64);
        group!("prefilter", texels.clone(), exec.prefilter(&light_source, profile.scheme, LevelRange::ALL));
        group!("prefilter_vjp", texels, exec.prefilter_vjp(&light_source, light, light_grad));
    }
    group!("project", gaussians.clone(), exec.project(&cloud, &camera));
    group!("shade", gaussians.clone(), exec.shade(&cloud, &camera, &splats, light.as_ref(), &rules));
    group!("bin", gaussians.clone(), exec.bin(&splats, &camera));
    group!("blend", intersections.clone(), exec.blend(&splats, &colors, &tiles, &camera));
    if is_deferred {
        let mut group = criterion.benchmark_group("shade_pixels");
        group.sample_size(20).throughput(pixels.clone());
        group.bench_function(BenchmarkId::from_parameter(profile.name), |bench| {
            bench.iter_batched(
                || blended.clone(),
                |frame| exec.shade_pixels(frame, light.as_ref(), &camera),
                BatchSize::LargeInput,
            );
        });
        group.finish();
        let mut group = criterion.benchmark_group("shade_pixels_vjp");
        group.sample_size(20).throughput(pixels.clone());
        group.bench_function(BenchmarkId::from_parameter(profile.name), |bench| {
            bench.iter_batched(
                || picture_grad.clone(),
                |grad| exec.shade_pixels_vjp(&frame, light.as_ref(), &camera, grad),
                BatchSize::LargeInput,
            );
        });
        group.finish();
    }
    group!("loss", pixels.clone(), exec.loss(&frame, &target, &camera, &profile.weights, [1.0; 3]));
    group!("blend_vjp", intersections, exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, &camera));
    group!(
        "gaussians_vjp",
        gaussians.clone(),
        exec.gaussians_vjp(&cloud, &camera, &splats, light.as_ref(), &rules, &profile.weights, &grads)
    );
    group!("frame", pixels, render(&mut exec, &cloud, light.as_ref(), &camera, &rules));
    let mut group = criterion.benchmark_group("optimise");
    group.sample_size(20).throughput(gaussians);
    group.bench_function(BenchmarkId::from_parameter(profile.name), |bench| {
        bench.iter_batched(
            || grad.clone(),
            |grad| exec.optimise(&mut cloud, &mut moments, grad, &rates, 1),
            BatchSize::LargeInput,
        );
    });
    group.finish();
}

criterion_group!(benches, stages);
criterion_main!(benches);
