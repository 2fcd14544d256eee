//! The benchmark of a packed folder (`scripts/bench-gpu --pack`): one table in eight minutes at
//! most, on a machine without compiler or network.
//!
//! The programs beside this one are `specula` and `agreement`, the tests of the GPU executor; the
//! data set to train on is in `../scene`. Rows are printed as soon as they are known.

use crate::measure::{Case, Reference, StageTime, measure_pictures, measure_steps};
use core::{error::Error, fmt::Display, time::Duration};
use serde_json::Value;
use specula_benches::stages::Stage;
use specula_core::pack::Storage;
use specula_gpu::{
    Ceilings, Gpu, GpuExecutor, KernelSet,
    stages::{
        blend::formulas::PixelBlock,
        blend_vjp::{ReplayBy, ReplayDivision},
    },
};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process::Command,
    thread::sleep,
    time::Instant,
};

/// Extent of the benchmark.
struct Extent {
    /// Time for all of it, in seconds, and the share of it that tests may take.
    seconds: f64,
    tests_share: f64,
    /// Names of the tests contain one of these; all tests if there are none.
    tests: &'static [&'static str],
    stages: &'static [Case],
    frames: [Case; 2],
    /// Iterations of the training, at most, and of one that shows how many there is time for.
    iterations: [u32; 2],
}

impl Extent {
    /// Whether goals are of this extent.
    const fn is_full(&self) -> bool {
        self.iterations[0] == FULL.iterations[0]
    }
}

const FULL: Extent = Extent {
    seconds: 460.0,
    tests_share: 0.3,
    tests: &[],
    stages: &[Case("3dgs", 800, 100_000), Case("specula", 800, 100_000)],
    frames: [Case("specula", 800, 200_000), Case("specula", 800, 1_000_000)],
    iterations: [30_000, 300],
};
const QUICK: Extent = Extent {
    seconds: 240.0,
    tests_share: 0.5,
    tests: &["every_formula_is_on_the_device", "kernels", "gradients_of_splats", "render_the_same_pictures"],
    stages: &[Case("specula", 200, 10_000)],
    frames: [Case("specula", 200, 10_000), Case("specula", 200, 50_000)],
    iterations: [200, 20],
};
/// Frames a second that hardware should reach with the first number of Gaussians, and seconds that
/// 30 000 iterations should take.
const GOALS: [f64; 2] = [500.0, 180.0];
/// Share of the time left that a training is planned to take at the pace of its first iterations,
/// before Gaussians are added.
const PLANNED: f64 = 0.3;
/// Stages that differ between the sets of kernels.
const VARIED: [Stage; 3] = [Stage::Bin, Stage::Blend, Stage::BlendVjp];
/// Seconds that are kept for the end of a training: its pictures are measured once more.
const RESERVE: f64 = 10.0;

/// Runs the benchmark, and prints its table.
pub(crate) fn run(is_quick: bool) -> Result<(), Box<dyn Error>> {
    let travel = Travel::new(if is_quick { QUICK } else { FULL })?;
    println!("| part | of what | measured | beside |\n|---|---|---|---|");
    let parts: [(&str, Part); 5] = [
        ("doctor", Travel::doctor),
        ("stages", Travel::stages),
        ("frames", Travel::frames),
        ("agreement", Travel::agreement),
        ("training", Travel::training),
    ];
    for (name, part) in parts {
        eprintln!("{:.0} s: {name}", travel.elapsed());
        if let Err(error) = part(&travel) {
            row(name, "failed", error, "");
        }
    }
    row("all", "seconds", format!("{:.0}", travel.elapsed()), format!("limit: {:.0}", travel.extent.seconds));
    Ok(fs::remove_dir_all(&travel.scratch)?)
}

type Part = fn(&Travel) -> Result<(), Box<dyn Error>>;

fn row(part: impl Display, what: impl Display, measured: impl Display, beside: impl Display) {
    println!("| {part} | {what} | {measured} | {beside} |");
}

struct Travel {
    extent: Extent,
    start: Instant,
    /// Folder of the programs.
    programs: PathBuf,
    /// Folder for files of this run.
    scratch: PathBuf,
    gpu: Gpu,
}

/// End of a program that was run, and what it printed.
struct Ran {
    is_complete: bool,
    printed: String,
    seconds: f64,
}

impl Travel {
    fn new(extent: Extent) -> Result<Self, Box<dyn Error>> {
        let program = std::env::current_exe()?;
        let programs = program.parent().ok_or("the program is in no folder")?.to_owned();
        let scratch = std::env::temp_dir().join(format!("specula-bench-{}", std::process::id()));
        fs::create_dir_all(&scratch)?;
        Ok(Self { extent, start: Instant::now(), programs, scratch, gpu: Gpu::new("")? })
    }

