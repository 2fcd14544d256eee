//! Trained model with its measures and conditions, read from the files of its folder.

use crate::{
    error::{Error, Result},
    evaluation::RELIT,
    light,
    measure::{MEASURES, PSNR, Values},
};
use serde::{Deserialize, Deserializer, de::DeserializeOwned};
use serde_json::{Map, Value};
use specula_io::{
    budget::FACTS,
    cameras::{self, NamedCamera},
    model_folder, within,
};
use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
};

/// Bytes per megabyte.
const MEGABYTE: f64 = 1e6;
/// Maximum number of lines of a PLY header.
const HEADER_LINES_MAX: usize = 1000;
/// Maximum number of bytes of a PLY header.
const HEADER_LEN_MAX: u64 = 1 << 20;

/// Condition of a training that must be equal in a fair comparison.
#[derive(Clone, Copy, Debug)]
pub(super) struct Condition {
    /// Head of its column.
    pub(super) label: &'static str,
    /// Phrase that follows "trained" in a sentence.
    pub(super) phrase: fn(usize) -> String,
}

/// Conditions in the order of [`Run::conditions`].
pub(super) const CONDITIONS: [Condition; 3] = [
    Condition { label: "iterations", phrase: |count| format!("for {count} iterations") },
    Condition { label: "downscale", phrase: |factor| format!("at downscale {factor}") },
    Condition { label: "training views", phrase: |count| format!("on {count} pictures") },
];

/// Trained model and its quality.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) folder: PathBuf,
    /// Last component of the data set's path.
    pub(super) scene: String,
    /// Path of the data set; empty if unknown.
    pub(super) source: String,
    /// Value of each of [`CONDITIONS`].
    pub(super) conditions: [Option<f64>; CONDITIONS.len()],
    /// Profile, or the name of the folder if another program trained the model.
    pub(super) profile: String,
    pub(super) measured: Values,
    /// Whether the model can be relit.
    pub(super) is_shaded: bool,
    /// Whether it has physical materials.
    pub(super) is_physical: bool,
    /// Relighting PSNR in dB by each of [`RELIT`].
    pub(super) relit: [Option<f64>; RELIT.len()],
    pub(super) light_correlation: Option<f64>,
    pub(super) light_scale: Option<f64>,
    pub(super) gaussians: Option<f64>,
    /// Time of the training.
    pub(super) seconds: Option<f64>,
    /// Size of the files of Gaussians and light.
    pub(super) megabytes: Option<f64>,
    /// Newest iteration, if the measures belong to an earlier one.
    pub(super) unmeasured: Option<u32>,
    /// Entries of `config.toml`.
    pub(super) settings: toml::Table,
    /// Network that measured LPIPS, if known.
    pub(super) lpips_network: Option<String>,
    /// Views of the measurement; none if unknown.
    pub(super) views: Vec<NamedCamera>,
    /// True if it was measured on training views.
    pub(super) held_nothing_out: bool,
    pub(super) background: Option<[f64; 3]>,
}

impl Run {
    /// Reads the folder of a model.
    ///
    /// # Errors
    ///
    /// A folder without a model, or a file that cannot be parsed.
    pub(super) fn read(folder: &Path) -> Result<Self> {
        let latest = model_folder::latest_iteration(folder).ok();
        let mut results: Methods<Results> = read_json(&folder.join("results.json"))?;
        let measured_at = results.keys().filter_map(|method| method.strip_prefix("ours_")?.parse::<u32>().ok()).max();
        let Some(iteration) = measured_at.or(latest) else {
            return Err(Error::Input(format!("{folder:?} has no model; give folders of specula train")));
        };
        let method = model_folder::method_of(iteration);
        let results = results.remove(&method).and_then(|Lenient(results)| results).unwrap_or_default();
        let mut per_view: Methods<Methods<Map<String, Value>>> = read_json(&folder.join("per_view.json"))?;
        let per_view = per_view.remove(&method).and_then(|Lenient(measures)| measures).unwrap_or_default();
        let view_count = per_view.get(MEASURES[PSNR].name).and_then(|Lenient(views)| Some(views.as_ref()?.len()));

        let info = model_folder::read_info(folder)?;
        let facts = info.as_ref().map(|info| Value::Object(info.rest.clone()));
        let facts = facts.and_then(|facts| Facts::deserialize(facts).ok()).unwrap_or_default();
        let mut timeline: Methods<TimelineEntry> = read_json(&folder.join("timeline.json"))?;
        let so_far = timeline.remove(&method).and_then(|Lenient(entry)| entry?.seconds.0);
        let in_total = info.as_ref().filter(|info| info.iterations == iteration).and(facts.seconds.0);
        let source = match &info {
            Some(info) => info.source_path.clone(),
            None => source_in_cfg_args(folder)?.unwrap_or_default(),
        };
        let downscale = info.as_ref().map(|info| f64::from(info.downscale.max(1)));
        let settings = settings_of(folder)?;
        let number = |name: &str| results.numbers.get(name)?.0;
        let held_nothing_out = measured_at.is_some() && facts.test_views.0 == Some(0.0);
        // Test views come first among the cameras of a model, if it has any.
        let known_views = if held_nothing_out { 0 } else { view_count.unwrap_or(0) };
        Ok(Self {
            folder: folder.to_owned(),
            scene: scene_of(Path::new(&source)).unwrap_or_else(|| "scene".into()),
            source,
            conditions: [Some(iteration.into()), downscale, facts.train_views.0],
            profile: info
                .as_ref()
                .map_or_else(|| last_component(folder).unwrap_or_default(), |info| info.profile.clone()),
            measured: MEASURES.map(|measure| number(measure.name)),
            is_shaded: info.as_ref().is_some_and(|info| info.shading != "radiance"),
            is_physical: facts.materials.0 == Some(true)
                || settings.get("relightable").and_then(toml::Value::as_bool).unwrap_or(false),
            relit: RELIT.map(|protocol| number(protocol.name)),
            light_correlation: number(light::CORRELATION),
            light_scale: number(light::SCALE),
            gaussians: count_in(&model_folder::gaussians_at(folder, iteration)).or(facts.gaussians.0),
            seconds: so_far.or(in_total),
            megabytes: megabytes_of(folder, iteration),
            unmeasured: latest.filter(|latest| measured_at.is_some_and(|measured| measured < *latest)),
            settings,
            lpips_network: results.lpips_network.0,
            views: first_views(folder, known_views)?,
            held_nothing_out,
            background: facts.background.0,
        })
    }
}

