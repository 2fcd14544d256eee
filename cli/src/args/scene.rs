//! Arguments that commands share: profile, orientation, executor, environment map.

use super::parse::{executor, finite, order, projection};
use clap::{Args, ValueEnum};
use serde::Serialize;
use specula_core::{
    antialias::LowPass,
    cutoffs::{BlendOrder, ProjectionModel},
    pack::Storage,
};
use specula_io::latlong::UpAxis;
use specula_scene::{
    ExecutorChoice, RenderOptions, Shading,
    crop::Crop,
    light_file::{LightOptions, MapUp},
    orientation::UpDirection,
};

/// Interpretation of a scene, and its executor.
#[derive(Args, Clone, Debug)]
pub(crate) struct SceneOptions {
    /// Profile that the attributes are read with, if the scene names none or a wrong one.
    #[arg(long, value_enum)]
    pub(crate) profile: Option<ProfileName>,
    #[command(flatten)]
    pub(crate) antialiased: AntialiasedOption,
    /// Up direction of the scene, instead of that of the model: an axis such as z or -y, or a
    /// vector.
    #[arg(long, value_name = "AXIS|X,Y,Z", allow_hyphen_values = true)]
    pub(crate) scene_up: Option<UpDirection>,
    /// Only what is in a ball, without the room around it: auto, within half the distance of the
    /// cameras; object, without the table below it as well; another fraction of that distance; or
    /// the ball X,Y,Z,RADIUS.
    #[arg(long, value_name = "auto|object|SHARE|X,Y,Z,R", allow_hyphen_values = true)]
    pub(crate) crop: Option<Crop>,
    #[command(flatten)]
    pub(crate) renderer: RendererOptions,
}

/// Light of a model that was trained under several.
#[derive(Args, Clone, Debug)]
pub(crate) struct OwnLightOption {
    /// Light of a model that was trained under several: its name, or its number from 1 [default:
    /// that of each view of the data set, the first for others].
    #[arg(long = "light", value_name = "NAME|N")]
    pub(crate) light: Option<String>,
}

/// Low-pass filter for files that do not name one.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct AntialiasedOption {
    /// Compensated low-pass of a PLY file that does not say so: 0.3 px² (gsplat, the default; also
    /// INRIA's --antialiasing) or 0.1 px² (mip, a fused file of Mip-Splatting).
    #[arg(long, value_enum, value_name = "gsplat|mip", num_args = 0..=1, require_equals = true, default_missing_value = "gsplat", hide_possible_values = true)]
    pub(crate) antialiased: Option<AntialiasedName>,
}

impl AntialiasedOption {
    /// The low-pass, if the option is given.
    pub(crate) fn low_pass(self) -> Option<LowPass> {
        self.antialiased.map(|name| match name {
            AntialiasedName::Gsplat => LowPass::Compensated,
            AntialiasedName::Mip => LowPass::Mip,
        })
    }
}

/// Trainers with a compensated low-pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum AntialiasedName {
    /// 0.3 px².
    Gsplat,
    /// 0.1 px².
    Mip,
}

/// Executor of renderings.
#[derive(Args, Clone, Debug)]
pub(crate) struct RendererOptions {
    /// Executor: a GPU if there is one (auto), the CPU, or the GPU with NAME in its name; specula
    /// doctor lists them.
    #[arg(long, value_name = "auto|cpu|gpu[:NAME]", default_value = "auto", value_parser = executor)]
    pub(crate) executor: ExecutorChoice,
    /// Precision of Gaussians and light in memory; f16 takes about half the memory of f32 (see
    /// docs/performance.md).
    #[arg(long, value_enum, value_name = "f32|f16", default_value_t = StorageName::F32)]
    pub(crate) storage: StorageName,
    /// Projection of Gaussians: affine, as in training; exact (ray, tangent; CPU only); or exact
    /// where the error of affine exceeds ALPHA (see docs/accuracy.md).
    #[arg(long, value_name = "affine|tangent|ray|ALPHA", default_value = "affine", value_parser = projection)]
    pub(crate) projection: ProjectionModel,
    /// Order in which splats are blended: by the depth of their means, as in training; by the depth
    /// of their largest response along the ray of each pixel, exactly (pixel) or among N successive
    /// splats (window, 16 by default); see docs/rendering.md.
    #[arg(long, value_name = "mean|window[:N]|pixel", default_value = "mean", value_parser = order)]
    pub(crate) order: BlendOrder,
}

