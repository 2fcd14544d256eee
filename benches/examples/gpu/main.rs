//! Times of pictures, training steps and their stages on a GPU, beside the device's ceilings; see
//! `scripts/bench-gpu`.
//!
//! Arguments: part of an adapter's name (empty for any), and how many seconds there are. A case
//! that would take longer than is left is not begun.

use core::{fmt, time::Duration};
use specula_benches::{
    scene::{Scene, View},
    stages::{Amounts, Meter, Stage, measure_picture, measure_step},
    work::work_of,
};
use specula_core::{
    executor::Renderer,
    metrics::psnr,
    pack::Storage,
    pipeline::render,
    prefilter::LevelRange,
    scene::{Environment, Gaussians},
    state::SceneState,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{Ceilings, ChunkedArray, Gpu, GpuError, GpuExecutor, Light, Precision};
use specula_train::evaluate::render_view;
use std::time::Instant;

/// A profile, and the sizes of a picture and of a cloud.
#[derive(Clone, Copy, Debug)]
struct Case(&'static str, u32, usize);

/// The easier first.
const CASES: [Case; 14] = [
    Case("3dgs", 200, 10_000),
    Case("specula", 200, 10_000),
    Case("3dgs", 400, 10_000),
    Case("specula", 400, 10_000),
    Case("3dgs", 400, 100_000),
    Case("paper", 400, 100_000),
    Case("specula", 400, 100_000),
    Case("3dgs", 800, 100_000),
    Case("specula", 800, 100_000),
    Case("specula", 800, 200_000),
    Case("specula", 1600, 200_000),
    Case("specula", 800, 1_000_000),
    Case("specula", 1600, 1_000_000),
    Case("specula", 1600, 5_000_000),
];
/// Time budget of a measurement; it is repeated until the budget is used up.
const PATIENCE: Duration = Duration::from_secs(2);
const REPETITIONS_MAX: usize = 100;
/// A stage is run so often; the fastest counts, and the first also compiles kernels.
const STAGE_RUNS: usize = 3;
/// Times of a case: pictures and steps of both executors, and their stages one by one.
const ROUNDS: f64 = 12.0;
const MEBIBYTE: f64 = 1_048_576.0;

impl Case {
    /// Pixels and Gaussians, which all times grow with.
    fn extent(&self) -> f64 {
        f64::from(self.1 * self.1) + self.2 as f64
    }
}

impl fmt::Display for Case {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(profile, size, count) = self;
        write!(out, "{profile} | {size} × {size} | {count}")
    }
}

fn main() -> Result<(), GpuError> {
    let start = Instant::now();
    let mut arguments = std::env::args().skip(1);
    let name = arguments.next().unwrap_or_default();
    let budget = arguments.next().and_then(|seconds| seconds.parse().ok()).unwrap_or(400.0);
    let mut bench = Bench::new(Gpu::new(&name)?)?;
    println!(
        "| profile | pixels | Gaussians | stored | picture, ms | as the CPU | MiB | step, ms | CPU's step, ms | MiB |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for case in CASES {
        let left: f64 = budget - start.elapsed().as_secs_f64();
        let expected = bench.pace * case.extent() * ROUNDS + 4.0 * PATIENCE.as_secs_f64();
        if expected > left {
            println!("| {case} | left out: it would take {expected:.0} s, and {left:.0} s are left | | | | | | |");
        } else if let Err(error) = bench.measure(&case) {
            println!("| {case} | {error} | | | | | | |");
        }
    }
    bench.print_stages();
    Ok(())
}

/// A device, and what was found out about it.
struct Bench {
    gpu: Gpu,
    ceilings: Option<Ceilings>,
    /// The slowest picture and step of both executors so far, in seconds for each pixel and
    /// Gaussian.
    pace: f64,
    stages: Vec<(Case, Storage, Vec<StageTime>)>,
}

impl Bench {
    /// Measures the device's ceilings.
    fn new(gpu: Gpu) -> Result<Self, GpuError> {
        let info = gpu.info();
        println!("{} ({}, {} {})\n", info.name, info.backend, info.driver, info.driver_info);
        let ceilings = GpuExecutor::new(gpu.clone()).ceilings()?;
        match ceilings {
            Some(Ceilings { bytes, operations }) => {
                println!("Copies {:.1} GB/s, multiplies and adds {:.0} GFLOP/s.\n", bytes * 1e-9, operations * 1e-9);
            }
            None => println!("Kernels cannot be timed here.\n"),
        }
        Ok(Self { gpu, ceilings, pace: 0.0, stages: Vec::new() })
    }

    /// Prints the rows of a case, and remembers its stages.
    fn measure(&mut self, case: &Case) -> Result<(), GpuError> {
        let reference = Reference::new(case);
        let in_full = self.measure_pictures(case, Storage::F32, &reference)?;
        let halves = self.measure_pictures(case, Storage::F16, &reference)?;
        let (step, memory) = self.measure_steps(case, &reference)?;
        let of_cpu = reference.step;
        let [step_ms, cpu_ms, mebibytes] = [step * 1e3, of_cpu * 1e3, memory as f64 / MEBIBYTE];
        println!("| {case} | f32 | {in_full} | {step_ms:.2} | {cpu_ms:.2} | {mebibytes:.0} |");
        println!("| {case} | f16 | {halves} | | | |");
        self.pace = self.pace.max((2.0 * in_full.seconds + step + of_cpu) / case.extent());
        Ok(())
    }

    fn measure_pictures(&mut self, case: &Case, storage: Storage, like: &Reference) -> Result<Picture, GpuError> {
        let mut viewer = GpuExecutor::viewer(self.gpu.clone(), storage);
        let stand = Stand::new(&mut viewer, &like.scene)?;
        let picture = stand.measure(&mut viewer, &like.image)?;
        let mut stage_times = StageTimes { amounts: Amounts { storage, ..like.amounts }, times: Vec::new() };
        if viewer.time_kernels(true) {
            stand.measure_stages(&mut viewer, &mut stage_times)?;
        }
        self.stages.push((*case, storage, stage_times.times));
        Ok(picture)
    }

    /// Seconds of a step, and bytes of the device that it takes.
    fn measure_steps(&mut self, case: &Case, like: &Reference) -> Result<(f64, u64), GpuError> {
        let Case(profile, size, count) = *case;
        let exec = &mut GpuExecutor::new(self.gpu.clone());
        let mut scene = Scene::new(exec, profile, size, count)?;
        let seconds = median(|| {
            scene.train(exec)?;
            exec.finish()
        })?;
        let memory = exec.memory_bytes();
        let mut stage_times = StageTimes { amounts: like.amounts, times: Vec::new() };
        if exec.time_kernels(true) {
            measure_step(exec, &mut scene, &mut stage_times)?;
        }
        self.stages.push((*case, Storage::F32, stage_times.times));
        Ok((seconds, memory))
    }
}

/// A case on the CPU.
struct Reference {
    scene: Scene<CpuExecutor>,
    image: Vec<f32>,
    /// Seconds of a step.
    step: f64,
    amounts: Amounts,
}

impl Reference {
    fn new(case: &Case) -> Self {
        let Case(profile, size, count) = *case;
        let mut cpu = CpuExecutor::new();
        let mut scene = Scene::new(&mut cpu, profile, size, count).expect("the CPU takes every scene");
        let step = median(|| scene.train(&mut cpu)).expect("the CPU trains");
        let light = scene.filtered(&mut cpu).expect("64 is a power of two");
        let Scene { rules, camera, state: SceneState { gaussians: cloud, .. }, .. } = &scene;
        let image = render_view(&mut cpu, cloud, light.as_ref(), camera, rules).expect("the CPU renders");
        let amounts = Amounts {
            gaussians: count,
            layout: cloud.layout,
            storage: Storage::F32,
            pixels: image.pixel_count(),
            rules: *rules,
            work: work_of(&mut cpu, cloud, camera),
        };
        Self { image: image.values, step, amounts, scene }
    }
}

/// A scene that is only looked at.
struct Stand<'a> {
    cloud: Gaussians<ChunkedArray>,
    sky: Option<Environment<ChunkedArray>>,
    like: &'a Scene<CpuExecutor>,
}