/// Value in a JSON file; `None` if it is missing or has another type, as in files of other
/// programs.
#[derive(Debug)]
struct Lenient<T>(Option<T>);

impl<T> Default for Lenient<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<'de, T: DeserializeOwned> Deserialize<'de> for Lenient<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> core::result::Result<Self, D::Error> {
        Ok(Self(serde_json::from_value(Value::deserialize(from)?).ok()))
    }
}

/// JSON object with an entry for each method, such as `ours_7000`.
type Methods<T> = BTreeMap<String, Lenient<T>>;

/// Entry of `results.json`.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Results {
    #[serde(rename = "LPIPS_network")]
    lpips_network: Lenient<String>,
    /// Numbers by name.
    #[serde(flatten)]
    numbers: BTreeMap<String, Lenient<f64>>,
}

/// Entry of `timeline.json`.
#[derive(Deserialize)]
struct TimelineEntry {
    #[serde(default)]
    seconds: Lenient<f64>,
}

/// Facts of `specula.json` other than those of every model.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Facts {
    train_views: Lenient<f64>,
    test_views: Lenient<f64>,
    gaussians: Lenient<f64>,
    seconds: Lenient<f64>,
    materials: Lenient<bool>,
    background: Lenient<[f64; 3]>,
}

/// JSON object of a file; empty if there is no file.
fn read_json<T: DeserializeOwned + Default>(path: &Path) -> Result<T> {
    if !within::holds(path)? {
        return Ok(T::default());
    }
    let bytes = FACTS.read(path)?;
    serde_json::from_slice(&bytes).map_err(|error| Error::Input(format!("cannot understand {path:?}: {error}")))
}

/// The first cameras of a model.
fn first_views(folder: &Path, count: usize) -> Result<Vec<NamedCamera>> {
    let path = folder.join("cameras.json");
    let mut views = if within::holds(&path)? { cameras::read(&path)? } else { Vec::new() };
    views.truncate(count);
    Ok(views)
}

/// Settings of the run; empty if unknown.
fn settings_of(folder: &Path) -> Result<toml::Table> {
    let path = folder.join("config.toml");
    let text = if within::holds(&path)? { FACTS.read(&path)? } else { Vec::new() };
    toml::from_slice(&text).map_err(|error| Error::Input(format!("cannot understand {path:?}: {}", error.message())))
}

/// Data set of a run of INRIA's program, from `cfg_args`.
fn source_in_cfg_args(folder: &Path) -> Result<Option<String>> {
    let path = folder.join("cfg_args");
    let text = if within::holds(&path)? { FACTS.read(&path)? } else { Vec::new() };
    let text = String::from_utf8_lossy(&text);
    let source = text.split_once("source_path='").and_then(|(_, rest)| rest.split_once('\''));
    Ok(source.map(|(source, _)| source.to_owned()))
}

fn last_component(path: &Path) -> Option<String> {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    Some(path.file_name()?.to_string_lossy().into_owned())
}

/// Name of a data set: that of its folder, or of the one around a folder `data`.
fn scene_of(path: &Path) -> Option<String> {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let names = path.ancestors().filter_map(Path::file_name);
    names.map(|name| name.to_string_lossy().into_owned()).find(|name| name != "data")
}

/// Number of Gaussians of a PLY file, from its header.
fn count_in(path: &Path) -> Option<f64> {
    let file = within::open(path).ok()?.take(HEADER_LEN_MAX);
    let lines = BufReader::new(file).lines().take(HEADER_LINES_MAX);
    let mut header = lines.map_while(core::result::Result::ok).take_while(|line| line.trim() != "end_header");
    header.find_map(|line| line.strip_prefix("element vertex ")?.trim().parse().ok())
}

/// Megabytes of the Gaussians and of their light, if there is one.
fn megabytes_of(folder: &Path, iteration: u32) -> Option<f64> {
    let bytes = |path: PathBuf| fs::metadata(path).ok().map(|file| file.len() as f64);
    let light =
        bytes(model_folder::light_at(folder, iteration)).or_else(|| bytes(model_folder::hdr_at(folder, iteration)));
    let gaussians = bytes(model_folder::gaussians_at(folder, iteration))?;
    Some((gaussians + light.unwrap_or(0.0)) / MEGABYTE)
}
