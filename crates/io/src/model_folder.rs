//! Folder of a trained model, in the layout of Gaussian-splatting tools.
//!
//! ```text
//! <model>/point_cloud/iteration_N/point_cloud.ply   Gaussians, written last
//!         light/iteration_N/environment.exr         lossless light: six faces in a column
//!         light/iteration_N/environment_2.exr, …    lights of other groups of pictures
//!         light/iteration_N/network.safetensors     light that is a network; network_2, …
//!         light/iteration_N/near_field.safetensors  surface that reflected rays may meet
//!         brdf_mlp/iteration_N/brdf_mlp.hdr         light for GaussianShader: lat-long, y up
//!         cameras.json                              test views, then training views
//!         input.ply                                 initial points
//!         cfg_args                                  settings, as Python prints them
//!         specula.json                              settings, as specula reads them
//!         results.json, per_view.json               quality on the test views
//!         exposure.json                             exposures; see [`crate::exposure`]
//!         checkpoint.safetensors                    training state; see [`crate::checkpoint`]
//! ```
//!
//! Files in these folders may be links to files elsewhere. Folders that are links are not written
//! to ([`within`]). `results.lock` is locked while results are changed.
//!
//! `specula.json` names the shading function and lists the saved iterations, the newest last, so
//! that an older training in the same folder is not opened by mistake.

use crate::{
    budget::FACTS,
    cameras::{self, NamedCamera},
    checkpoint,
    error::{Error, Result},
    exposure, gaussian_file, gaussian_ply, json,
    latlong::{self, LatLong, UpAxis},
    near_field, network,
    orientation::Orientation,
    origin,
    points_ply::{self, PointCloud},
    whole_file,
    within::{self, holds, refuse_links, remove_file},
};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use specula_core::{
    environment::texels,
    near_field::NearField,
    scene::{Environment, Gaussians, RadianceActivation},
};
use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// Size of `brdf_mlp.hdr` in GaussianShader.
const HDR_SIZE: [usize; 2] = [1024, 512];
/// Face resolution to which GaussianShader resamples `brdf_mlp.hdr`.
const HDR_RESOLUTION: usize = 512;

/// Relative error of RGBE, which rounds all channels of a pixel to steps of 1/256 of the largest.
const RGBE_ERROR: f64 = 0.02;
/// Files of a training other than its models, exposures and checkpoint.
const FILES: [&str; 8] = [INFO, RESULTS, PER_VIEW, TIMELINE, "cameras.json", "input.ply", "cfg_args", "config.toml"];
/// File of the training's settings.
const INFO: &str = "specula.json";
/// File of mean metrics, by method.
const RESULTS: &str = "results.json";
/// File of metrics of each view, by method.
const PER_VIEW: &str = "per_view.json";
/// Metric that identifies the pictures of a method.
const IDENTITY_METRIC: &str = "PSNR";
/// File of metrics over the course of a training.
const TIMELINE: &str = "timeline.json";
/// File that is locked while files of metrics are read, changed and written.
const RESULTS_LOCK: &str = "results.lock";
/// Entry of `specula.json` with the names of lights.
const LIGHTS: &str = "lights";
/// Entry of `specula.json` with the names of pictures that a training left out.
const LEFT_OUT: &str = "left_out";
/// Folders with a subfolder for each iteration.
const ITERATIONS: [&str; 3] = ["point_cloud", "light", "brdf_mlp"];

/// Description of a model in `specula.json`: settings of its training and further facts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ModelInfo {
    /// Version of the program that trained it.
    pub version: String,
    /// Name of the profile.
    pub profile: String,
    /// Name of the shading function.
    pub shading: String,
    /// Steps of training.
    pub iterations: u32,
    /// Whether the training background was white; otherwise black.
    pub white_background: bool,
    /// Whether the test views were held out.
    pub eval: bool,
    /// Factor by which the images were downscaled.
    pub downscale: u32,
    /// Path of the data set.
    pub source_path: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Orientation of the scene in the data set's world; `None` in models of earlier versions, and
    /// without cameras.
    #[serde(alias = "bearings", skip_serializing_if = "Option::is_none")]
    pub orientation: Option<Orientation>,
    /// Origin of the Gaussians and cameras in the data set's world; omitted at zero.
    #[serde(skip_serializing_if = "origin::is_zero", deserialize_with = "origin::read")]
    pub origin: [f64; 3],
    /// Saved iterations of this training, the newest last; empty in models of earlier versions.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub saved: Vec<u32>,
    /// Further entries, preserved as they are.
    #[serde(flatten)]
    pub rest: Map<String, Value>,
}

