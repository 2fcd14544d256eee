//! Executors that commands run on.

use crate::{
    args::MachineOptions,
    failure::Failure,
    fit::{Run, Start},
};
use specula_core::executor::Executor;
use specula_cpu::CpuExecutor;
use specula_scene::{ExecutorChoice, RenderOptions};
use specula_train::{
    trainer::{Settings, TrainError, Trainer},
    view::View,
};

impl From<&MachineOptions> for RenderOptions {
    fn from(options: &MachineOptions) -> Self {
        Self { executor: options.executor.clone(), storage: options.storage(), projection: options.projection }
    }
}

/// Starts a training on the executor that is asked for, and tells whether that is a device, which
/// may fail. A device that fails at the start leaves the training to the CPU.
pub(crate) fn train(
    choice: &ExecutorChoice,
    settings: Settings,
    views: &[View],
    start: &Start<'_>,
) -> Result<(Box<dyn Run>, bool), Failure> {
    match choice.open()? {
        #[cfg(feature = "gpu")]
        specula_scene::Device::Gpu(gpu) => {
            tracing::info!("training on {}", words(&gpu));
            match begin(specula_gpu::GpuExecutor::new(*gpu), settings.clone(), views, start).map_err(Failure::from) {
                Ok(trainer) => return Ok((Box::new(trainer), true)),
                Err(failure) if failure.is_of_device() => tracing::warn!("{failure}; the CPU takes over"),
                Err(failure) => return Err(failure),
            }
        }
        _ => {}
    }
    tracing::info!("training on the CPU, {} threads", rayon::current_num_threads());
    Ok((Box::new(begin(CpuExecutor::new(), settings, views, start)?), false))
}

/// Adapter of a device, for a note.
#[cfg(feature = "gpu")]
fn words(gpu: &specula_gpu::Gpu) -> String {
    let name = &gpu.info().name;
    match gpu.is_software() {
        true => format!("{name}, a driver that computes on the CPU; --executor cpu is faster"),
        false => format!("the GPU {name}"),
    }
}

/// Opens a GPU that is asked for by name, so that its absence is an error before anything is
/// loaded.
pub(crate) fn check(choice: &ExecutorChoice) -> Result<(), Failure> {
    match choice {
        ExecutorChoice::Gpu(_) => Ok(choice.open().map(drop)?),
        ExecutorChoice::Auto | ExecutorChoice::Cpu => Ok(()),
    }
}

/// Starts or resumes a training on an executor.
pub(crate) fn begin<E: Executor>(
    exec: E,
    settings: Settings,
    views: &[View],
    start: &Start<'_>,
) -> Result<Trainer<E>, TrainError<E::Error>> {
    match start {
        Start::Points(points) => Trainer::new(exec, settings, views, points),
        Start::Learned(snapshot) => Trainer::resume(exec, settings, views, snapshot),
    }
}
