//! Data sets of nerfstudio and instant-ngp: one `transforms.json` with all views and their lens.

use crate::{
    colmap,
    error::Result,
    listing::{Listing, LoadOptions},
    photographs::{self, Folders, HeldOut, Posed},
    points_ply::{self, PointCloud},
    transforms::{Frame, Transforms},
};
use glam::{DMat3, DVec3};
use std::{
    collections::HashSet,
    path::{Path, PathBuf},
};

/// List of all views, which identifies the format.
pub(crate) const LIST: &str = "transforms.json";

/// Lists a data set, and reads its points.
pub(crate) fn list(folder: &Path, options: &LoadOptions) -> Result<Listing> {
    let mut transforms = Transforms::read(&folder.join(LIST))?;
    let mut notes = Vec::new();
    leave_out_unnamed(&mut transforms, &mut notes);
    let shared = shared_folder(&transforms.frames);
    let folders = Folders { root: folder.to_owned(), images: folder.join(&shared) };
    let posed: Result<Vec<Posed>> = transforms.frames.iter().map(|frame| posed(&transforms, frame, &shared)).collect();
    let held_out = held_out(&transforms, &shared, options);
    let mut listing = photographs::list(posed?, &folders, &held_out, options)?;
    listing.notes.splice(0..0, notes);
    listing.source = format!("{:?}", transforms.path());
    listing.points = points(&transforms, folder, options, &mut listing.notes)?;
    Ok(listing)
}

fn posed(transforms: &Transforms, frame: &Frame, shared: &Path) -> Result<Posed> {
    Ok(Posed {
        image: within(shared, &frame.file_path),
        mask: frame.mask_path.as_ref().map(|mask| transforms.folder().join(mask.trim_start_matches("./"))),
        pose: transforms.pose(frame)?,
        measured_size: transforms.stated_size(frame)?,
        lens: Box::new(transforms.lens(frame)),
    })
}

/// Removes frames that the file's lists of training and test views omit.
fn leave_out_unnamed(transforms: &mut Transforms, notes: &mut Vec<String>) {
    let Some(train) = transforms.rest.train_filenames.clone() else { return };
    let named: HashSet<String> =
        train.into_iter().chain(held_out_names(transforms).cloned().unwrap_or_default()).collect();
    let all = transforms.frames.len();
    transforms.frames.retain(|frame| named.contains(&frame.file_path));
    let left_out = all - transforms.frames.len();
    if left_out > 0 {
        notes.push(format!("skipped {left_out} frames that are not named for training or testing"));
    }
}

/// Names of test views, where the file lists them.
fn held_out_names(transforms: &Transforms) -> Option<&Vec<String>> {
    let rest = &transforms.rest;
    rest.test_filenames.as_ref().or(rest.val_filenames.as_ref()).filter(|names| !names.is_empty())
}

fn held_out(transforms: &Transforms, shared: &Path, options: &LoadOptions) -> HeldOut {
    match held_out_names(transforms) {
        Some(names) => HeldOut::Named(names.iter().map(|name| within(shared, name)).collect()),
        None => HeldOut::Every(options.test_every),
    }
}

/// Common folder of all images; empty if there are several.
fn shared_folder(frames: &[Frame]) -> PathBuf {
    let first = |frame: &Frame| {
        let mut parts = Path::new(frame.file_path.trim_start_matches("./")).components();
        let first = parts.next().map(|part| PathBuf::from(part.as_os_str()));
        first.filter(|_| parts.next().is_some())
    };
    let shared = frames.first().and_then(first);
    shared.filter(|shared| frames.iter().all(|frame| first(frame).as_ref() == Some(shared))).unwrap_or_default()
}

/// Path relative to the common folder.
fn within(shared: &Path, file_path: &str) -> PathBuf {
    let path = Path::new(file_path.trim_start_matches("./"));
    path.strip_prefix(shared).unwrap_or(path).to_owned()
}

/// Points in the world of the frames: those that the file names, or COLMAP's under the file's
/// transform.
fn points(
    transforms: &Transforms,
    folder: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<Option<PointCloud>> {
    if options.points.is_some() {
        return Ok(None);
    }
    if let Some(name) = &transforms.rest.ply_file_path {
        let path = folder.join(name);
        if path.is_file() {
            return points_ply::read(&path).map(Some);
        }
        notes.push(format!("{path:?}, which {LIST} names for its points, is not there"));
    }
    let Some(model) = colmap::find(folder) else { return Ok(None) };
    let mut points = colmap::read_points(&model, notes)?;
    if let Some(rows) = &transforms.rest.applied_transform {
        apply(rows, &mut points);
    }
    notes.push(format!("points are those of COLMAP in {:?}", model.folder));
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
