//! The groups of `stages.rs` on a GPU, if there is one; on a software driver with a smaller scene.

mod own;

use criterion::{Criterion, criterion_group, criterion_main};
use own::{scene, work::work_of};
use specula_benches::{
    groups::Groups,
    scene::View,
    stages::{Amounts, Meter, Stage, measure_picture, measure_step},
};
use specula_core::pack::Storage;
use specula_cpu::CpuExecutor;
use specula_gpu::{Gpu, GpuError, GpuExecutor};

const PROFILES: [&str; 3] = ["3dgs", "paper", "specula"];

/// Groups to measure, and their sample counts.
struct Extent {
    size: u32,
    count: usize,
    samples: usize,
}

const HARDWARE: Extent = Extent { size: 800, count: 100_000, samples: 20 };
const SOFTWARE: Extent = Extent { size: 100, count: 2000, samples: 10 };

fn stages(criterion: &mut Criterion) {
    match Gpu::new("") {
        Ok(gpu) => {
            let extent = if gpu.is_software() { SOFTWARE } else { HARDWARE };
            let mut exec = GpuExecutor::new(gpu);
            let mut measure = |profile: &&str| stages_of(criterion, &mut exec, profile, &extent);
            PROFILES.iter().try_for_each(&mut measure).expect("a device takes so small a scene");
        }
        Err(error) => println!("no GPU is measured: {error}"),
    }
}

fn stages_of(
    criterion: &mut Criterion,
    exec: &mut GpuExecutor,
    profile: &str,
    extent: &Extent,
) -> Result<(), GpuError> {
    let Extent { size, count, samples } = *extent;
    let mut cpu = CpuExecutor::new();
    let same = scene(&mut cpu, profile, size, count).expect("the CPU takes every scene");
    let mut scene = scene(exec, profile, size, count)?;
    let amounts = Amounts {
        gaussians: count,
        layout: scene.state.gaussians.layout,
        storage: Storage::F32,
        pixels: (size * size) as usize,
        rules: scene.rules,
        work: work_of(&mut cpu, &same.state.gaussians, &same.camera),
    };
    let name = format!("{profile}, {count} at {size} on the GPU");
    let mut groups = Groups { criterion, name, samples, amounts, finish: GpuExecutor::finish };
    let light = scene.filtered(exec)?;
    let view =
        View { cloud: &scene.state.gaussians, light: light.as_ref(), camera: &scene.camera, rules: &scene.rules };
    measure_picture(exec, &view, &mut groups)?;
    measure_step(exec, &mut scene, &mut groups)?;
    groups.measure(exec, Stage::TrainStep, |_| Ok(()), |exec, ()| scene.train(exec))
}

criterion_group!(benches, stages);
criterion_main!(benches);
