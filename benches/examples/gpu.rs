//! What a GPU takes for pictures and for steps of training, in one table; see `scripts/bench-gpu`.
//!
//! Arguments: part of an adapter's name (empty for any), and after how many seconds no further case is begun.

use core::time::Duration;
use specula_benches::{camera, environment, torus};
use specula_core::{
    camera::Camera,
    executor::{Executor, Moments, RenderRules, Statistics},
    metrics::psnr,
    pipeline::{Fit, Step, render, train_step},
    plan::Channels,
    prefilter::LevelRange,
    scene::{Environment, Gaussians},
};
use specula_cpu::CpuExecutor;
use specula_gpu::{Gpu, GpuError, GpuExecutor, stopwatch::KernelTime};
use specula_train::profile::{Profile, by_name};
use std::time::Instant;

/// Profiles, pictures and clouds, the easier first.
const CASES: [(&str, u32, usize); 14] = [
    ("3dgs", 200, 10_000),
    ("specula", 200, 10_000),
    ("3dgs", 400, 10_000),
    ("specula", 400, 10_000),
    ("3dgs", 400, 100_000),
    ("paper", 400, 100_000),
    ("specula", 400, 100_000),
    ("3dgs", 800, 100_000),
    ("specula", 800, 100_000),
    ("specula", 800, 200_000),
    ("specula", 1600, 200_000),
    ("specula", 800, 1_000_000),
    ("specula", 1600, 1_000_000),
    ("specula", 1600, 5_000_000),
];
/// What a measurement may take; more repetitions are made until then.
const PATIENCE: Duration = Duration::from_secs(2);
const REPETITIONS_MAX: usize = 100;
const LIGHT: usize = 64;

fn main() -> Result<(), GpuError> {
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().unwrap_or_default();
    let budget: u64 = arguments.next().and_then(|seconds| seconds.parse().ok()).unwrap_or(400);
    let mut gpu = GpuExecutor::new(Gpu::new(&name)?);
    let info = gpu.gpu().info();
    println!("{} ({}, {} {})\n", info.name, info.backend, info.driver, info.driver_info);
    println!("| profile | pixels | Gaussians | picture, ms | as the CPU | step, ms | CPU's step, ms |");
    println!("|---|---|---|---|---|---|---|");
    let start = Instant::now();
    let mut kernels = Vec::new();
    for (profile, size, count) in CASES {
        if start.elapsed() > Duration::from_secs(budget) {
            println!("| {profile} | {size} × {size} | {count} | not begun: {budget} s are over | | | |");
            continue;
        }
        match measure(&mut gpu, profile, size, count) {
            Ok(times) => kernels.push((format!("{profile}, {size} × {size}, {count} Gaussians"), times)),
            Err(error) => println!("| {profile} | {size} × {size} | {count} | {error} | | | |"),
        }
    }
    for (case, times) in &kernels {
        print_kernels(case, times);
    }
    Ok(())
}

/// Prints a row; returns the times of the kernels of a step.
fn measure(
    gpu: &mut GpuExecutor,
    profile: &str,
    size: u32,
    count: usize,
) -> Result<Vec<(&'static str, KernelTime)>, GpuError> {
    let mut cpu = CpuExecutor::new();
    let mut ours = Scene::new(gpu, profile, size, count)?;
    let mut theirs = Scene::new(&mut cpu, profile, size, count).expect("the CPU takes every scene");
    let agreement = psnr(mean_squared_difference(&ours.picture(gpu)?, &theirs.picture(&mut cpu).expect("it renders")));
    let picture = median(|| {
        ours.render(gpu)?;
        gpu.finish()
    })?;
    let step = median(|| {
        ours.train(gpu)?;
        gpu.finish()
    })?;
    let cpu_step = median(|| theirs.train(&mut cpu)).expect("the CPU trains");
    println!(
        "| {profile} | {size} × {size} | {count} | {:.2} | {agreement:.0} dB | {:.2} | {:.2} |",
        picture * 1e3,
        step * 1e3,
        cpu_step * 1e3
    );
    if !gpu.watch_kernels(true) {
        return Ok(Vec::new());
    }
    ours.train(gpu)?;
    let times = gpu.kernel_times();
    gpu.watch_kernels(false);
    times
}