    fn elapsed(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn left(&self) -> f64 {
        (self.extent.seconds - self.elapsed()).max(0.0)
    }

    /// Runs a program beside this one, for a number of seconds at most.
    fn run(&self, program: &str, arguments: &[&str], seconds: f64) -> Result<Ran, Box<dyn Error>> {
        let log = self.scratch.join("log");
        let start = Instant::now();
        // Tests without an adapter fail there.
        let mut command = Command::new(self.programs.join(program));
        let command = command
            .args(arguments)
            .env("CI", "1")
            .stdout(File::create(&log)?)
            .stderr(File::create(self.scratch.join("errors"))?);
        let mut child = command.spawn().map_err(|error| format!("{program} does not start: {error}"))?;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break Some(status);
            }
            if start.elapsed().as_secs_f64() > seconds {
                child.kill()?;
                child.wait()?;
                break None;
            }
            sleep(Duration::from_millis(50));
        };
        let printed = String::from_utf8_lossy(&fs::read(&log)?).into_owned();
        Ok(Ran { is_complete: status.is_some(), printed, seconds: start.elapsed().as_secs_f64() })
    }

    fn doctor(&self) -> Result<(), Box<dyn Error>> {
        let Ran { printed, .. } = self.run("specula", &["doctor", "--json"], 60.0)?;
        let found: Value = serde_json::from_str(&printed)?;
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        row("doctor", "CPU", format!("{} threads, {}", found["cpu"]["threads"], text(&found["cpu"]["vectors"])), "");
        for adapter in found["adapters"].as_array().into_iter().flatten() {
            let [name, backend, driver, version] =
                ["name", "backend", "driver", "driver_info"].map(|key| text(&adapter[key]));
            let kind = if adapter["is_software"] == true { "software" } else { "hardware" };
            let limits = format!(
                "arrays up to {} MiB, {} KiB shared by a workgroup, subgroups of {}",
                adapter["array_mib_max"],
                adapter["workgroup_memory_bytes"].as_u64().unwrap_or_default() >> 10,
                adapter["subgroups"]
            );
            row("doctor", format!("adapter, {kind}"), format!("{name} ({backend}, {driver} {version})"), limits);
        }
        let info = self.gpu.info();
        row("doctor", "measured below", &info.name, format!("kernels for {}", name_of(KernelSet::of(&self.gpu))));
        Ok(())
    }

    fn stages(&self) -> Result<(), Box<dyn Error>> {
        let Some(ceilings) = GpuExecutor::new(self.gpu.clone()).ceilings()? else {
            row("stages", "all", "kernels cannot be timed here", "");
            return Ok(());
        };
        let Ceilings { bytes, operations } = ceilings;
        row("ceiling", "copying", format!("{:.1} GB/s", bytes * 1e-9), "");
        row("ceiling", "multiplying and adding", format!("{:.0} GFLOP/s", operations * 1e-9), "");
        for case in self.extent.stages {
            let like = Reference::new(case);
            let own = KernelSet::of(&self.gpu);
            let exec = &mut GpuExecutor::new(self.gpu.clone());
            for kernels in [own].into_iter().chain(KernelSet::ALL.into_iter().filter(|kernels| *kernels != own)) {
                exec.set_kernels(kernels);
                let (_, of_picture) = measure_pictures(&self.gpu, kernels, Storage::F32, &like)?;
                let (step, _, times) = measure_steps(exec, case, &like)?;
                let step = format!("{:.2} ms", step * 1e3);
                row("stages", format!("step, {case}, kernels for {}", name_of(kernels)).replace(" | ", ", "), step, "");
                let is_shown = |time: &&StageTime| kernels == own || VARIED.contains(&time.stage);
                of_picture
                    .iter()
                    .chain(&times)
                    .filter(is_shown)
                    .for_each(|time| print_stage(case, time, &ceilings, name_of(kernels)));
            }
            self.divisions(case, &like, &ceilings)?;
        }
        Ok(())
    }

    /// The gradient of compositing in other divisions than the one in use.
    fn divisions(&self, case: &Case, like: &Reference, ceilings: &Ceilings) -> Result<(), Box<dyn Error>> {
        let block = |width, height| PixelBlock { width, height };
        let by_splats =
            |width, height, count, segment| ReplayBy::Splats { block: block(width, height), count, segment };
        let divisions = [
            ReplayBy::Pixels(block(2, 2)),
            by_splats(2, 1, 32, 64),
            by_splats(4, 1, 32, 128),
            by_splats(4, 1, 64, 128),
            by_splats(8, 1, 32, 64),
        ];
        let exec = &mut GpuExecutor::new(self.gpu.clone());
        for by in divisions {
            exec.set_replay_division(ReplayDivision { by, ..exec.replay_division() });
            let (_, _, times) = measure_steps(exec, case, like)?;
            let name = match by {
                ReplayBy::Pixels(PixelBlock { width, height }) => format!("{width} × {height} pixels an invocation"),
                ReplayBy::Splats { block: PixelBlock { width, height }, count, segment } => {
                    format!("{count} of {segment} splats at once, {width} × {height} pixels a step")
                }
            };
            let replays = times.iter().filter(|time| time.stage == Stage::BlendVjp);
            replays.for_each(|time| print_stage(case, time, ceilings, &name));
        }
        Ok(())
    }

    fn frames(&self) -> Result<(), Box<dyn Error>> {
        for (index, case) in self.extent.frames.iter().enumerate() {
            let like = Reference::new(case);
            for (storage, name) in [(Storage::F32, "f32"), (Storage::F16, "f16")] {
                let (picture, _) = measure_pictures(&self.gpu, KernelSet::of(&self.gpu), storage, &like)?;
                let goal = if index == 0 && self.extent.is_full() {
                    format!(", goal: {:.0}", GOALS[0])
                } else {
                    String::new()
                };
                row(
                    "frames",
                    format!("{case} shaded Gaussians in {name}").replace(" | ", ", "),
                    format!("{:.1} a second ({:.2} ms)", 1.0 / picture.seconds, picture.seconds * 1e3),
                    format!("{:.0} dB of the CPU's{goal}", picture.agreement),
                );
            }
        }
        Ok(())
    }

    fn agreement(&self) -> Result<(), Box<dyn Error>> {
        let limit = self.extent.tests_share * self.extent.seconds;
        let Ran { is_complete, printed, seconds } = self.run("agreement", self.extent.tests, limit.min(self.left()))?;
        let ends = |how: &str| {
            let names = printed.lines().filter(|line| line.ends_with(how));
            names.filter_map(|line| line.strip_prefix("test ")?.split_once(" ... ")).map(|(name, _)| name).collect()
        };
        let (passed, failed): (Vec<&str>, Vec<&str>) = (ends("... ok"), ends("... FAILED"));
        let end = if is_complete { String::new() } else { ", others were cut off".to_owned() };
        row(
            "agreement",
            "tests against the CPU executor and the formulas",
            format!("{} passed, {} failed{end}", passed.len(), failed.len()),
            format!("{seconds:.0} s"),
        );
        failed.iter().for_each(|name| row("agreement", format!("`{name}`"), "failed", ""));
        Ok(())
    }

    fn training(&self) -> Result<(), Box<dyn Error>> {
        let [most, first] = self.extent.iterations;
        let Trained { seconds, .. } = self.train(first)?;
        let planned = PLANNED * self.left() / (seconds / f64::from(first));
        let iterations = (planned as u32).clamp(first, most);
        let trained = self.train(iterations)?;
        let Trained { seconds, psnr, gaussians } = trained;
        let goal = if self.extent.is_full() {
            format!("; goal: {:.0} s for {most} iterations", GOALS[1])
        } else {
            String::new()
        };
        row(
            "training",
            format!("scene, `specula`, {iterations} iterations"),
            format!("{psnr:.2} dB after {seconds:.1} s"),
            format!("{gaussians} Gaussians, {:.2} ms an iteration{goal}", seconds / f64::from(iterations) * 1e3),
        );
        Ok(())
    }

    /// Trains on the scene for a number of iterations.
    fn train(&self, iterations: u32) -> Result<Trained, Box<dyn Error>> {
        let scene = self.programs.join("../scene").to_string_lossy().into_owned();
        let model = self.scratch.join(format!("model-{iterations}"));
        let (count, folder) = (iterations.to_string(), model.to_string_lossy().into_owned());
        let arguments = [
            "train",
            &scene,
            "-m",
            &folder,
            "--eval",
            "--iterations",
            &count,
            "--test-iterations",
            &count,
            "--executor",
            "gpu",
            "--quiet",
        ];
        let ran = self.run("specula", &arguments, (self.left() - RESERVE).max(0.0))?;
        Trained::read(&model, iterations).ok_or_else(|| {
            let said = fs::read_to_string(self.scratch.join("errors")).unwrap_or_default();
            let how = if ran.is_complete { "ended without a measure" } else { "was cut off" };
            format!("a training of {iterations} iterations {how}: {}", said.lines().last().unwrap_or("")).into()
        })
    }
}

