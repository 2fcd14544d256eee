//! `specula prefilter`: prefilters an environment map for every roughness, as a cube map.

use crate::{
    args::{MipName, Prefilter, SchemeName},
    failure::Failure,
    output,
    scene::read_env,
};
use specula_core::{
    prefilter::{Levels, MipRoughness},
    scene::Environment,
};
use specula_io::{Error, budget, model_folder, within};
use specula_scene::{
    prefiltered::{CubeFormat, LevelChain, PrefilteredLight, at_resolution, light_of_map, light_of_model},
    text::shown,
};
use std::path::{Path, PathBuf};

/// Prefilters a light and writes it.
pub(crate) fn run(args: &Prefilter) -> Result<(), Failure> {
    format_of(&args.output)?;
    refuse_to_replace(&description_beside(&args.output))?;
    filter(args, &open(args)?)
}

/// Prefilters and writes an oriented light.
pub(crate) fn write(args: &Prefilter, light: &Environment<Vec<f32>>) -> Result<(), Failure> {
    filter(args, &at_resolution(light, args.resolution, args.chain()))
}

fn filter(args: &Prefilter, light: &Environment<Vec<f32>>) -> Result<(), Failure> {
    let format = format_of(&args.output)?;
    let levels = levels(args, light.resolution)?;
    output::make_folder(output::folder_of(&args.output))?;
    let filtered = PrefilteredLight::new(light, args.chain(), levels, args.up.axis())?;
    filtered.write(&args.output, format)?;
    let description = filtered.description(&args.output, format, &output::absolute(&args.env), args.exposure);
    output::write_json(&description_beside(&args.output), &description)?;
    if args.previews {
        filtered.write_previews(&args.output)?;
    }
    output::say(&shown(&args.output))
}

/// Path of the description of a prefiltered light.
pub(crate) fn description_beside(path: &Path) -> PathBuf {
    path.with_extension("json")
}

/// Refuses to overwrite a file that is not a description.
pub(crate) fn refuse_to_replace(path: &Path) -> Result<(), Failure> {
    if !within::holds(path)? {
        return Ok(());
    }
    let found: serde_json::Value = serde_json::from_slice(&budget::FACTS.read(path)?).unwrap_or_default();
    match ["level_of_roughness", "lobe"].iter().all(|key| found.get(key).is_some()) {
        true => Ok(()),
        false => Err(Failure::Input(format!(
            "the description of the light would replace {path:?}, which is another file; use another name with -o"
        ))),
    }
}

fn format_of(path: &Path) -> Result<CubeFormat, Failure> {
    let unknown = || Error::Ending { path: path.to_owned(), expected: ".ktx2 or .exr" };
    Ok(output::ending(path).as_deref().and_then(CubeFormat::from_extension).ok_or_else(unknown)?)
}

/// Light of a file or of a model, at the resolution of the first level.
fn open(args: &Prefilter) -> Result<Environment<Vec<f32>>, Failure> {
    if !args.env.is_dir() {
        return Ok(light_of_map(&read_env(&args.env, args.exposure)?, args.resolution, args.up.axis()));
    }
    let light = model_folder::open(&args.env)?.light.ok_or_else(|| {
        Failure::Input(format!(
            "the model in {:?} is plain Gaussian splatting and has no light; use a .hdr or .exr file, or a model of \
             --profile specula",
            args.env
        ))
    })?;
    let light = light_of_model(&light, args.exposure, args.up.axis());
    budget::radiance(&args.env, &light.values)?;
    Ok(at_resolution(&light, args.resolution, args.chain()))
}

/// Requested levels.
fn levels(args: &Prefilter, resolution: usize) -> Result<Levels, Failure> {
    let chain = args.chain();
    let (scheme, least) = (chain.name(), chain.resolution_min());
    if resolution < least {
        return Err(Failure::Input(format!(
            "--scheme {scheme} needs a resolution of at least {least}, not {resolution}; use --resolution {least}, or \
             --scheme specula"
        )));
    }
    if args.scheme != SchemeName::Specula && (args.levels, args.roughness) != (None, None) {
        return Err(Failure::Input(format!(
            "--scheme {scheme} has its own levels; omit --levels and --roughness, or use --scheme specula"
        )));
    }
    chain.levels(resolution).ok_or_else(|| {
        Failure::Input(format!(
            "a light of resolution {resolution} cannot have {} levels; use --levels with 2 to {}",
            chain.count(resolution),
            LevelChain::count_max(resolution)
        ))
    })
}

impl Prefilter {
    /// Requested chain of levels.
    fn chain(&self) -> LevelChain {
        let roughness = match self.roughness {
            None | Some(MipName::Linear) => MipRoughness::Linear,
            Some(MipName::Filament) => MipRoughness::Filament,
        };
        match self.scheme {
            SchemeName::Specula => LevelChain::Mips { roughness, count: self.levels },
            SchemeName::Paper => LevelChain::Paper,
            SchemeName::Official => LevelChain::Official,
        }
    }
}
