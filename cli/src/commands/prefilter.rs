//! `specula prefilter`: prefilters an environment map for every roughness, as a cube map.

use crate::{
    args::{MipName, Prefilter, SchemeName, Up},
    commands::relight::write_preview,
    failure::Failure,
    output,
    scene::read_env,
};
use serde_json::{Value, json};
use specula_core::{
    prefilter::{Level, Levels, MAX_LEVELS, MipRoughness, PrefilterScheme},
    scene::{Environment, RadianceActivation},
};
use specula_cpu::{CpuExecutor, stages::prefilter::Light};
use specula_io::{
    Error,
    ktx::{self, CubeLevel},
    latlong, model_folder,
};
use specula_scene::environment::{RESOLUTION_SLOW, radiance, resampled};
use std::path::{Path, PathBuf};

/// Default face resolution for lat-long maps, as in Filament's tools.
const RESOLUTION: usize = 256;
/// Resolution of the last level. The resulting number of levels comes closest to the integral,
/// although the roughest levels have few texels (docs/performance.md, The prefilter).
const COARSEST: usize = 4;

/// Prefilters a light and writes it.
pub(crate) fn run(args: &Prefilter) -> Result<(), Failure> {
    Container::of(&args.output)?;
    filter(args, &open(args)?)
}

/// Prefilters and writes a light that is oriented already.
pub(crate) fn write(args: &Prefilter, light: &Environment<Vec<f32>>) -> Result<(), Failure> {
    filter(args, &at_resolution(args, light))
}

fn filter(args: &Prefilter, light: &Environment<Vec<f32>>) -> Result<(), Failure> {
    let container = Container::of(&args.output)?;
    let levels = levels(args, light.resolution)?;
    let folder = args.output.parent().filter(|folder| !folder.as_os_str().is_empty());
    output::make_folder(folder.unwrap_or(Path::new(".")))?;
    if light.resolution > RESOLUTION_SLOW {
        tracing::info!("filtering six times {0} × {0} texels; this takes a while", light.resolution);
    }
    let filtered = CpuExecutor::new().prefilter_into(light, args.scheme.weights(), levels)?;
    let levels = levels.as_slice();
    let faces = faces_of(&filtered, levels);

    container.write(&args.output, levels, &faces)?;
    output::write_json(&args.output.with_extension("json"), &description(args, container, levels))?;
    if args.previews {
        for (level, CubeLevel { resolution, rgb }) in faces.iter().enumerate() {
            write_preview(&beside(&args.output, level, "png"), rgb, *resolution, args.up.stand())?;
        }
    }
    output::say(&args.output.display().to_string())
}

/// Format of the levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Container {
    /// One file with all levels in 16-bit floats.
    Ktx2,
    /// One file per level in 32-bit floats.
    Exr,
}

impl Container {
    fn of(path: &Path) -> Result<Self, Failure> {
        match output::ending(path).as_deref() {
            Some("ktx2") => Ok(Self::Ktx2),
            Some("exr") => Ok(Self::Exr),
            _ => Err(Error::Ending { path: path.to_owned(), expected: ".ktx2 or .exr" }.into()),
        }
    }

    fn write(self, path: &Path, levels: &[Level], faces: &[CubeLevel]) -> Result<(), Failure> {
        match self {
            Self::Ktx2 => {
                let roughness: Vec<String> = levels.iter().map(|level| level.roughness.to_string()).collect();
                Ok(ktx::write_cube(path, faces, &[("roughness", &roughness.join(" "))])?)
            }
            Self::Exr => faces.iter().enumerate().try_for_each(|(level, CubeLevel { resolution, rgb })| {
                Ok(latlong::write_cube_exr(&beside(path, level, "exr"), rgb, *resolution)?)
            }),
        }
    }

    /// Names of the files, and their format.
    fn words(self, path: &Path, count: usize) -> [Value; 2] {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match self {
            Self::Ktx2 => [json!([name(path)]), json!("R16G16B16A16_SFLOAT, a mip level for each level")],
            Self::Exr => {
                let names: Vec<String> = (0..count).map(|level| name(&beside(path, level, "exr"))).collect();
                [json!(names), json!("32-bit RGB, a file for each level, six faces in a column")]
            }
        }
    }
}

/// Path of a level's file: `sky.level0.png` for `sky.ktx2`.
fn beside(path: &Path, level: usize, ending: &str) -> PathBuf {
    path.with_extension(format!("level{level}.{ending}"))
}

/// Light of a file or of a model, at the resolution of the first level.
fn open(args: &Prefilter) -> Result<Environment<Vec<f32>>, Failure> {
    let activation = RadianceActivation::Identity;
    if !args.env.is_dir() {
        let map = read_env(&args.env, args.exposure)?;
        let resolution = args.resolution.unwrap_or(RESOLUTION);
        return Ok(Environment { resolution, activation, values: latlong::to_cube(&map, resolution, args.up.stand()) });
    }
    let light = model_folder::open(&args.env)?.light.ok_or_else(|| {
        Failure::Input(format!(
            "the model in {:?} has no light, as it is plain Gaussian splatting; name a .hdr or .exr file, or a model of \
             --profile specula",
            args.env
        ))
    })?;
    let mut values = radiance(light.activation, &light.values);
    values.iter_mut().for_each(|number| *number *= args.exposure.exp2());
    if args.up == Up::Y {
        values = latlong::y_up_from_z_up(&values, light.resolution);
    }
    Ok(at_resolution(args, &Environment { resolution: light.resolution, activation, values }))
}

