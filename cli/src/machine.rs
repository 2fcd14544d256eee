//! What renders: the processor, or a GPU.

use crate::{
    args::MachineOptions,
    failure::Failure,
    fit::{Run, Start},
    typed::kept_as_typed,
};
use core::{fmt, str::FromStr};
use specula_core::{
    camera::Camera,
    cutoffs::{Cutoffs, ProjectionModel},
    executor::{Executor, Renderer},
    pack::Storage,
    rules::RenderRules,
    scene::{Environment, Gaussians, Image},
};
use specula_cpu::{CpuExecutor, CpuViewer, prefilter::Light};
use specula_scene::Scene;
use specula_train::{
    evaluate::render_view,
    trainer::{Settings, TrainError, Trainer},
    view::View,
};

/// Which executor was asked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum ExecutorChoice {
    /// A GPU if there is one, else the processor.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// An adapter of wgpu with this in its name; empty for any.
    Gpu(String),
}

impl FromStr for ExecutorChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':').unwrap_or((text, "")) {
            ("auto", "") => Ok(Self::Auto),
            ("cpu", "") => Ok(Self::Cpu),
            ("gpu", name) => Ok(Self::Gpu(name.to_owned())),
            _ => Err("use auto, cpu, gpu or gpu:NAME, where `specula doctor` lists the names".to_owned()),
        }
    }
}

/// As it is typed.
impl fmt::Display for ExecutorChoice {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => out.write_str("auto"),
            Self::Cpu => out.write_str("cpu"),
            Self::Gpu(name) if name.is_empty() => out.write_str("gpu"),
            Self::Gpu(name) => write!(out, "gpu:{name}"),
        }
    }
}

kept_as_typed!(ExecutorChoice);

/// A scene where it is rendered, under any of several lights.
pub(crate) trait Machine: Send {
    /// A view under the light in this place, if there is one: the channels, then transmittance.
    fn view(&mut self, place: usize, camera: &Camera, rules: &RenderRules) -> Result<Image<Vec<f32>>, Failure>;
    /// Filters a light into a place, instead of the one that was there.
    fn put_light(&mut self, place: usize, light: &Environment<Vec<f32>>, rules: &RenderRules) -> Result<(), Failure>;
    /// Shows other Gaussians from now on.
    fn put_gaussians(&mut self, gaussians: &Gaussians<Vec<f32>>) -> Result<(), Failure>;
}

impl fmt::Debug for dyn Machine {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Machine")
    }
}

/// A scene on an executor.
struct Loaded<E: Renderer> {
    exec: E,
    gaussians: Gaussians<E::Array>,
    lights: Vec<Option<E::Light>>,
    /// A light as it is stored.
    rounded: fn(E::Light, Storage) -> E::Light,
    storage: Storage,
}

impl<E: Renderer> Loaded<E>
where
    E::Error: Into<Failure>,
{
    fn new(
        mut exec: E,
        gaussians: &Gaussians<Vec<f32>>,
        rounded: fn(E::Light, Storage) -> E::Light,
        storage: Storage,
    ) -> Result<Self, Failure> {
        let gaussians = exec.upload_gaussians(gaussians).map_err(Into::into)?;
        Ok(Self { exec, gaussians, lights: Vec::new(), rounded, storage })
    }
}

impl<E> Machine for Loaded<E>
where
    E: Renderer + Send,
    E::Array: Send,
    E::Light: Send,
    E::Error: Into<Failure>,
{
    fn view(&mut self, place: usize, camera: &Camera, rules: &RenderRules) -> Result<Image<Vec<f32>>, Failure> {
        let light = self.lights.get(place).and_then(Option::as_ref);
        render_view(&mut self.exec, &self.gaussians, light, camera, rules).map_err(Into::into)
    }

    fn put_light(&mut self, place: usize, light: &Environment<Vec<f32>>, rules: &RenderRules) -> Result<(), Failure> {
        let values = self.exec.upload(&light.values).map_err(Into::into)?;
        let light = self.exec.prefilter(&light.with_values(values), rules.scheme, rules.levels).map_err(Into::into)?;
        let places = self.lights.len().max(place + 1);
        self.lights.resize_with(places, || None);
        self.lights[place] = Some((self.rounded)(light, self.storage));
        Ok(())
    }

    fn put_gaussians(&mut self, gaussians: &Gaussians<Vec<f32>>) -> Result<(), Failure> {
        self.gaussians = self.exec.upload_gaussians(gaussians).map_err(Into::into)?;
        Ok(())
    }
}

