//! Arguments of every command that opens a scene: profile, orientation, executor, light.

use super::parse::{executor, finite, projection};
use crate::orientation::UpChoice;
use clap::{Args, ValueEnum};
use glam::Vec3;
use serde::Serialize;
use specula_core::{cutoffs::ProjectionModel, pack::Storage};
use specula_io::latlong::{Stand, UpAxis};
use specula_scene::ExecutorChoice;

/// Reading and showing a scene.
#[derive(Args, Debug)]
pub(crate) struct Showing {
    /// Profile to read the attributes by, where the scene names none or a wrong one.
    #[arg(long, value_enum)]
    pub(crate) profile: Option<ProfileName>,
    /// The scene's up direction, instead of the model's: an axis such as z or -y, or a vector.
    #[arg(long, value_name = "AXIS|X,Y,Z", allow_hyphen_values = true)]
    pub(crate) scene_up: Option<UpChoice>,
    #[command(flatten)]
    pub(crate) machine: MachineOptions,
}

/// The executor of renderings.
#[derive(Args, Clone, Debug)]
pub(crate) struct MachineOptions {
    /// A GPU if there is one (auto), the CPU, or the GPU with NAME in its name; specula doctor lists them.
    #[arg(long, value_name = "auto|cpu|gpu[:NAME]", default_value = "auto", value_parser = executor)]
    pub(crate) executor: ExecutorChoice,
    /// Numbers of Gaussians and light in memory: f16 takes about half of f32 (docs/performance.md).
    #[arg(long, value_enum, value_name = "f32|f16", default_value_t = StorageName::F32)]
    pub(crate) storage: StorageName,
    /// ProjectionModel of Gaussians: affine as in training, exact (ray, tangent; on the CPU), or exact where affine is off by
    /// more than ALPHA (docs/accuracy.md).
    #[arg(long, value_name = "affine|tangent|ray|ALPHA", default_value = "affine", value_parser = projection)]
    pub(crate) projection: ProjectionModel,
}

impl MachineOptions {
    /// An executor with its numbers in full.
    pub(crate) fn in_full(executor: &ExecutorChoice) -> Self {
        Self { executor: executor.clone(), storage: StorageName::F32, projection: ProjectionModel::Affine }
    }
    /// How it stores numbers.
    pub(crate) fn storage(&self) -> Storage {
        match self.storage {
            StorageName::F32 => Storage::F32,
            StorageName::F16 => Storage::F16,
        }
    }
}

/// Reading a file of light.
#[derive(Args, Debug)]
pub(crate) struct EnvOptions {
    /// Direction of the file's upper edge: the scene's up, Blender's z, or y as in GaussianShader's files.
    #[arg(long, value_enum, default_value_t = EnvUp::Scene)]
    pub(crate) env_up: EnvUp,
    /// Brightness of the light, in stops: 1 doubles it.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(crate) exposure: f32,
}

/// Kinds of training, and of reading what was trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ProfileName {
    /// Whatever measures best.
    Specula,
    /// The paper to the letter.
    Paper,
    /// What the authors' code does.
    Official,
    /// Plain Gaussian splatting.
    #[value(name = "3dgs")]
    #[serde(rename = "3dgs")]
    Plain,
}

impl ProfileName {
    /// The name, as typed.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Specula => "specula",
            Self::Paper => "paper",
            Self::Official => "official",
            Self::Plain => "3dgs",
        }
    }
}

/// How numbers are stored where a scene is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum StorageName {
    /// In full.
    F32,
    /// As halves, two to a word.
    F16,
}

/// What a file of light has above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EnvUp {
    /// What is above in the scene.
    Scene,
    /// The axis of GaussianShader and nvdiffrec.
    Y,
    /// Blender's axis.
    Z,
}

impl EnvUp {
    /// How the file stands in a scene that has this above.
    pub(crate) fn stand(self, above: Vec3) -> Stand {
        match self {
            Self::Scene => Stand::above(above.as_dvec3().to_array()),
            Self::Y => Up::Y.stand(),
            Self::Z => Up::Z.stand(),
        }
    }
}

/// Which axis a file of light has above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    /// That of GaussianShader and nvdiffrec.
    Y,
    /// Blender's.
    Z,
}

impl Up {
    /// What a file with this has above.
    pub(crate) fn axis(self) -> UpAxis {
        match self {
            Self::Y => UpAxis::Y,
            Self::Z => UpAxis::Z,
        }
    }

    /// How a file with this above stands in a world.
    pub(crate) fn stand(self) -> Stand {
        self.axis().into()
    }
}