impl ModelInfo {
    /// Names of the lights of groups of pictures; empty for a single light.
    pub fn light_names(&self) -> Vec<&str> {
        self.names(LIGHTS)
    }

    /// Names of the pictures of the data set that the training left out.
    pub fn left_out(&self) -> Vec<&str> {
        self.names(LEFT_OUT)
    }

    fn names(&self, entry: &str) -> Vec<&str> {
        let names = self.rest.get(entry).and_then(Value::as_array);
        names.into_iter().flatten().filter_map(Value::as_str).collect()
    }

    /// Sets the names of the pictures of the data set that the training left out.
    pub fn set_left_out(&mut self, names: &[String]) {
        if !names.is_empty() {
            self.rest.insert(LEFT_OUT.into(), names.into());
        }
    }

    /// Sets the names of the lights of groups of pictures; none for a single light.
    pub fn set_light_names(&mut self, names: &[String]) {
        if names.len() > 1 {
            self.rest.insert(LIGHTS.into(), names.into());
        }
    }
}

/// Model to be saved.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// The Gaussians.
    pub gaussians: &'a Gaussians<Vec<f32>>,
    /// Comment lines of the PLY header.
    pub comments: &'a [String],
    /// Light; `None` for plain Gaussian splatting.
    pub light: Option<&'a Environment<Vec<f32>>>,
    /// Lights of other groups of pictures.
    pub other_lights: &'a [Environment<Vec<f32>>],
    /// Surface that reflected rays may hit; `None` if they see only the distant light.
    pub near_field: Option<&'a NearField<Vec<f32>>>,
    /// Settings.
    pub info: &'a ModelInfo,
}

/// A model as stored, in the conventions of its files. `specula_scene::OpenedModel` converts it for
/// its shading model.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// The Gaussians.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Comment lines of their file.
    pub comments: Vec<String>,
    /// Notes on parts of their file that are not taken as they are, a sentence each.
    pub notes: Vec<String>,
    /// Light as radiance ([`RadianceActivation::Identity`]), or as a network; `None` for plain
    /// Gaussian splatting.
    pub light: Option<Environment<Vec<f32>>>,
    /// Lights of other groups of pictures.
    pub other_lights: Vec<Environment<Vec<f32>>>,
    /// Surface that reflected rays may hit; `None` if they see only the distant light.
    pub near_field: Option<NearField<Vec<f32>>>,
    /// True if the light is a `brdf_mlp.hdr` that replaced the saved one.
    pub is_relit: bool,
    /// Settings; `None` for models of other programs.
    pub info: Option<ModelInfo>,
    /// Iteration; `None` for a PLY file outside of a model folder.
    pub iteration: Option<u32>,
    /// Whether the file is a relightable one ([`gaussian_ply::GaussianFile::are_materials`]).
    pub are_materials: bool,
}

/// Writes the inputs of a training: cameras and initial points relative to an origin, and
/// `cfg_args`.
///
/// # Errors
///
/// [`Error::Write`] if a file cannot be written.
pub fn save_inputs(
    folder: &Path,
    train: &[NamedCamera],
    test: &[NamedCamera],
    points: &PointCloud,
    origin: [f64; 3],
    cfg_args: &[(&str, Value)],
) -> Result<()> {
    cameras::write(&folder.join("cameras.json"), &[test, train].concat(), origin)?;
    points_ply::write(&folder.join("input.ply"), points)?;
    whole_file::write_bytes(&folder.join("cfg_args"), namespace(cfg_args).as_bytes())
}

/// Removes temporary files of killed programs. Does nothing if the folder does not exist.
pub fn remove_unfinished(folder: &Path) {
    // The deepest folder with temporary files is point_cloud/iteration_N.
    const LEVELS: usize = 2;
    whole_file::remove_unfinished(folder, LEVELS);
}

