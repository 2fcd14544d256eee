//! Choice of an executor at run time.

use crate::SceneError;
use core::{fmt, str::FromStr};
use specula_core::{
    cutoffs::{BlendOrder, ProjectionModel},
    pack::Storage,
};
#[cfg(feature = "gpu")]
use specula_gpu::{AdapterPlace, AdapterReport, Gpu, adapters};

/// Requested executor: `auto`, `cpu`, `gpu` or `gpu:NAME` as text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ExecutorChoice {
    /// First GPU of real hardware, else the CPU.
    #[default]
    Auto,
    /// CPU.
    Cpu,
    /// First wgpu adapter with this in its name; any adapter if empty.
    Gpu(String),
    /// Adapter of one of several ranks of a machine.
    GpuOfRank {
        /// Part of its name; empty for any.
        name: String,
        /// Number of the rank among those of its machine, from 0.
        rank: usize,
    },
}

/// Text that is not an [`ExecutorChoice`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("use auto, cpu, gpu or gpu:NAME")]
pub struct InvalidExecutor;

impl FromStr for ExecutorChoice {
    type Err = InvalidExecutor;

    fn from_str(text: &str) -> Result<Self, InvalidExecutor> {
        match text.split_once(':').unwrap_or((text, "")) {
            ("auto", "") => Ok(Self::Auto),
            ("cpu", "") => Ok(Self::Cpu),
            ("gpu", name) => Ok(Self::Gpu(name.to_owned())),
            _ => Err(InvalidExecutor),
        }
    }
}

impl fmt::Display for ExecutorChoice {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => out.write_str("auto"),
            Self::Cpu => out.write_str("cpu"),
            Self::Gpu(name) | Self::GpuOfRank { name, .. } if name.is_empty() => out.write_str("gpu"),
            Self::Gpu(name) | Self::GpuOfRank { name, .. } => write!(out, "gpu:{name}"),
        }
    }
}

impl serde::Serialize for ExecutorChoice {
    fn serialize<S: serde::Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
        out.collect_str(self)
    }
}

impl ExecutorChoice {
    /// Opens the requested device. With [`ExecutorChoice::Auto`], a GPU that cannot be opened is
    /// logged and replaced by the CPU.
    ///
    /// # Errors
    ///
    /// No adapter of that name, an adapter that cannot be opened, or a build without the feature
    /// `gpu`.
    pub fn open(&self) -> Result<Device, SceneError> {
        match self {
            Self::Cpu => Ok(Device::Cpu),
            #[cfg(feature = "gpu")]
            Self::Gpu(name) => Ok(Device::Gpu(Box::new(Gpu::new(name)?), None)),
            #[cfg(feature = "gpu")]
            Self::GpuOfRank { name, rank } => {
                let (gpu, place) = Gpu::nth(name, *rank)?;
                Ok(Device::Gpu(Box::new(gpu), Some(place)))
            }
            #[cfg(feature = "gpu")]
            Self::Auto => Ok(default_device()),
            #[cfg(not(feature = "gpu"))]
            Self::Gpu(_) | Self::GpuOfRank { .. } => Err(SceneError::GpuUnsupported),
            #[cfg(not(feature = "gpu"))]
            Self::Auto => Ok(Device::Cpu),
        }
    }

    /// Choice of one of several ranks of a machine, by its number among them: each uses the next
    /// GPU, as long as there are more. All ranks of a machine choose either GPUs or the CPU.
    #[must_use]
    pub fn of_rank(&self, rank: usize) -> Self {
        match self {
            Self::Gpu(name) => Self::GpuOfRank { name: name.clone(), rank },
            Self::Auto if has_hardware() => Self::GpuOfRank { name: String::new(), rank },
            Self::Auto => Self::Cpu,
            Self::Cpu | Self::GpuOfRank { .. } => self.clone(),
        }
    }

    /// Opens and closes a requested GPU, so that its absence is an error before anything is loaded.
    ///
    /// # Errors
    ///
    /// Those of [`ExecutorChoice::open`].
    pub fn check(&self) -> Result<(), SceneError> {
        match self {
            Self::Gpu(_) | Self::GpuOfRank { .. } => self.open().map(drop),
            Self::Auto | Self::Cpu => Ok(()),
        }
    }
}