/// Time of a picture, and its distance from the CPU's.
struct Picture {
    seconds: f64,
    agreement: f64,
    /// Bytes on the device.
    memory: u64,
}

impl fmt::Display for Picture {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { seconds, agreement, memory } = self;
        write!(out, "{:.2} | {agreement:.0} dB | {:.0}", seconds * 1e3, *memory as f64 / MEBIBYTE)
    }
}

impl<'a> Stand<'a> {
    fn new(viewer: &mut GpuExecutor<Storage>, like: &'a Scene<CpuExecutor>) -> Result<Self, GpuError> {
        let sky = like.state.light.as_ref().map(|(sky, _)| Ok(sky.with_values(viewer.upload(&sky.values)?)));
        Ok(Self { cloud: viewer.upload_gaussians(&like.state.gaussians)?, sky: sky.transpose()?, like })
    }

    fn filtered(&self, viewer: &mut GpuExecutor<Storage>) -> Result<Option<Light>, GpuError> {
        let scheme = self.like.profile.scheme;
        self.sky.as_ref().map(|sky| viewer.prefilter(sky, scheme, LevelRange::ALL)).transpose()
    }

    /// A picture, light filtered first.
    fn measure(&self, viewer: &mut GpuExecutor<Storage>, truth: &[f32]) -> Result<Picture, GpuError> {
        let Scene { camera, rules, .. } = self.like;
        let seconds = median(|| {
            let light = self.filtered(viewer)?;
            render(viewer, &self.cloud, light.as_ref(), camera, rules)?;
            viewer.finish()
        })?;
        let memory = viewer.memory_bytes();
        let light = self.filtered(viewer)?;
        let image = render_view(viewer, &self.cloud, light.as_ref(), camera, rules)?;
        Ok(Picture { seconds, agreement: psnr(mean_squared_difference(&image.values, truth)), memory })
    }