/// Where the light of a scene that has only one is.
pub(crate) const OWN_LIGHT: usize = 0;

/// A scene, loaded where it was asked to be rendered; `light` is what it looks up. The Gaussians are rounded already.
pub(crate) fn load(
    options: &MachineOptions,
    scene: Scene,
    light: Option<Environment<Vec<f32>>>,
    rules: &RenderRules,
) -> Result<Box<dyn Machine>, Failure> {
    let cutoffs = Cutoffs::DEFAULT.with_projection(options.projection);
    match (&options.executor, options.projection) {
        (choice, ProjectionModel::Affine) => {
            if let Some(device) = device::choose(choice)? {
                let machine = device.load(&scene.gaussians, options.storage())?;
                return lit(machine, light, rules);
            }
        }
        (ExecutorChoice::Gpu(_), _) => {
            return Err(Failure::Input(
                "the processor alone projects otherwise than affine; use --projection with --executor cpu".into(),
            ));
        }
        _ => (),
    }
    load_within(scene, light, rules, cutoffs, options.storage())
}

/// A scene on the processor, within these cutoffs and stored so.
pub(crate) fn load_within(
    scene: Scene,
    light: Option<Environment<Vec<f32>>>,
    rules: &RenderRules,
    cutoffs: Cutoffs,
    storage: Storage,
) -> Result<Box<dyn Machine>, Failure> {
    lit(Box::new(Loaded::new(CpuViewer::new(cutoffs), &scene.gaussians, rounded, storage)?), light, rules)
}

fn lit(
    mut machine: Box<dyn Machine>,
    light: Option<Environment<Vec<f32>>>,
    rules: &RenderRules,
) -> Result<Box<dyn Machine>, Failure> {
    if let Some(light) = light {
        machine.put_light(OWN_LIGHT, &light, rules)?;
    }
    Ok(machine)
}

fn rounded(mut light: Light, storage: Storage) -> Light {
    light.round(storage);
    light
}

/// A training where it was asked for, and whether that is a device, which may fail. One that fails at once leaves it to
/// the processor.
pub(crate) fn train(
    choice: &ExecutorChoice,
    settings: Settings,
    views: &[View],
    start: &Start<'_>,
) -> Result<(Box<dyn Run>, bool), Failure> {
    if let Some(device) = device::choose(choice)? {
        tracing::info!("training on {}", device.words());
        match device.train(settings.clone(), views, start) {
            Err(failure) if failure.is_of_device() => tracing::warn!("{failure}; the processor takes over"),
            run => return Ok((run?, true)),
        }
    }
    tracing::info!("training on the CPU, {} threads", rayon::current_num_threads());
    Ok((Box::new(begin(CpuExecutor::new(), settings, views, start)?), false))
}

/// Whether there is what was asked for by its name: known before anything is loaded.
pub(crate) fn check(choice: &ExecutorChoice) -> Result<(), Failure> {
    match choice {
        ExecutorChoice::Gpu(_) => device::choose(choice).map(drop),
        ExecutorChoice::Auto | ExecutorChoice::Cpu => Ok(()),
    }
}

/// A run from its start on an executor.
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

#[cfg(feature = "gpu")]
pub(crate) mod device {
    //! GPUs, where the program knows them.

    use super::{ExecutorChoice, Loaded, Machine, begin};
    use crate::{
        failure::Failure,
        fit::{Run, Start},
    };
    use specula_core::{pack::Storage, scene::Gaussians};
    use specula_gpu::{
        Gpu, GpuExecutor, GpuViewer,
        device::{AdapterReport, adapters},
    };
    use specula_train::{trainer::Settings, view::View};
    use std::path::Path;

    /// A device that was opened.
    #[derive(Debug)]
    pub(crate) struct Device(Gpu);