/// Rejects a folder with links to folders elsewhere, or with folders or pipes in the places of
/// files.
///
/// # Errors
///
/// [`Error::Link`], [`Error::NotAFile`].
pub fn refuse_links_in(folder: &Path) -> Result<()> {
    for iterations in ITERATIONS.map(|name| folder.join(name)) {
        refuse_links(folder, &iterations)?;
        for iteration in entries_in(&iterations).filter(|path| iteration_of(path).is_some()) {
            refuse_links(folder, &iteration)?;
        }
    }
    match files_of(folder)
        .chain([folder.join(RESULTS_LOCK)])
        .find(|path| path.symlink_metadata().is_ok_and(|found| !found.is_file() && !found.is_symlink()))
    {
        Some(path) => Err(Error::NotAFile { path }),
        None => Ok(()),
    }
}

/// Writes a model as the newest iteration. Earlier iterations are kept.
///
/// # Errors
///
/// [`Error::Write`] if a file cannot be written; [`Error::Link`].
pub fn save(folder: &Path, iteration: u32, snapshot: &Snapshot<'_>) -> Result<()> {
    refuse_links_in(folder)?;
    let mut saved = saved_or_none(folder);
    saved.retain(|earlier| *earlier != iteration);
    saved.push(iteration);
    write_info(folder, &ModelInfo { saved, ..snapshot.info.clone() })?;
    if let Some(light) = snapshot.light {
        save_lights(folder, iteration, light, snapshot.other_lights)?;
    }
    let near_field = near_field_at(folder, iteration);
    match snapshot.near_field {
        Some(surface) => near_field::write(&near_field, surface)?,
        None => remove_file(&near_field)?,
    }
    gaussian_ply::write(&gaussians_at(folder, iteration), snapshot.gaussians, snapshot.comments)
}

/// Writes only `specula.json`.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub fn save_info(folder: &Path, info: &ModelInfo) -> Result<()> {
    write_info(folder, &ModelInfo { saved: saved_or_none(folder), ..info.clone() })
}

fn write_info(folder: &Path, info: &ModelInfo) -> Result<()> {
    json::write(&folder.join(INFO), info)
}

/// Saved iterations; empty if `specula.json` cannot be read, since that must not prevent saving.
fn saved_or_none(folder: &Path) -> Vec<u32> {
    saved_iterations(folder).unwrap_or_default()
}

/// Iterations that `specula.json` lists, the newest last.
fn saved_iterations(folder: &Path) -> Result<Vec<u32>> {
    Ok(read_info(folder)?.map(|info| info.saved).unwrap_or_default())
}

/// Returns whether a folder holds a model or a checkpoint.
pub fn holds_training(folder: &Path) -> bool {
    folder.join(INFO).is_file()
        || checkpoint::path_in(folder).is_file()
        || highest_on_disk(folder).is_ok_and(|found| found.is_some())
}

/// Removes a training from a folder: its models, lights, results, checkpoint and pictures, by the
/// names of [`self`]. Other files are kept.
///
/// # Errors
///
/// [`Error::Write`] if a file cannot be removed; [`Error::Link`].
pub fn remove_training(folder: &Path) -> Result<()> {
    refuse_links_in(folder)?;
    // Gaussians go first, so that a half-removed model cannot be opened.
    for iterations in ITERATIONS {
        remove_children(&folder.join(iterations), |path| iteration_of(path).is_some())?;
    }
    files_of(folder).try_for_each(|file| remove_file(&file))?;
    // Pictures of the model: `<layer>/ours_N`, and `relight/<light>/ours_N`.
    for what in folders_in(folder) {
        remove_children(&what, is_of_method)?;
        for nested in folders_in(&what) {
            remove_children(&nested, is_of_method)?;
        }
    }
    Ok(())
}

/// Paths of the files of a training other than its models.
fn files_of(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let others = [exposure::path_in(folder), checkpoint::path_in(folder)];
    FILES.map(|name| folder.join(name)).into_iter().chain(others)
}

fn is_of_method(folder: &Path) -> bool {
    let name = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name.strip_prefix("ours_").is_some_and(|rest| rest.starts_with(|digit: char| digit.is_ascii_digit()))
}

/// Subfolders without symbolic links; empty if the folder cannot be read.
fn folders_in(folder: &Path) -> Vec<PathBuf> {
    entries_in(folder).filter(|path| path.is_dir() && !path.is_symlink()).collect()
}