/// Device of an executor.
#[derive(Debug)]
#[non_exhaustive]
pub enum Device {
    /// CPU, on the threads of rayon's current pool.
    Cpu,
    /// Opened GPU; for a rank with its index among the GPUs of the machine.
    #[cfg(feature = "gpu")]
    Gpu(Box<Gpu>, Option<AdapterPlace>),
}

#[cfg(feature = "gpu")]
fn default_device() -> Device {
    if !may_have_hardware() {
        return Device::Cpu;
    }
    let adapters = adapters();
    let Some(report) = preferred_adapter(&adapters) else { return Device::Cpu };
    Gpu::new(&report.info.name).map_or_else(
        |error| {
            tracing::warn!("{error}; the CPU takes over");
            Device::Cpu
        },
        |gpu| Device::Gpu(Box::new(gpu), None),
    )
}

/// True if there is a GPU that [`ExecutorChoice::Auto`] would choose.
fn has_hardware() -> bool {
    #[cfg(feature = "gpu")]
    return may_have_hardware() && preferred_adapter(&adapters()).is_some();
    #[cfg(not(feature = "gpu"))]
    return false;
}

/// True if there are device files of GPUs on Linux. Without them drivers are not queried, which
/// takes time and makes some of them print warnings.
#[cfg(feature = "gpu")]
fn may_have_hardware() -> bool {
    const DEVICES: [&str; 3] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg"];
    !cfg!(target_os = "linux") || DEVICES.iter().any(|device| std::path::Path::new(device).exists())
}

/// Adapter of [`ExecutorChoice::Auto`]: the first of real hardware. Software drivers are slower
/// than the CPU executor.
#[cfg(feature = "gpu")]
pub fn preferred_adapter(adapters: &[AdapterReport]) -> Option<&AdapterReport> {
    adapters.iter().find(|adapter| !adapter.is_software)
}

/// Executor of renderings, its numbers in memory, its projection, and its order of splats.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOptions {
    /// Executor.
    pub executor: ExecutorChoice,
    /// Precision of Gaussians and of filtered light in memory.
    pub storage: Storage,
    /// Projection of Gaussians; only the CPU supports models other than the affine one.
    pub projection: ProjectionModel,
    /// Order of splats in a pixel.
    pub order: BlendOrder,
}

impl Default for RenderOptions {
    /// Options of [`RenderOptions::full_precision`] with [`ExecutorChoice::Auto`].
    fn default() -> Self {
        Self::full_precision(ExecutorChoice::Auto)
    }
}

impl RenderOptions {
    /// Executor with 32-bit numbers, and the affine projection and the order of training.
    pub const fn full_precision(executor: ExecutorChoice) -> Self {
        Self { executor, storage: Storage::F32, projection: ProjectionModel::Affine, order: BlendOrder::Mean }
    }

    /// Opens the device of the executor; the CPU for projection models that only it supports.
    pub(crate) fn open(&self) -> Result<Device, SceneError> {
        match (&self.executor, self.projection) {
            (executor, ProjectionModel::Affine) => executor.open(),
            (ExecutorChoice::Gpu(_) | ExecutorChoice::GpuOfRank { .. }, _) => Err(SceneError::ProjectionUnsupported),
            _ => Ok(Device::Cpu),
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
        for (of_rank, text) in [("gpu", "gpu"), ("gpu:llvmpipe", "gpu:llvmpipe"), ("cpu", "cpu")] {
            let choice: ExecutorChoice = of_rank.parse().expect("an executor");
            assert_eq!(choice.of_rank(2).to_string(), text);
        }
        let second = ExecutorChoice::Gpu("A".into()).of_rank(1);
        assert_eq!(second, ExecutorChoice::GpuOfRank { name: "A".into(), rank: 1 });
        assert!("cuda".parse::<ExecutorChoice>().is_err());
        assert!("cpu:0".parse::<ExecutorChoice>().is_err());
    }
}