/// Light at the requested resolution, by default its own rounded up to a valid one.
fn at_resolution(args: &Prefilter, light: &Environment<Vec<f32>>) -> Environment<Vec<f32>> {
    resampled(light, args.resolution.unwrap_or(light.resolution.next_power_of_two().max(args.scheme.least())))
}

/// Requested levels.
fn levels(args: &Prefilter, resolution: usize) -> Result<Levels, Failure> {
    let (scheme, least) = (args.scheme.name(), args.scheme.least());
    if resolution < least {
        return Err(Failure::Input(format!(
            "--scheme {scheme} begins at a resolution of {least}, and this is {resolution}; use --resolution {least}, or \
             --scheme specula"
        )));
    }
    if args.scheme != SchemeName::Specula {
        return match (args.levels, args.roughness) {
            (None, None) => Ok(Levels::new(PrefilterScheme::Official, resolution)),
            _ => Err(Failure::Input(format!(
                "--scheme {scheme} has its own levels; omit --levels and --roughness, or use --scheme specula"
            ))),
        };
    }
    let most = (resolution.ilog2() as usize + 1).min(MAX_LEVELS);
    let usual = (resolution / COARSEST).ilog2() as usize + 1;
    let count = args.levels.unwrap_or(usual.min(most));
    Levels::mips(args.mips().into(), resolution, count).ok_or_else(|| {
        Failure::Input(format!(
            "a light of resolution {resolution} has no chain of {count} levels; use --levels with 2 to {most}"
        ))
    })
}

fn faces_of(light: &Light, levels: &[Level]) -> Vec<CubeLevel> {
    let faces = |(number, level): (usize, &Level)| CubeLevel { resolution: level.resolution, rgb: light.faces(number) };
    levels.iter().enumerate().map(faces).collect()
}

/// Description of the files for programs that sample them.
fn description(args: &Prefilter, container: Container, levels: &[Level]) -> Value {
    let [files, format] = container.words(&args.output, levels.len());
    let level = |(number, level): (usize, &Level)| {
        let alpha_ggx = level.roughness * level.roughness;
        json!({"level": number, "resolution": level.resolution, "roughness": level.roughness, "alpha_ggx": alpha_ggx})
    };
    let last = levels.len() - 1;
    let level_of_roughness = match (args.scheme, args.mips()) {
        (SchemeName::Specula, MipName::Linear) => format!("{last} ρ"),
        (SchemeName::Specula, MipName::Filament) => format!("{last} ρ (2 − ρ)"),
        _ => "linear between the levels, the first below its roughness".to_owned(),
    };
    json!({
        "environment": output::absolute(&args.env),
        "exposure": args.exposure,
        "scheme": args.scheme.name(),
        "files": files,
        "format": format,
        "faces": ["+X", "-X", "+Y", "-Y", "+Z", "-Z"],
        "orientation": "columns to the right, rows down, seen from inside as Vulkan, Direct3D, WebGPU and OpenGL look \
                        cube maps up: a lookup of (x, y, z) gives the light that comes from there",
        "up": match args.up {
            Up::Y => "+y; the middle of a lat-long map lies at −z",
            Up::Z => "+z; the middle of a lat-long map lies at +x",
        },
        "levels": levels.iter().enumerate().map(level).collect::<Vec<_>>(),
        "level_of_roughness": level_of_roughness,
        "lobe": "GGX around the reflected direction r, for n = v = r: ∫ L(ω) D(h·r) (ω·r)₊ dω / ∫ D(h·r) (ω·r)₊ dω, \
                 alpha_ggx = ρ²; it has no Fresnel or shadowing term",
        "split_sum": "specular = level(r, ρ) (F0 A(n·v, ρ) + B(n·v, ρ)); A and B as Karis 2013 has them, with \
                      height-correlated Smith shadowing and Schlick's Fresnel, not stored here",
    })
}

impl Prefilter {
    /// Roughness of the levels of a mip chain.
    fn mips(&self) -> MipName {
        self.roughness.unwrap_or(MipName::Linear)
    }
}

impl SchemeName {
    /// Weights of texels.
    fn weights(self) -> PrefilterScheme {
        match self {
            Self::Specula | Self::Paper => PrefilterScheme::Exact,
            Self::Official => PrefilterScheme::Official,
        }
    }
    /// Minimum resolution of the first level.
    fn least(self) -> usize {
        match self {
            Self::Specula => PrefilterScheme::Exact.resolution_min(),
            Self::Paper | Self::Official => PrefilterScheme::Official.resolution_min(),
        }
    }
    /// Name on the command line.
    fn name(self) -> &'static str {
        match self {
            Self::Specula => "specula",
            Self::Paper => "paper",
            Self::Official => "official",
        }
    }
}

impl From<MipName> for MipRoughness {
    fn from(name: MipName) -> Self {
        match name {
            MipName::Linear => Self::Linear,
            MipName::Filament => Self::Filament,
        }
    }
}