/// Paths of a folder's entries; empty if it cannot be read.
fn entries_in(folder: &Path) -> impl Iterator<Item = PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

fn remove_children(folder: &Path, is_ours: impl Fn(&Path) -> bool) -> Result<()> {
    let mut ours = folders_in(folder).into_iter().filter(|child| is_ours(child));
    ours.try_for_each(|child| fs::remove_dir_all(&child).map_err(|cause| Error::Write { path: child, cause }))
}

/// Writes lights, and removes those of an earlier training with more of them.
fn save_lights(
    folder: &Path,
    iteration: u32,
    light: &Environment<Vec<f32>>,
    others: &[Environment<Vec<f32>>],
) -> Result<()> {
    for (index, light) in core::iter::once(light).chain(others).enumerate() {
        latlong::write_cube_exr(&numbered_light_at(folder, iteration, index), &radiance_of(light), light.resolution)?;
        if light.is_network() {
            network::write(&numbered_network_at(folder, iteration, index), light)?;
        } else {
            remove_file(&numbered_network_at(folder, iteration, index))?;
        }
    }
    for index in 1 + others.len().. {
        let former = numbered_light_at(folder, iteration, index);
        if !holds(&former)? {
            break;
        }
        remove_file(&former)?;
        remove_file(&numbered_network_at(folder, iteration, index))?;
    }
    let [width, height] = HDR_SIZE;
    let map = latlong::from_cube(&radiance_of(light), light.resolution, width, height, UpAxis::Y);
    latlong::write(&hdr_at(folder, iteration), &map)
}

fn radiance_of(light: &Environment<Vec<f32>>) -> Vec<f32> {
    texels(light).flatten().collect()
}

/// Metrics on the test views: name, mean, and the value of each view.
pub type Quality = Vec<(String, f64, Vec<(String, f64)>)>;

/// Key of an iteration's results by the field's convention.
pub fn method_of(iteration: u32) -> String {
    format!("ours_{iteration}")
}

/// Writes the metrics of a method to `results.json` and `per_view.json`. Entries of other methods
/// are kept.
///
/// # Errors
///
/// An error of [`Error`] for files that cannot be read, parsed or written.
pub fn save_quality(folder: &Path, method: &str, quality: &Quality) -> Result<()> {
    let _lock = lock_results(folder)?;
    file_quality(folder, method, quality, Map::new(), [Map::new(), Map::new()])
}

/// Adds metrics to a method's earlier ones, which are kept if they are of the same pictures; also
/// writes `facts` to `results.json`.
///
/// # Errors
///
/// An error of [`Error`] for files that cannot be read, parsed or written.
pub fn add_quality(folder: &Path, method: &str, quality: &Quality, facts: Map<String, Value>) -> Result<()> {
    let _lock = lock_results(folder)?;
    let [mut means, mut per_view] = [read_method(folder, RESULTS, method)?, read_method(folder, PER_VIEW, method)?];
    // Equal PSNR of every view identifies the same pictures and the same ground truth.
    let measured = quality.iter().find(|(measure, ..)| measure == IDENTITY_METRIC).map(|(_, _, views)| object(views));
    if per_view.get(IDENTITY_METRIC) != measured.as_ref() {
        (means, per_view) = Default::default();
    }
    file_quality(folder, method, quality, facts, [means, per_view])
}

/// Lock on the metrics of a folder until it is dropped; `None` if the file system has no locks.
fn lock_results(folder: &Path) -> Result<Option<fs::File>> {
    within::wait_for_lock(&folder.join(RESULTS_LOCK))
}

/// Writes metrics and `facts` over the earlier entries of a method.
fn file_quality(
    folder: &Path,
    method: &str,
    quality: &Quality,
    facts: Map<String, Value>,
    [mut means, mut per_view]: [Map<String, Value>; 2],
) -> Result<()> {
    means.extend(means_of(quality));
    means.extend(facts);
    per_view.extend(quality.iter().map(|(measure, _, views)| (measure.clone(), object(views))));
    write(&folder.join(RESULTS), method, means)?;
    write(&folder.join(PER_VIEW), method, per_view)
}

fn means_of(quality: &Quality) -> Map<String, Value> {
    quality.iter().map(|(measure, mean, _)| (measure.clone(), (*mean).into())).collect()
}

