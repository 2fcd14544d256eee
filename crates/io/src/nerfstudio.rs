//! Data sets of nerfstudio and instant-ngp: one `transforms.json` with all views and their lens.

use crate::{
    colmap,
    error::{Error, Result},
    listing::{Listing, LoadOptions},
    named::{Files, key_of, stem_of},
    photographs::{self, Folders, HeldOut, Posed, some_of},
    points_ply::{self, PointCloud},
    transforms::{Transforms, places_of},
};
use glam::{DMat3, DVec3};
use std::{
    collections::HashSet,
    path::{Path, PathBuf},
};

/// List of all views, which identifies the format.
pub(crate) const LIST: &str = "transforms.json";

/// Lists a data set, and reads its points.
pub(crate) fn list(files: &Files, options: &LoadOptions) -> Result<Listing> {
    list_of(Transforms::read(&files.root.join(LIST))?, files, options)
}

/// Lists the data set of a file, and reads its points.
pub(crate) fn list_of(mut transforms: Transforms, files: &Files, options: &LoadOptions) -> Result<Listing> {
    let mut notes = transforms.notes();
    let mut places = transforms.places(files, options, &mut notes);
    let split = Split::of(&transforms, files, options, &places, &mut notes)?;
    if let Some(split) = &split {
        leave_out_unnamed(&mut transforms, &mut places, split, &mut notes);
    }
    let images = options.other_images().map_or_else(|| shared_folder(&places), Path::to_owned);
    let below = |place: &Path| place.strip_prefix(&images).unwrap_or(place).to_owned();
    let frames = transforms.frames.iter().zip(&places);
    let posed = frames.map(|(frame, place)| transforms.posed(frame, below(place), transforms.stated_size(frame)?));
    let posed = posed.collect::<Result<Vec<Posed>>>()?;
    let held_out = match split {
        Some(Split { held_out, .. }) if !held_out.is_empty() => {
            let is_held_out = |place: &&PathBuf| held_out.contains(&split_key(place));
            HeldOut::Named(places.iter().filter(is_held_out).map(|place| split_key(&below(place))).collect())
        }
        _ => HeldOut::Every(options.test_every),
    };
    let mut listing = photographs::list(posed, &Folders { files, images }, &held_out, options)?;
    listing.notes.splice(0..0, notes);
    listing.source = transforms.description();
    listing.used.push(transforms.path().to_owned());
    listing.points = points(&transforms, files, options, &mut listing)?;
    Ok(listing)
}

/// Images that a file's lists name, by their keys.
struct Split {
    /// Images to train on; `None` if the file has no list.
    train: Option<HashSet<String>>,
    held_out: HashSet<String>,
}

impl Split {
    /// Lists of training and of test views; `None` if the file has neither. Names without a frame
    /// are noted.
    ///
    /// # Errors
    ///
    /// [`Error::Place`] if no training name has a frame.
    fn of(
        transforms: &Transforms,
        files: &Files,
        options: &LoadOptions,
        places: &[PathBuf],
        notes: &mut Vec<String>,
    ) -> Result<Option<Self>> {
        let frames: HashSet<String> = places.iter().map(|place| split_key(place)).collect();
        let mut keys = |key: &str, names: &[String]| {
            let places = places_of(names.iter().map(String::as_str), files, options, &mut Vec::new());
            let unknown = || names.iter().zip(&places).filter(|(_, place)| !frames.contains(&split_key(place)));
            let unknown: Vec<&String> = unknown().map(|(name, _)| name).collect();
            if !unknown.is_empty() {
                notes.push(format!("{} names of {key} have no frame: {}", unknown.len(), some_of(&unknown)));
            }
            places.iter().map(|place| split_key(place)).filter(|key| frames.contains(key)).collect::<HashSet<String>>()
        };
        let rest = &transforms.rest;
        let train = rest.train_filenames.as_ref().map(|names| keys("train_filenames", names));
        let test = rest.test_filenames.as_deref().map(|names| ("test_filenames", names));
        let test = test.or(rest.val_filenames.as_deref().map(|names| ("val_filenames", names)));
        let held_out = test.map_or_else(HashSet::new, |(key, names)| keys(key, names));
        if train.as_ref().is_some_and(HashSet::is_empty) {
            let (path, place) = (transforms.path().to_owned(), "train_filenames".into());
            return Err(Error::Place { path, place, what: "names no frame; correct its names, or remove it".into() });
        }
        Ok((train.is_some() || !held_out.is_empty()).then_some(Self { train, held_out }))
    }
}