fn print_kernels(case: &str, times: &[(&'static str, KernelTime)]) {
    let mut times = times.to_vec();
    times.sort_by(|(_, one), (_, other)| other.seconds.total_cmp(&one.seconds));
    println!("\nKernels of a step, {case}:\n\n| kernel | runs | ms |\n|---|---|---|");
    for (entry, KernelTime { runs, seconds }) in times {
        println!("| `{entry}` | {runs} | {:.3} |", seconds * 1e3);
    }
}

/// The median time of some repetitions, the first left out: kernels are compiled when they are first used.
fn median<E>(mut run: impl FnMut() -> Result<(), E>) -> Result<f64, E> {
    run()?;
    let start = Instant::now();
    let mut times = Vec::new();
    while times.is_empty() || (start.elapsed() < PATIENCE && times.len() < REPETITIONS_MAX) {
        let one = Instant::now();
        run()?;
        times.push(one.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}

fn mean_squared_difference(one: &[f32], other: &[f32]) -> f64 {
    let sum: f64 = one.iter().zip(other).map(|(x, y)| (f64::from(*x) - f64::from(*y)).powi(2)).sum();
    sum / one.len() as f64
}

/// A scene and everything that a training knows of it, on an executor.
struct Scene<E: Executor> {
    profile: Profile,
    rules: RenderRules,
    camera: Camera,
    cloud: Gaussians<E::Array>,
    moments: Moments<E::Array>,
    light: Option<(Environment<E::Array>, Moments<E::Array>)>,
    statistics: Statistics<E::Array>,
    target: E::Target,
}

impl<E: Executor> Scene<E> {
    fn new(exec: &mut E, name: &str, size: u32, count: usize) -> Result<Self, E::Error> {
        let profile = by_name(name, 7000).expect("a profile of that name");
        let channels = if profile.layout.is_shaded() { Channels::Training } else { Channels::Color };
        let cloud = torus(count, &profile);
        let light = environment(LIGHT);
        let zeros = |exec: &mut E, len: usize| exec.upload(&vec![0.0; len]);
        let light = profile.light.map(|_| -> Result<_, E::Error> {
            let moments = Moments { mean: zeros(exec, light.values.len())?, square: zeros(exec, light.values.len())? };
            let Environment { resolution, activation, values } = &light;
            Ok((
                Environment { resolution: *resolution, activation: *activation, values: exec.upload(values)? },
                moments,
            ))
        });
        Ok(Self {
            rules: RenderRules::full(profile.shading, profile.scheme, channels),
            camera: camera(size),
            moments: Moments { mean: zeros(exec, cloud.values.len())?, square: zeros(exec, cloud.values.len())? },
            statistics: Statistics { grad_sum: zeros(exec, count)?, view_count: zeros(exec, count)? },
            target: exec.target(size as usize, size as usize, &vec![128; (size * size * 4) as usize])?,
            light: light.transpose()?,
            cloud: Gaussians { count, layout: cloud.layout, values: exec.upload(&cloud.values)? },
            profile,
        })
    }

    /// A picture, light filtered first.
    fn render(&mut self, exec: &mut E) -> Result<E::Frame, E::Error> {
        let light = match &self.light {
            Some((light, _)) => Some(exec.prefilter(light, self.profile.scheme, LevelRange::ALL)?),
            None => None,
        };
        render(exec, &self.cloud, light.as_ref(), &self.camera, &self.rules)
    }

    fn picture(&mut self, exec: &mut E) -> Result<Vec<f32>, E::Error> {
        let frame = self.render(exec)?;
        let planes = self.rules.blended(self.cloud.layout).count() + 1;
        let mut values = vec![0.0; planes * (self.camera.width * self.camera.height) as usize];
        exec.read_frame(&frame, &mut values)?;
        Ok(values)
    }

    /// One step that changes nothing: all rates are zero.
    fn train(&mut self, exec: &mut E) -> Result<(), E::Error> {
        let rates = vec![0.0; self.cloud.layout.plane_count()];
        let step = Step {
            camera: &self.camera,
            target: &self.target,
            background: [1.0; 3],
            rules: &self.rules,
            weights: &self.profile.weights,
            rates: &rates,
            environment_rate: 0.0,
            radiance_max: 100.0,
            number: 1,
        };
        let mut fit = Fit {
            gaussians: &mut self.cloud,
            moments: &mut self.moments,
            environment: self.light.as_mut().map(|(light, moments)| (light, moments)),
            statistics: &mut self.statistics,
        };
        train_step(exec, &mut fit, &step).map(drop)
    }
}