/// Entry of a method in a file of the folder; empty if there is none.
fn read_method(folder: &Path, name: &str, method: &str) -> Result<Map<String, Value>> {
    let mut all = read_all(&folder.join(name))?;
    Ok(match all.remove(method) {
        Some(Value::Object(said)) => said,
        _ => Map::new(),
    })
}

/// Writes the progress of a training at an iteration to `timeline.json`: seconds, number of
/// Gaussians and mean metrics. Entries of other iterations are kept.
///
/// # Errors
///
/// An error of [`Error`] for files that cannot be read, parsed or written.
pub fn save_progress(folder: &Path, iteration: u32, seconds: f64, gaussians: usize, quality: &Quality) -> Result<()> {
    let _lock = lock_results(folder)?;
    let mut facts = means_of(quality);
    facts.insert("seconds".into(), seconds.into());
    facts.insert("gaussians".into(), gaussians.into());
    write(&folder.join(TIMELINE), &method_of(iteration), facts)
}

fn object(views: &[(String, f64)]) -> Value {
    Value::Object(views.iter().map(|(view, value)| (view.clone(), (*value).into())).collect())
}

fn write(path: &Path, method: &str, value: Map<String, Value>) -> Result<()> {
    let mut all = read_all(path)?;
    all.insert(method.to_owned(), value.into());
    json::write(path, &all)
}

/// Entries of all methods; empty if the file does not exist.
fn read_all(path: &Path) -> Result<Map<String, Value>> {
    if holds(path)? { json::read(path, &FACTS) } else { Ok(Map::new()) }
}

/// Newest iteration of a model: the last one of `specula.json`, or the highest on disk if it lists
/// none.
///
/// # Errors
///
/// [`Error::NoModel`] without a model, [`Error::Read`] for a folder that cannot be read.
pub fn latest_iteration(folder: &Path) -> Result<u32> {
    let mut saved = saved_iterations(folder)?.into_iter().rev();
    if let Some(newest) = saved.find(|iteration| gaussians_at(folder, *iteration).is_file()) {
        return Ok(newest);
    }
    highest_on_disk(folder)
        .map_err(|cause| Error::Read { path: folder.to_owned(), cause })?
        .ok_or_else(|| Error::NoModel { path: folder.to_owned(), iteration: "N".into() })
}

/// Highest iteration whose Gaussians exist.
fn highest_on_disk(folder: &Path) -> io::Result<Option<u32>> {
    let entries = match fs::read_dir(folder.join("point_cloud")) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
        entries => entries?,
    };
    let iterations = entries.flatten().filter_map(|entry| iteration_of(&entry.path()));
    Ok(iterations.filter(|iteration| gaussians_at(folder, *iteration).is_file()).max())
}

/// Opens the newest iteration of a model, one of its folders `point_cloud/iteration_N`, or a PLY,
/// `.spz` or `.splat` file, with its light and settings.
///
/// The light is read from `brdf_mlp.hdr` if there is no other light, as in models of
/// GaussianShader, or if that file was replaced by another map, a common way to relight.
///
/// # Errors
///
/// An error of [`Error`] for files that are missing, cannot be read or are invalid.
pub fn open(path: &Path) -> Result<Model> {
    match gaussians_in(path) {
        Some(gaussians) => open_ply(&gaussians),
        None if path.is_dir() => open_iteration(path, latest_iteration(path)?),
        None => open_ply(path),
    }
}

/// Gaussians in a folder `point_cloud/iteration_N` of a model; `None` in other folders.
pub fn gaussians_in(folder: &Path) -> Option<PathBuf> {
    iteration_of(folder)?;
    Some(folder.join("point_cloud.ply")).filter(|path| path.is_file())
}

/// Opens a model at an iteration.
///
/// # Errors
///
/// [`Error::NoModel`] for an iteration that does not exist, and the errors of [`open`].
pub fn open_iteration(folder: &Path, iteration: u32) -> Result<Model> {
    let path = gaussians_at(folder, iteration);
    if !path.is_file() {
        return Err(Error::NoModel { path: folder.to_owned(), iteration: iteration.to_string() });
    }
    let file = gaussian_ply::read(&path)?;
    let (light, is_relit) = read_light(folder, iteration)?;
    let info = read_info(folder)?.filter(|info| info.saved.is_empty() || info.saved.contains(&iteration));
    let other_lights =
        if is_relit { Vec::new() } else { read_other_lights(folder, iteration, light.as_ref(), info.as_ref())? };
    let near_field = near_field_at(folder, iteration);
    Ok(Model {
        gaussians: file.gaussians,
        comments: file.comments,
        notes: file.notes,
        light,
        other_lights,
        near_field: if holds(&near_field)? { Some(near_field::read(&near_field)?) } else { None },
        is_relit,
        info,
        iteration: Some(iteration),
        are_materials: file.are_materials,
    })
}

