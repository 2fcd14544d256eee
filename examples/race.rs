//! Two executors in a race, stage by stage of a picture: `race`.

use core::{error::Error, time::Duration};
use specula_benches::{
    scene::{Scene, View},
    stages::{Meter, Stage, measure_picture},
};
use specula_core::{
    executor::{Executor, Renderer},
    loss::LossWeights,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::Layout,
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{Gpu, GpuExecutor};
use std::time::Instant;

const RUNS: usize = 5;

/// Times of stages, each the fastest of some runs.
struct Fastest<E: Renderer> {
    /// Waits until the executor is idle.
    finish: fn(&mut E) -> Result<(), E::Error>,
    times: Vec<(Stage, Duration)>,
}

impl<E: Renderer> Meter<E> for Fastest<E> {
    fn measure<I, O>(
        &mut self,
        exec: &mut E,
        stage: Stage,
        mut prepare: impl FnMut(&mut E) -> Result<I, E::Error>,
        mut run: impl FnMut(&mut E, I) -> Result<O, E::Error>,
    ) -> Result<(), E::Error> {
        let mut fastest = Duration::MAX;
        for _ in 0..RUNS {
            let input = prepare(exec)?;
            (self.finish)(exec)?;
            let start = Instant::now();
            let output = run(exec, input)?;
            (self.finish)(exec)?;
            fastest = fastest.min(start.elapsed());
            drop(output);
        }
        self.times.push((stage, fastest));
        Ok(())
    }
}

/// Times of the stages of a picture with 20 000 Gaussians on an executor.
fn times<E: Executor>(
    mut exec: E,
    finish: fn(&mut E) -> Result<(), E::Error>,
) -> Result<Vec<(Stage, Duration)>, E::Error> {
    let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Color);
    let scene = Scene::new(&mut exec, Layout::shaded(Some(3)), &rules, &LossWeights::NONE, 400, 20_000)?;
    let light = scene.filtered(&mut exec)?;
    let view = View { cloud: &scene.state.gaussians, light: light.as_ref(), camera: &scene.camera, rules: &rules };
    let mut fastest = Fastest { finish, times: Vec::new() };
    measure_picture(&mut exec, &view, &mut fastest)?;
    Ok(fastest.times)
}

fn main() -> Result<(), Box<dyn Error>> {
    let cpu = times(CpuExecutor::new(), |_| Ok(()))?;
    let gpu = times(GpuExecutor::new(Gpu::new("")?), GpuExecutor::finish)?;
    println!("stage            CPU ms    GPU ms");
    for ((stage, cpu), (_, gpu)) in cpu.iter().zip(&gpu) {
        println!("{:<14} {:>8.2}  {:>8.2}", stage.name(), 1e3 * cpu.as_secs_f64(), 1e3 * gpu.as_secs_f64());
    }
    Ok(())
}

#[test]
fn stages_are_measured_in_their_order() {
    let times = times(CpuExecutor::new(), |_| Ok(())).unwrap();
    let names: Vec<_> = times.iter().map(|(stage, _)| stage.name()).collect();
    assert_eq!(names, ["project", "shade", "bin", "blend", "shade_pixels", "frame"]);
}
