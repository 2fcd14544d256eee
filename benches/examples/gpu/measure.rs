//! Times of one case: pictures, steps and their stages, beside the CPU's.

use crate::own::{scene, work::work_of};
use core::{fmt, time::Duration};
use specula_benches::{
    scene::{Scene, View},
    stages::{Amounts, Meter, Stage, measure_picture, measure_step},
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
use specula_gpu::{Ceilings, ChunkedArray, Gpu, GpuError, GpuExecutor, KernelSet, Light, Precision};
use specula_train::evaluate::render_view;
use std::time::Instant;

/// Time budget of a measurement; it is repeated until the budget is used up.
pub(crate) const PATIENCE: Duration = Duration::from_secs(1);
const REPETITIONS_MAX: usize = 100;
/// A stage is run so often; the fastest counts, and the first also compiles kernels.
const STAGE_RUNS: usize = 3;
pub(crate) const MEBIBYTE: f64 = 1_048_576.0;

/// A profile, and the sizes of a picture and of a cloud.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Case(pub(crate) &'static str, pub(crate) u32, pub(crate) usize);

impl Case {
    /// Pixels and Gaussians, which all times grow with.
    pub(crate) fn extent(&self) -> f64 {
        f64::from(self.1 * self.1) + self.2 as f64
    }
}

impl fmt::Display for Case {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(profile, size, count) = self;
        write!(out, "{profile} | {size} × {size} | {count}")
    }
}

/// Pictures of a viewer, and their stages where kernels can be timed.
pub(crate) fn measure_pictures(
    gpu: &Gpu,
    kernels: KernelSet,
    storage: Storage,
    like: &Reference,
) -> Result<(Picture, Vec<StageTime>), GpuError> {
    let mut viewer = GpuExecutor::viewer(gpu.clone(), storage);
    viewer.set_kernels(kernels);
    let stand = Stand::new(&mut viewer, &like.scene)?;
    let picture = stand.measure(&mut viewer, &like.image)?;
    let mut stage_times = StageTimes { amounts: Amounts { storage, ..like.amounts }, times: Vec::new() };
    if viewer.time_kernels(true) {
        stand.measure_stages(&mut viewer, &mut stage_times)?;
    }
    Ok((picture, stage_times.times))
}

/// Seconds of a step, bytes of the device that it takes, and its stages where kernels can be timed.
pub(crate) fn measure_steps(
    exec: &mut GpuExecutor,
    case: &Case,
    like: &Reference,
) -> Result<(f64, u64, Vec<StageTime>), GpuError> {
    let Case(profile, size, count) = *case;
    let mut scene = scene(exec, profile, size, count)?;
    let seconds = median(|| {
        scene.train(exec)?;
        exec.finish()
    })?;
    let memory = exec.memory_bytes();
    let mut stage_times = StageTimes { amounts: like.amounts, times: Vec::new() };
    if exec.time_kernels(true) {
        measure_step(exec, &mut scene, &mut stage_times)?;
    }
    exec.time_kernels(false);
    Ok((seconds, memory, stage_times.times))
}

/// A case on the CPU.
pub(crate) struct Reference {
    scene: Scene<CpuExecutor>,
    image: Vec<f32>,
    /// Seconds of a step.
    pub(crate) step: f64,
    amounts: Amounts,
}

impl Reference {
    pub(crate) fn new(case: &Case) -> Self {
        let Case(profile, size, count) = *case;
        let mut cpu = CpuExecutor::new();
        let mut scene = scene(&mut cpu, profile, size, count).expect("the CPU takes every scene");
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
pub(crate) struct Picture {
    pub(crate) seconds: f64,
    pub(crate) agreement: f64,
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
        let sky = match &like.state.light {
            Some((sky, _)) => Some(sky.with_values(viewer.upload(&sky.values)?)),
            None => None,
        };
        Ok(Self { cloud: viewer.upload_gaussians(&like.state.gaussians)?, sky, like })
    }

    fn filtered(&self, viewer: &mut GpuExecutor<Storage>) -> Result<Option<Light>, GpuError> {
        let scheme = self.like.rules.scheme;
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
pub(crate) struct StageTime {
    pub(crate) stage: Stage,
    amounts: Amounts,
    pub(crate) seconds: f64,
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

impl StageTime {
    /// Shares of the ceilings, where bytes and operations are counted.
    pub(crate) fn shares(&self, ceilings: &Ceilings) -> [Option<f64>; 2] {
        let share = |amount: Option<usize>, ceiling: f64| amount.map(|amount| amount as f64 / self.seconds / ceiling);
        let Self { stage, amounts, .. } = self;
        [share(amounts.bytes(*stage), ceilings.bytes), share(amounts.operations(*stage), ceilings.operations)]
    }

    /// Cells of the table of stages.
    pub(crate) fn cells(&self, ceilings: &Ceilings) -> String {
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
pub(crate) fn median<E>(mut run: impl FnMut() -> Result<(), E>) -> Result<f64, E> {
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