fn open_ply(path: &Path) -> Result<Model> {
    if let Some((folder, iteration)) = model_around(path) {
        return open_iteration(&folder, iteration);
    }
    let file = gaussian_file::read(path)?;
    Ok(Model {
        gaussians: file.gaussians,
        comments: file.comments,
        notes: file.notes,
        light: None,
        other_lights: Vec::new(),
        near_field: None,
        is_relit: false,
        info: None,
        iteration: None,
        are_materials: file.are_materials,
    })
}

/// Model folder and iteration of a PLY file in a model folder.
fn model_around(path: &Path) -> Option<(PathBuf, u32)> {
    let path = path.canonicalize().ok()?;
    let iteration = iteration_of(path.parent()?)?;
    let folder = path.ancestors().nth(3)?;
    let is_in_place = gaussians_at(folder, iteration) == path;
    is_in_place.then(|| (folder.to_owned(), iteration))
}

fn iteration_of(folder: &Path) -> Option<u32> {
    folder.file_name()?.to_str()?.strip_prefix("iteration_")?.parse().ok()
}

/// Reads `specula.json`; `None` if another program trained the model.
///
/// # Errors
///
/// [`Error::Read`], [`Error::Json`] or [`Error::TooLarge`].
pub fn read_info(folder: &Path) -> Result<Option<ModelInfo>> {
    let path = folder.join(INFO);
    if holds(&path)? { json::read(&path, &FACTS).map(Some) } else { Ok(None) }
}

/// Reads the first light, and whether it replaces the saved one.
fn read_light(folder: &Path, iteration: u32) -> Result<(Option<Environment<Vec<f32>>>, bool)> {
    let hdr = hdr_at(folder, iteration);
    let exact = read_saved_light(folder, iteration, 0)?;
    let map = if holds(&hdr)? { Some(latlong::read(&hdr)?.0) } else { None };
    Ok(match (exact, map) {
        (Some(exact), Some(map)) if is_of(&exact, &map) => (Some(exact), false),
        (exact, Some(map)) => {
            let values = latlong::to_cube_bilinear(&map, HDR_RESOLUTION, UpAxis::Y);
            (Some(identity((values, HDR_RESOLUTION))), exact.is_some())
        }
        (exact, None) => (exact, false),
    })
}

/// Reads a light as it was saved, by its index.
fn read_saved_light(folder: &Path, iteration: u32, index: usize) -> Result<Option<Environment<Vec<f32>>>> {
    let (exact, network) = (numbered_light_at(folder, iteration, index), numbered_network_at(folder, iteration, index));
    if !holds(&exact)? {
        return Ok(None);
    }
    let exact = identity(latlong::read_cube_exr(&exact)?);
    if holds(&network)? { network::read_beside(&network, &exact).map(Some) } else { Ok(Some(exact)) }
}

/// Reads the lights after the first, as many as `specula.json` names, or else as there are.
fn read_other_lights(
    folder: &Path,
    iteration: u32,
    first: Option<&Environment<Vec<f32>>>,
    info: Option<&ModelInfo>,
) -> Result<Vec<Environment<Vec<f32>>>> {
    let Some(resolution) = first.map(|light| light.resolution) else { return Ok(Vec::new()) };
    let named = info.map(|info| info.light_names().len());
    let mut others = Vec::new();
    for index in 1..named.unwrap_or(usize::MAX) {
        let Some(light) = read_saved_light(folder, iteration, index)? else { break };
        others.push(light);
    }
    let path = |index: usize| numbered_light_at(folder, iteration, index);
    if let Some(missing) = named.filter(|named| *named > 1 + others.len()) {
        let what = format!("does not exist, but the model has {missing} lights; copy the whole folder of the model");
        return Err(Error::Place { path: path(1 + others.len()), place: "the light".into(), what });
    }
    if let Some(index) = others.iter().position(|light| light.resolution != resolution) {
        let what = format!(
            "has faces of {} texels, and that of the first light of {resolution}; it is of another model",
            others[index].resolution
        );
        return Err(Error::Place { path: path(1 + index), place: "the light".into(), what });
    }
    Ok(others)
}

