//! Data sets: photographs with their cameras, in the layouts of NeRF Synthetic, COLMAP and
//! nerfstudio.
//!
//! The content of a folder determines its format: `transforms_train.json`, a scene of NeRF
//! Synthetic or Shiny Blender; `sparse`, or `cameras` and `images` in COLMAP's formats, a
//! reconstruction; `transforms.json`, a data set of nerfstudio or instant-ngp. Lens distortion is
//! removed ([`crate::lens`]). A picture is rotated by its EXIF orientation where it fits its camera
//! only so.

use crate::{
    blender, colmap,
    error::{Error, Result},
    listing::Listing,
    nerfstudio,
    points_ply::{self, PointCloud},
    shot::{Opened, Shot},
};
use core::sync::atomic::{AtomicUsize, Ordering};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

pub use crate::{
    listing::{IMAGES, LoadOptions, TEST_EVERY},
    shot::View,
};

/// Training views, test views and initial points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dataset {
    /// Views to train on.
    pub train: Vec<View>,
    /// Views held out.
    pub test: Vec<View>,
    /// Initial points.
    pub points: Option<PointCloud>,
    /// Short description of the source of the cameras.
    pub source: String,
    /// Notes on skipped, changed or assumed data, one sentence each.
    pub notes: Vec<String>,
}

/// Reads a data set on all cores. `progress` is called with the number of decoded images and of all
/// images, from any thread and in order of completion.
///
/// # Errors
///
/// The first error of the listing, or of the images in their order.
pub fn load(folder: &Path, options: &LoadOptions, progress: impl Fn(usize, usize) + Sync) -> Result<Dataset> {
    let Listing { mut train, test, points, source, mut notes } = list(folder, options)?;
    let points = read_points(folder, options, points)?;
    let held_out = if options.with_test { test.len() } else { 0 };
    train.extend(test);
    let opened = open_all(&train, progress)?;
    note_changes(&opened, &mut notes);
    let mut train: Vec<View> = opened.into_iter().map(|opened| opened.view).collect();
    let test = train.split_off(train.len() - held_out);
    note_missing_normals(&test, &mut notes);
    Ok(Dataset { train, test, points, source, notes })
}

/// Reads one view by its index among the training or test views of [`load`] with the same options.
///
/// # Errors
///
/// An error of the listing, or of the image.
pub fn load_one(folder: &Path, options: &LoadOptions, is_held_out: bool, index: usize) -> Result<Option<View>> {
    // With a point cloud in the options, the data set's points are not read.
    let without_points = LoadOptions { points: Some(PathBuf::new()), ..options.clone() };
    let Listing { train, test, .. } = list(folder, &without_points)?;
    // Without held-out views, test views follow the training views.
    let place = if is_held_out { train.len() + index } else { index };
    let shot = train.iter().chain(&test).nth(place);
    shot.map(|shot| shot.open().map(|opened| opened.view)).transpose()
}

fn list(folder: &Path, options: &LoadOptions) -> Result<Listing> {
    if options.downscale == 0 {
        return Err(Error::Downscale { path: folder.to_owned(), downscale: 0 });
    }
    if !folder.is_dir() {
        return Err(Error::NoFolder { path: folder.to_owned() });
    }
    if folder.join(blender::TRAIN).is_file() {
        return blender::list(folder, options);
    }
    if folder.join(nerfstudio::LIST).is_file() && !colmap::is_at(folder) {
        return nerfstudio::list(folder, options);
    }
    let model = colmap::find(folder).ok_or_else(|| Error::NoTransforms { path: folder.to_owned() })?;
    colmap::list(folder, &model, options)
}

/// Returns whether a folder has the layout of a data set.
pub fn is_dataset(folder: &Path) -> bool {
    [blender::TRAIN, nerfstudio::LIST].iter().any(|name| folder.join(name).is_file()) || colmap::find(folder).is_some()
}

fn read_points(folder: &Path, options: &LoadOptions, listed: Option<PointCloud>) -> Result<Option<PointCloud>> {
    let default = folder.join("points3d.ply");
    match &options.points {
        Some(path) => points_ply::read(path).map(Some),
        None if listed.is_some() => Ok(listed),
        None if default.is_file() => points_ply::read(&default).map(Some),
        None => Ok(None),
    }
}

/// Opens all images. The error returned is the first in the list's order, independent of threads.
fn open_all(shots: &[Shot], progress: impl Fn(usize, usize) + Sync) -> Result<Vec<Opened>> {
    let done = AtomicUsize::new(0);
    let views: Vec<Result<Opened>> = shots
        .par_iter()
        .map(|shot| {
            let view = shot.open();
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, shots.len());
            view
        })
        .collect();
    views.into_iter().collect()
}

/// Notes pictures that were rotated, undistorted or masked.
fn note_changes(opened: &[Opened], notes: &mut Vec<String>) {
    let count = |is: fn(&Opened) -> bool| opened.iter().filter(|view| is(view)).count();
    let turned = count(|view| view.is_turned);
    if turned > 0 {
        notes.push(format!("turned {turned} pictures as their EXIF data say"));
    }
    let undistorted = count(|view| view.is_undistorted);
    if undistorted > 0 {
        notes.push(format!("took the lens's distortion out of {undistorted} pictures"));
    }
    let unknown: usize = opened.iter().map(|view| view.unknown).sum();
    if unknown > 0 {
        let pixels: usize = opened.iter().map(|view| view.view.image.rgba.len() / 4).sum();
        let (masked, share) = (count(|view| view.unknown > 0), 100.0 * unknown as f64 / pixels as f64);
        notes.push(format!("{masked} pictures have pixels that do not count, {share:.1} % of all"));
    }
}

fn note_missing_normals(test: &[View], notes: &mut Vec<String>) {
    let missing = test.iter().filter(|view| view.normal.is_none()).count();
    if missing > 0 && missing < test.len() {
        notes.push(format!("{missing} of {} test views have no normal map", test.len()));
    }
}