impl RendererOptions {
    /// Precision of numbers in memory.
    pub(crate) fn storage(&self) -> Storage {
        match self.storage {
            StorageName::F32 => Storage::F32,
            StorageName::F16 => Storage::F16,
        }
    }
}

/// Colours of a relightable model.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct ShadingOption {
    /// Colours of a model with materials: view, view-dependent and valid under the light of the
    /// training; or physical, materials that are valid under any light [default: view under the
    /// light of the training, physical under others].
    #[arg(long = "shading", value_enum, value_name = "view|physical", hide_possible_values = true)]
    pub(crate) name: Option<ShadingName>,
}

impl ShadingOption {
    /// The shading, if the option is given.
    pub(crate) fn shading(self) -> Option<Shading> {
        self.name.map(|name| match name {
            ShadingName::View => Shading::View,
            ShadingName::Physical => Shading::Physical,
        })
    }
}

/// Shadings of a relightable model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ShadingName {
    /// View-dependent colours.
    View,
    /// Physical materials.
    Physical,
}

/// Interpretation of an environment map.
#[derive(Args, Clone, Debug)]
pub(crate) struct EnvOptions {
    /// Up direction of the file: that of the scene, z as in Blender, or y as in GaussianShader's
    /// files.
    #[arg(long, value_enum, default_value_t = EnvUp::Scene)]
    pub(crate) env_up: EnvUp,
    /// Exposure of the light in stops; 1 doubles it.
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite)]
    pub(crate) exposure: f32,
}

/// Names of the profiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ProfileName {
    /// Best measured quality.
    Specula,
    /// Equations and weights of the paper.
    Paper,
    /// Behaviour of the authors' code.
    Official,
    /// Plain Gaussian splatting.
    #[value(name = "3dgs")]
    #[serde(rename = "3dgs")]
    Plain,
}

impl ProfileName {
    /// Name on the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Specula => "specula",
            Self::Paper => "paper",
            Self::Official => "official",
            Self::Plain => "3dgs",
        }
    }
}

/// Precision of numbers in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum StorageName {
    /// 32 bits.
    F32,
    /// 16 bits.
    F16,
}

/// Up direction of an environment map that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EnvUp {
    /// Up direction of the scene.
    Scene,
    /// +Y, as in GaussianShader and nvdiffrec.
    Y,
    /// +Z, as in Blender.
    Z,
}

impl From<EnvUp> for MapUp {
    fn from(up: EnvUp) -> Self {
        match up {
            EnvUp::Scene => Self::Scene,
            EnvUp::Y => Self::Y,
            EnvUp::Z => Self::Z,
        }
    }
}

impl From<&EnvOptions> for LightOptions {
    fn from(options: &EnvOptions) -> Self {
        Self { up: options.env_up.into(), exposure: options.exposure }
    }
}

/// Up axis of an environment map that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    /// +Y, as in GaussianShader and nvdiffrec.
    Y,
    /// +Z, as in Blender.
    Z,
}

impl Up {
    /// Axis.
    pub(crate) fn axis(self) -> UpAxis {
        match self {
            Self::Y => UpAxis::Y,
            Self::Z => UpAxis::Z,
        }
    }
}

impl From<&RendererOptions> for RenderOptions {
    fn from(options: &RendererOptions) -> Self {
        Self {
            executor: options.executor.clone(),
            storage: options.storage(),
            projection: options.projection,
            order: options.order,
        }
    }
}