fn identity((values, resolution): (Vec<f32>, usize)) -> Environment<Vec<f32>> {
    Environment { resolution, activation: RadianceActivation::Identity, values }
}

/// Returns whether a map is the saved one of a light, within the error of RGBE.
fn is_of(light: &Environment<Vec<f32>>, map: &LatLong) -> bool {
    let [width, height] = HDR_SIZE;
    if [map.width, map.height] != HDR_SIZE {
        return false;
    }
    let stored = latlong::from_cube(&radiance_of(light), light.resolution, width, height, UpAxis::Y);
    let radiance = stored.rgb.iter().map(|radiance| f64::from(*radiance));
    let differences = stored.rgb.iter().zip(&map.rgb).map(|(one, other)| f64::from((one - other).abs()));
    // The comparison is false for NaN, from infinite radiance: the saved light is kept.
    !(differences.sum::<f64>() > RGBE_ERROR * radiance.sum::<f64>())
}

/// Path of the Gaussians of an iteration.
pub fn gaussians_at(folder: &Path, iteration: u32) -> PathBuf {
    folder.join(format!("point_cloud/iteration_{iteration}/point_cloud.ply"))
}

/// Path of the lossless light of an iteration, the first of several.
pub fn light_at(folder: &Path, iteration: u32) -> PathBuf {
    numbered_light_at(folder, iteration, 0)
}

/// Path of a lossless light of an iteration, by its index from 0.
pub fn numbered_light_at(folder: &Path, iteration: u32, index: usize) -> PathBuf {
    folder.join(format!("light/iteration_{iteration}/environment{}.exr", suffix_of_light(index)))
}

/// Path of the network of an iteration's light, the first of several.
pub fn network_at(folder: &Path, iteration: u32) -> PathBuf {
    numbered_network_at(folder, iteration, 0)
}

fn numbered_network_at(folder: &Path, iteration: u32, index: usize) -> PathBuf {
    folder.join(format!("light/iteration_{iteration}/network{}.safetensors", suffix_of_light(index)))
}

/// End of the names of a light's files: none for the first, then `_2`, `_3`, ….
fn suffix_of_light(index: usize) -> String {
    if index == 0 { String::new() } else { format!("_{}", index + 1) }
}

/// Path of the near field of an iteration.
pub fn near_field_at(folder: &Path, iteration: u32) -> PathBuf {
    folder.join(format!("light/iteration_{iteration}/near_field.safetensors"))
}

/// Path of the light of an iteration for GaussianShader.
pub fn hdr_at(folder: &Path, iteration: u32) -> PathBuf {
    folder.join(format!("brdf_mlp/iteration_{iteration}/brdf_mlp.hdr"))
}

/// Prints settings like Python's `argparse.Namespace`, which the field's scripts evaluate.
fn namespace(settings: &[(&str, Value)]) -> String {
    let words: Vec<String> = settings.iter().map(|(name, value)| format!("{name}={}", python(value))).collect();
    format!("Namespace({})", words.join(", "))
}

/// Prints a value in Python's notation.
fn python(value: &Value) -> String {
    match value {
        Value::Null => "None".into(),
        Value::Bool(true) => "True".into(),
        Value::Bool(false) => "False".into(),
        Value::Number(number) => number.to_string(),
        Value::String(text) => python_string(text),
        Value::Array(values) => format!("[{}]", values.iter().map(python).collect::<Vec<_>>().join(", ")),
        Value::Object(map) => {
            let pairs: Vec<String> =
                map.iter().map(|(key, value)| format!("{}: {}", python_string(key), python(value))).collect();
            format!("{{{}}}", pairs.join(", "))
        }
    }
}

fn python_string(text: &str) -> String {
    let escaped = text.replace('\\', "\\\\").replace('\'', "\\'").replace('\n', "\\n").replace('\r', "\\r");
    format!("'{escaped}'")
}