fn split_key(place: &Path) -> String {
    stem_of(&key_of(place)).to_owned()
}

/// Removes frames that the file's lists of training and test views omit.
fn leave_out_unnamed(transforms: &mut Transforms, places: &mut Vec<PathBuf>, split: &Split, notes: &mut Vec<String>) {
    let Some(train) = &split.train else { return };
    let is_named = |place: &Path| [train, &split.held_out].iter().any(|names| names.contains(&split_key(place)));
    let all = places.len();
    let mut named = places.iter().map(|place| is_named(place)).collect::<Vec<_>>().into_iter();
    transforms.frames.retain(|_| named.next().unwrap_or_default());
    places.retain(|place| is_named(place));
    let left_out = all - places.len();
    if left_out > 0 {
        notes.push(format!("skipped {left_out} frames that are neither in the training nor in the test list"));
    }
}

/// Common folder of all images; empty if there are several.
fn shared_folder(places: &[PathBuf]) -> PathBuf {
    let first = |place: &PathBuf| {
        let mut parts = place.components();
        let first = parts.next().map(|part| PathBuf::from(part.as_os_str()));
        first.filter(|_| parts.next().is_some())
    };
    let shared = places.first().and_then(first);
    shared.filter(|shared| places.iter().all(|place| first(place).as_ref() == Some(shared))).unwrap_or_default()
}

/// Points in the world of the frames: from the named file, or COLMAP's under the file's transform.
fn points(
    transforms: &Transforms,
    files: &Files,
    options: &LoadOptions,
    listing: &mut Listing,
) -> Result<Option<PointCloud>> {
    let named = named_points(transforms, files, options, listing)?;
    if named.is_some() || options.points.is_some() {
        return Ok(named);
    }
    let Some(model) = colmap::find(&files.root) else { return Ok(None) };
    let mut points = colmap::read_points(&model, &mut listing.notes)?;
    if let Some(rows) = &transforms.rest.applied_transform {
        apply(rows, &mut points);
    }
    listing.notes.push(format!("points are those of COLMAP in {:?}", model.folder));
    listing.used.push(model.folder);
    Ok(Some(points))
}

/// Points named by a list of cameras.
pub(crate) fn named_points(
    transforms: &Transforms,
    files: &Files,
    options: &LoadOptions,
    listing: &mut Listing,
) -> Result<Option<PointCloud>> {
    let Some(name) = transforms.rest.ply_file_path.as_ref().filter(|_| options.points.is_none()) else {
        return Ok(None);
    };
    let Some(path) = files.named_file(name) else {
        let list = transforms.path();
        listing.notes.push(format!("{name:?}, the point cloud of {list:?}, does not exist"));
        return Ok(None);
    };
    let points = points_ply::read_noting(&path, &mut listing.notes)?;
    listing.used.push(path);
    Ok(Some(points))
}

/// Transforms points by the first three rows of a matrix; fewer rows change nothing.
fn apply(rows: &[[f64; 4]], points: &mut PointCloud) {
    let [a, b, c, ..] = rows else { return };
    let column = |k: usize| DVec3::new(a[k], b[k], c[k]);
    let (turn, shift) = (DMat3::from_cols(column(0), column(1), column(2)), column(3));
    for position in &mut points.positions {
        *position = (turn * DVec3::from(*position) + shift).to_array();
    }
}
