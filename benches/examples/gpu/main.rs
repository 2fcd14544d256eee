//! Times of pictures, training steps and their stages on a GPU, beside the device's ceilings; see
//! `scripts/bench-gpu`.
//!
//! Arguments: part of an adapter's name (empty for any), and how many seconds there are. A case
//! that would take longer than is left is not begun. With `travel` as the first argument, the
//! benchmark of a packed folder; with `step`, only the seconds of steps.

mod measure;
#[path = "../../benches/own/mod.rs"]
mod own;
mod travel;

use core::error::Error;
use measure::{Case, MEBIBYTE, PATIENCE, Reference, StageTime, measure_pictures, measure_steps, median};
use specula_core::pack::Storage;
use specula_gpu::{Ceilings, Gpu, GpuError, GpuExecutor, KernelSet};
use std::{process::ExitCode, time::Instant};

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
/// Times of a case: pictures and steps of both executors, and their stages one by one.
const ROUNDS: f64 = 12.0;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match *arguments {
        ["travel"] => travel::run(false),
        ["travel", "--quick"] => travel::run(true),
        ["step", profile, size, count, ref kernels @ ..] => print_step(profile, size.parse()?, count.parse()?, kernels),
        _ => {
            let name = arguments.first().copied().unwrap_or_default();
            let budget = arguments.get(1).and_then(|seconds| seconds.parse().ok()).unwrap_or(400.0);
            Ok(print_tables(name, budget)?)
        }
    }
}

/// Prints the seconds of a step of training, median of some, with the kernels for hardware or for a
/// software driver if they are named.
fn print_step(profile: &str, size: u32, count: usize, kernels: &[&str]) -> Result<(), Box<dyn Error>> {
    let exec = &mut GpuExecutor::new(Gpu::new("")?);
    match kernels {
        [] => {}
        ["hardware"] => exec.set_kernels(KernelSet::Hardware),
        ["software"] => exec.set_kernels(KernelSet::Software),
        _ => return Err("kernels are hardware or software".into()),
    }
    let mut scene = own::scene(exec, profile, size, count)?;
    let seconds = median(|| {
        scene.train(exec)?;
        exec.finish()
    })?;
    println!("{seconds:.4}");
    Ok(())
}

/// Prints the tables of all cases, and of their stages.
fn print_tables(name: &str, budget: f64) -> Result<(), GpuError> {
    let start = Instant::now();
    let mut bench = Bench::new(Gpu::new(name)?)?;
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

/// A device, and its measured rates.
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
        let kernels = KernelSet::of(&self.gpu);
        let (in_full, stages_in_full) = measure_pictures(&self.gpu, kernels, Storage::F32, &reference)?;
        let (halves, stages_of_halves) = measure_pictures(&self.gpu, kernels, Storage::F16, &reference)?;
        let exec = &mut GpuExecutor::new(self.gpu.clone());
        let (step, memory, stages_of_step) = measure_steps(exec, case, &reference)?;
        self.stages.extend([
            (*case, Storage::F32, stages_in_full),
            (*case, Storage::F16, stages_of_halves),
            (*case, Storage::F32, stages_of_step),
        ]);
        let cpu_step = reference.step;
        let [step_ms, cpu_ms, mebibytes] = [step * 1e3, cpu_step * 1e3, memory as f64 / MEBIBYTE];
        println!("| {case} | f32 | {in_full} | {step_ms:.2} | {cpu_ms:.2} | {mebibytes:.0} |");
        println!("| {case} | f16 | {halves} | | | |");
        self.pace = self.pace.max((2.0 * in_full.seconds + step + cpu_step) / case.extent());
        Ok(())
    }

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