    /// The device that was asked for; none for the processor.
    pub(super) fn choose(choice: &ExecutorChoice) -> Result<Option<Device>, Failure> {
        match choice {
            ExecutorChoice::Cpu => Ok(None),
            ExecutorChoice::Gpu(name) => Ok(Some(Device(Gpu::new(name)?))),
            ExecutorChoice::Auto if !may_have_hardware() => Ok(None),
            ExecutorChoice::Auto => Ok(preferred(&adapters()).and_then(open)),
        }
    }

    /// Whether it is worth while to ask drivers for adapters of real hardware: on Linux they show as devices, and asking
    /// drivers that have none takes time and makes them print.
    fn may_have_hardware() -> bool {
        const DEVICES: [&str; 3] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg"];
        !cfg!(target_os = "linux") || DEVICES.iter().any(|device| Path::new(device).exists())
    }

    /// The adapter that is used when none is asked for: the first of real hardware. A driver that computes on the
    /// processor is slower there than the CPU executor.
    pub(crate) fn preferred(reports: &[AdapterReport]) -> Option<&AdapterReport> {
        reports.iter().find(|report| !report.is_software)
    }

    fn open(report: &AdapterReport) -> Option<Device> {
        match Gpu::new(&report.info.name) {
            Ok(gpu) => Some(Device(gpu)),
            Err(error) => {
                tracing::warn!("{error}; the processor takes over");
                None
            }
        }
    }

    impl Device {
        /// The adapter, in words.
        pub(super) fn words(&self) -> String {
            let name = &self.0.info().name;
            match self.0.is_software() {
                true => format!("{name}, a driver that computes on the CPU; --executor cpu is faster"),
                false => format!("the GPU {name}"),
            }
        }

        /// Gaussians on the device, which rounds what it stores itself.
        pub(super) fn load(
            self,
            gaussians: &Gaussians<Vec<f32>>,
            storage: Storage,
        ) -> Result<Box<dyn Machine>, Failure> {
            let exec = GpuViewer::new(GpuExecutor::new(self.0), storage);
            Ok(Box::new(Loaded::new(exec, gaussians, |light, _| light, storage)?))
        }

        pub(super) fn train(
            self,
            settings: Settings,
            views: &[View],
            start: &Start<'_>,
        ) -> Result<Box<dyn Run>, Failure> {
            Ok(Box::new(begin(GpuExecutor::new(self.0), settings, views, start)?))
        }
    }
}

#[cfg(not(feature = "gpu"))]
mod device {
    //! A program that knows no GPUs.

    use super::{ExecutorChoice, Machine};
    use crate::{
        failure::Failure,
        fit::{Run, Start},
    };
    use specula_core::{pack::Storage, scene::Gaussians};
    use specula_train::{trainer::Settings, view::View};

    /// There is none.
    pub(super) enum Device {}

    pub(super) fn choose(choice: &ExecutorChoice) -> Result<Option<Device>, Failure> {
        match choice {
            ExecutorChoice::Gpu(_) => {
                Err(Failure::Input("this program was built without its feature `gpu`; use --executor cpu".into()))
            }
            _ => Ok(None),
        }
    }

    impl Device {
        pub(super) fn words(&self) -> String {
            match *self {}
        }

        pub(super) fn load(
            self,
            _gaussians: &Gaussians<Vec<f32>>,
            _storage: Storage,
        ) -> Result<Box<dyn Machine>, Failure> {
            match self {}
        }

        pub(super) fn train(
            self,
            _settings: Settings,
            _views: &[View],
            _start: &Start<'_>,
        ) -> Result<Box<dyn Run>, Failure> {
            match self {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_executor_is_named_with_or_without_its_adapter() {
        assert_eq!("auto".parse(), Ok(ExecutorChoice::Auto));
        assert_eq!("cpu".parse(), Ok(ExecutorChoice::Cpu));
        assert_eq!("gpu".parse(), Ok(ExecutorChoice::Gpu(String::new())));
        assert_eq!("gpu:llvmpipe".parse(), Ok(ExecutorChoice::Gpu("llvmpipe".to_owned())));
        for typed in ["auto", "cpu", "gpu", "gpu:llvmpipe"] {
            assert_eq!(typed.parse().map(|choice: ExecutorChoice| choice.to_string()).as_deref(), Ok(typed));
        }
        assert!("cuda".parse::<ExecutorChoice>().is_err());
        assert!("cpu:0".parse::<ExecutorChoice>().is_err());
    }
}
