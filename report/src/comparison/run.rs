//! Trained model with its measures and conditions, read from the files of its folder.

use crate::{
    error::{Error, Result},
    measure::{MEASURES, PSNR, Values},
};
use serde_json::{Map, Value};
use specula_io::{
    budget::FACTS,
    cameras::{self, NamedCamera},
    model_folder,
};
use std::{
    fs,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
};

/// Bytes per megabyte.
const MEGABYTE: f64 = 1e6;
/// Most lines of a PLY header.
const HEADER_LINES_MAX: usize = 1000;
/// Most bytes of a PLY header.
const HEADER_LEN_MAX: u64 = 1 << 20;

/// Condition of a training that has to be equal in a fair comparison.
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
    /// Relighting PSNR in dB, as rendered and after scaling.
    pub(super) relit: [Option<f64>; 2],
    pub(super) gaussians: Option<f64>,
    /// Time of the training.
    pub(super) seconds: Option<f64>,
    /// Size of the files of Gaussians and light.
    pub(super) megabytes: Option<f64>,
    /// Newest iteration, if the measures are of an earlier one.
    pub(super) unmeasured: Option<u32>,
    /// Entries of `config.toml`.
    pub(super) settings: toml::Table,
    /// Network that measured LPIPS, if known.
    pub(super) lpips_network: Option<String>,
    /// Views of the measurement; none if unknown.
    pub(super) views: Vec<NamedCamera>,
    pub(super) background: Option<[f64; 3]>,
}

impl Run {
    /// Reads the folder of a model.
    ///
    /// # Errors
    ///
    /// A folder without a model, or a file that cannot be understood.
    pub(super) fn read(folder: &Path) -> Result<Self> {
        let latest = model_folder::latest_iteration(folder).ok();
        let results = read_json(&folder.join("results.json"))?;
        let measured_at = results.keys().filter_map(|method| method.strip_prefix("ours_")?.parse::<u32>().ok()).max();
        let Some(iteration) = measured_at.or(latest) else {
            return Err(Error::Input(format!("{folder:?} holds no model; name folders that specula train wrote")));
        };
        let method = model_folder::method_of(iteration);
        let result = |name: &str| results.get(&method).and_then(|results| results.get(name));
        let number = |name: &str| result(name).and_then(Value::as_f64);
        let per_view = read_json(&folder.join("per_view.json"))?;
        let view_count = per_view.get(&method).and_then(|values| values.get(MEASURES[PSNR].name)?.as_object());

        let info = model_folder::read_info(folder)?;
        let rest = |name: &str| info.as_ref().and_then(|info| info.rest.get(name));
        let timeline = read_json(&folder.join("timeline.json"))?;
        let so_far = timeline.get(&method).and_then(|entry| entry.get("seconds")?.as_f64());
        let in_total = info.as_ref().filter(|info| info.iterations == iteration).and(rest("seconds"));
        let source = info.as_ref().map(|info| info.source_path.clone()).or_else(|| source_in_cfg_args(folder));
        let source = source.unwrap_or_default();
        let downscale = info.as_ref().map(|info| f64::from(info.downscale.max(1)));
        let training_views = rest("train_views").and_then(Value::as_f64);
        let background = rest("background").and_then(|channels| serde_json::from_value(channels.clone()).ok());
        Ok(Self {
            folder: folder.to_owned(),
            scene: last_component(Path::new(&source)).unwrap_or_else(|| "scene".into()),
            source,
            conditions: [Some(iteration.into()), downscale, training_views],
            profile: info
                .as_ref()
                .map_or_else(|| last_component(folder).unwrap_or_default(), |info| info.profile.clone()),
            measured: MEASURES.map(|measure| number(measure.name)),
            is_shaded: info.as_ref().is_some_and(|info| info.shading != "radiance"),
            relit: ["relit_PSNR", "relit_PSNR_scaled"].map(number),
            gaussians: count_in(&model_folder::gaussians_at(folder, iteration))
                .or(rest("gaussians").and_then(Value::as_f64)),
            seconds: so_far.or(in_total.and_then(Value::as_f64)),
            megabytes: megabytes_of(folder, iteration),
            unmeasured: latest.filter(|latest| measured_at.is_some_and(|measured| measured < *latest)),
            settings: settings_of(folder),
            lpips_network: result("LPIPS_network").and_then(Value::as_str).map(str::to_owned),
            views: views_of(folder, view_count.map_or(0, Map::len))?,
            background,
        })
    }
}

/// JSON object of a file; empty if there is no file.
fn read_json(path: &Path) -> Result<Map<String, Value>> {
    if !path.is_file() {
        return Ok(Map::new());
    }
    let bytes = FACTS.read(path)?;
    serde_json::from_slice(&bytes).map_err(|error| Error::Input(format!("cannot understand {path:?}: {error}")))
}

/// Test views, which come first among the cameras of a model.
fn views_of(folder: &Path, count: usize) -> Result<Vec<NamedCamera>> {
    let path = folder.join("cameras.json");
    let mut views = if path.is_file() { cameras::read(&path)? } else { Vec::new() };
    views.truncate(count);
    Ok(views)
}

/// Settings of the run; empty if unknown.
fn settings_of(folder: &Path) -> toml::Table {
    let text = fs::read_to_string(folder.join("config.toml")).unwrap_or_default();
    text.parse().unwrap_or_default()
}

/// Data set of a run of INRIA's program, from `cfg_args`.
fn source_in_cfg_args(folder: &Path) -> Option<String> {
    let text = fs::read_to_string(folder.join("cfg_args")).ok()?;
    let (_, rest) = text.split_once("source_path='")?;
    rest.split_once('\'').map(|(source, _)| source.to_owned())
}

fn last_component(path: &Path) -> Option<String> {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    Some(path.file_name()?.to_string_lossy().into_owned())
}

/// Number of Gaussians of a PLY file, from its header.
fn count_in(path: &Path) -> Option<f64> {
    let file = fs::File::open(path).ok()?.take(HEADER_LEN_MAX);
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