/// Measures of a training.
struct Trained {
    seconds: f64,
    psnr: f64,
    gaussians: u64,
}

impl Trained {
    /// Measures in the timeline of a model.
    fn read(model: &Path, iterations: u32) -> Option<Self> {
        let timeline: Value = serde_json::from_slice(&fs::read(model.join("timeline.json")).ok()?).ok()?;
        let at_end = &timeline[format!("ours_{iterations}")];
        Some(Self {
            seconds: at_end["seconds"].as_f64()?,
            psnr: at_end["PSNR"].as_f64()?,
            gaussians: at_end["gaussians"].as_u64()?,
        })
    }
}

fn name_of(kernels: KernelSet) -> &'static str {
    match kernels {
        KernelSet::Software => "software drivers",
        KernelSet::Hardware => "hardware",
    }
}

fn print_stage(case: &Case, time: &StageTime, ceilings: &Ceilings, variant: &str) {
    let what = format!("`{}`, {case}, {variant}", time.stage.name()).replace(" | ", ", ");
    let [bytes, operations] = time.shares(ceilings);
    let percent = |share: Option<f64>, of: &str| share.map(|share| format!("{:.0} % of {of}", 100.0 * share));
    let shares: Vec<String> =
        [percent(bytes, "copying"), percent(operations, "multiplying")].into_iter().flatten().collect();
    row("stages", what, format!("{:.3} ms", time.seconds * 1e3), shares.join(", "));
}