    fn measure_stages(&self, viewer: &mut GpuExecutor<Storage>, meter: &mut StageTimes) -> Result<(), GpuError> {
        let light = self.filtered(viewer)?;
        let Scene { camera, rules, .. } = self.like;
        measure_picture(viewer, &View { cloud: &self.cloud, light: light.as_ref(), camera, rules }, meter)
    }
}

/// Time of a stage on the device.
struct StageTime {
    stage: Stage,
    amounts: Amounts,
    seconds: f64,
    /// The kernel that takes the most, and its seconds.
    slowest: (&'static str, f64),
}

/// Measures stages by the device's own clock.
struct StageTimes {
    amounts: Amounts,
    times: Vec<StageTime>,
}

impl<P: Precision> Meter<GpuExecutor<P>> for StageTimes {
    fn measure<I, O>(
        &mut self,
        exec: &mut GpuExecutor<P>,
        stage: Stage,
        mut prepare: impl FnMut(&mut GpuExecutor<P>) -> Result<I, GpuError>,
        mut run: impl FnMut(&mut GpuExecutor<P>, I) -> Result<O, GpuError>,
    ) -> Result<(), GpuError> {
        let mut fastest: Option<StageTime> = None;
        for _ in 0..STAGE_RUNS {
            let prepared = prepare(exec)?;
            exec.kernel_times()?;
            run(exec, prepared)?;
            let times = exec.kernel_times()?;
            let seconds = times.iter().map(|(_, time)| time.seconds).sum();
            let slowest = times.iter().map(|(entry, time)| (*entry, time.seconds));
            let slowest = slowest.max_by(|(_, one), (_, other)| one.total_cmp(other)).unwrap_or(("", 0.0));
            if fastest.as_ref().is_none_or(|fastest| seconds < fastest.seconds) {
                fastest = Some(StageTime { stage, amounts: self.amounts, seconds, slowest });
            }
        }
        self.times.extend(fastest);
        Ok(())
    }
}

impl Bench {
    /// Prints what stages take, and which share of the ceilings they reach.
    fn print_stages(&self) {
        let Some(ceilings) = self.ceilings else { return };
        println!(
            "\n| profile | pixels | Gaussians | stored | stage | ms | most of it | MB | GB/s | of copying | Gpairs/s \
             | GFLOP/s | of multiplying |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|"
        );
        for (case, storage, times) in &self.stages {
            let stored = if *storage == Storage::F32 { "f32" } else { "f16" };
            times.iter().for_each(|time| println!("| {case} | {stored} | {} |", time.cells(&ceilings)));
        }
    }
}

impl StageTime {
    fn cells(&self, ceilings: &Ceilings) -> String {
        let Self { stage, amounts, seconds, slowest: (entry, most) } = self;
        let share = |rate: f64, ceiling: f64| format!("{:.1} | {:.0} %", rate * 1e-9, 100.0 * rate / ceiling);
        let rate = |amount: usize| amount as f64 / seconds;
        let bytes = amounts.bytes(*stage).map_or(" | | ".to_owned(), |bytes| {
            format!("{:.1} | {}", bytes as f64 * 1e-6, share(rate(bytes), ceilings.bytes))
        });
        let pairs = match stage {
            Stage::Blend | Stage::BlendVjp => format!("{:.2}", rate(amounts.elements(*stage)) * 1e-9),
            _ => String::new(),
        };
        let operations = amounts.operations(*stage);
        let operations = operations.map_or(" | ".to_owned(), |count| share(rate(count), ceilings.operations));
        format!(
            "`{}` | {:.3} | `{entry}` {:.0} % | {bytes} | {pairs} | {operations}",
            stage.name(),
            seconds * 1e3,
            100.0 * most / seconds
        )
    }
}

/// The median time of some repetitions, the first left out: kernels are compiled when they are
/// first used.
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
