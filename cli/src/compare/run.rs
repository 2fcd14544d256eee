//! What a run says of itself, in its own files.

use crate::{
    failure::Failure,
    quality::{MEASURES, PSNR, Values},
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

/// Bytes of a megabyte.
const MEGABYTE: f64 = 1e6;
/// No header of a PLY file has more lines, or more bytes.
const HEADER_LINES: usize = 1000;
const HEADER_LEN: u64 = 1 << 20;

/// Condition of trainings that may be unequal: the head of its column, and its words in a sentence.
#[derive(Clone, Copy, Debug)]
pub(super) struct Given {
    pub(super) words: &'static str,
    pub(super) sentence: fn(usize) -> String,
}

/// In the order of [`Run::given`].
pub(super) const GIVEN: [Given; 3] = [
    Given { words: "iterations", sentence: |count| format!("for {count} iterations") },
    Given { words: "downscale", sentence: |factor| format!("with -r {factor}") },
    Given { words: "training views", sentence: |count| format!("on {count} pictures") },
];

/// A trained model and how good it is.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) folder: PathBuf,
    /// The last part of the data set's path.
    pub(super) scene: String,
    /// The data set's path; empty if it does not say.
    pub(super) source: String,
    /// Conditions of the training, each of [`GIVEN`].
    pub(super) given: [Option<f64>; GIVEN.len()],
    /// Its profile, or the name of its folder if another program trained it.
    pub(super) profile: String,
    pub(super) measured: Values,
    /// Whether it can be put under another light.
    pub(super) is_shaded: bool,
    /// Relighting PSNR, as it is and with the best factors.
    pub(super) relit: [Option<f64>; 2],
    pub(super) gaussians: Option<f64>,
    pub(super) seconds: Option<f64>,
    /// Of the Gaussians and the light, in megabytes.
    pub(super) size: Option<f64>,
    /// Newest iteration, where the measures are of an earlier one.
    pub(super) unmeasured: Option<u32>,
    /// The lines of its `config.toml`.
    pub(super) settings: toml::Table,
    /// What measured LPIPS, if it says so.
    pub(super) network: Option<String>,
    /// The views that it was measured on; none if it does not say.
    pub(super) views: Vec<NamedCamera>,
    pub(super) background: Option<[f64; 3]>,
}

impl Run {
    /// Reads a model's folder.
    pub(super) fn read(folder: &Path) -> Result<Self, Failure> {
        let latest = model_folder::latest_iteration(folder).ok();
        let results = read_json(&folder.join("results.json"))?;
        let measured_at = results.keys().filter_map(|method| method.strip_prefix("ours_")?.parse::<u32>().ok()).max();
        let Some(iteration) = measured_at.or(latest) else {
            return Err(Failure::Input(format!("{folder:?} holds no model; name folders that specula train wrote")));
        };
        let method = model_folder::method_of(iteration);
        let result = |name: &str| results.get(&method).and_then(|own| own.get(name));
        let number = |name: &str| result(name).and_then(Value::as_f64);
        let per_view = read_json(&folder.join("per_view.json"))?;
        let view_count = per_view.get(&method).and_then(|own| own.get(MEASURES[PSNR].name)?.as_object());

        let info = model_folder::read_info(folder)?;
        let rest = |name: &str| info.as_ref().and_then(|info| info.rest.get(name));
        let timeline = read_json(&folder.join("timeline.json"))?;
        let on_the_way = timeline.get(&method).and_then(|own| own.get("seconds")?.as_f64());
        let at_the_end = info.as_ref().filter(|info| info.iterations == iteration).and(rest("seconds"));
        let source = info.as_ref().map(|info| info.source_path.clone()).or_else(|| source_of_others(folder));
        let source = source.unwrap_or_default();
        let downscale = info.as_ref().map(|info| f64::from(info.downscale.max(1)));
        let training_views = rest("train_views").and_then(Value::as_f64);
        let background = rest("background").and_then(|channels| serde_json::from_value(channels.clone()).ok());
        Ok(Self {
            folder: folder.to_owned(),
            scene: last_part(Path::new(&source)).unwrap_or_else(|| "scene".into()),
            source,
            given: [Some(iteration.into()), downscale, training_views],
            profile: info.as_ref().map_or_else(|| last_part(folder).unwrap_or_default(), |info| info.profile.clone()),
            measured: MEASURES.map(|measure| number(measure.name)),
            is_shaded: info.as_ref().is_some_and(|info| info.shading != "radiance"),
            relit: ["relit_PSNR", "relit_PSNR_scaled"].map(number),
            gaussians: count_in(&model_folder::gaussians_at(folder, iteration))
                .or(rest("gaussians").and_then(Value::as_f64)),
            seconds: on_the_way.or(at_the_end.and_then(Value::as_f64)),
            size: size_of(folder, iteration),
            unmeasured: latest.filter(|latest| measured_at.is_some_and(|measured| measured < *latest)),
            settings: settings_of(folder),
            network: result("LPIPS_network").and_then(Value::as_str).map(str::to_owned),
            views: views_of(folder, view_count.map_or(0, Map::len))?,
            background,
        })
    }
}

/// An object from a file; an empty one where there is none.
fn read_json(path: &Path) -> Result<Map<String, Value>, Failure> {
    if !path.is_file() {
        return Ok(Map::new());
    }
    let bytes = FACTS.read(path)?;
    serde_json::from_slice(&bytes).map_err(|error| Failure::Input(format!("cannot understand {path:?}: {error}")))
}

/// The test views, which stand first among a model's cameras.
fn views_of(folder: &Path, count: usize) -> Result<Vec<NamedCamera>, Failure> {
    let path = folder.join("cameras.json");
    let mut views = if path.is_file() { cameras::read(&path)? } else { Vec::new() };
    views.truncate(count);
    Ok(views)
}

/// What the run was told; nothing where it does not say.
fn settings_of(folder: &Path) -> toml::Table {
    let text = fs::read_to_string(folder.join("config.toml")).unwrap_or_default();
    text.parse().unwrap_or_default()
}

/// The data set of a run of the field's tools, from `cfg_args`.
fn source_of_others(folder: &Path) -> Option<String> {
    let text = fs::read_to_string(folder.join("cfg_args")).ok()?;
    let (_, rest) = text.split_once("source_path='")?;
    rest.split_once('\'').map(|(source, _)| source.to_owned())
}

fn last_part(path: &Path) -> Option<String> {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    Some(path.file_name()?.to_string_lossy().into_owned())
}

/// How many Gaussians a PLY file has, by its header.
fn count_in(path: &Path) -> Option<f64> {
    let file = fs::File::open(path).ok()?.take(HEADER_LEN);
    let lines = BufReader::new(file).lines().take(HEADER_LINES);
    let mut header = lines.map_while(Result::ok).take_while(|line| line.trim() != "end_header");
    header.find_map(|line| line.strip_prefix("element vertex ")?.trim().parse().ok())
}

/// Megabytes of the Gaussians, and of their light if there is one.
fn size_of(folder: &Path, iteration: u32) -> Option<f64> {
    let bytes = |path: PathBuf| fs::metadata(path).ok().map(|file| file.len() as f64);
    let light =
        bytes(model_folder::light_at(folder, iteration)).or_else(|| bytes(model_folder::hdr_at(folder, iteration)));
    let gaussians = bytes(model_folder::gaussians_at(folder, iteration))?;
    Some((gaussians + light.unwrap_or(0.0)) / MEGABYTE)
}
