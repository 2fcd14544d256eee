//! Data sets: photographs with their cameras, in the layouts of NeRF Synthetic, COLMAP, nerfstudio
//! and Metashape.
//!
//! The content of a folder determines its format: `transforms_train.json`, a scene of NeRF
//! Synthetic or Shiny Blender; `sparse`, or `cameras` and `images` in COLMAP's formats, a
//! reconstruction; `transforms.json`, a data set of nerfstudio or instant-ngp; an XML file of
//! cameras, a project of Metashape. Lens distortion is
//! removed ([`crate::lens`]). A picture is rotated by its EXIF orientation only if it fits its
//! camera after rotation and not before.

use crate::{
    blender, colmap,
    doubts::doubts,
    error::{Error, Result},
    left_out::{left_out, light_tables},
    light_table::LightTable,
    listing::Listing,
    masks,
    materials::MaterialFiles,
    metashape,
    named::Files,
    nerfstudio, origin,
    points_ply::{self, PointCloud},
    shot::Shot,
};
pub use crate::{color_space::InputSpace, kinds::is_video, named::is_picture, shot::has_image_ending};
use core::sync::atomic::{AtomicUsize, Ordering};
use glam::DVec3;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

pub use crate::{
    listing::{IMAGES, LightSource, LoadOptions, MaskUse, TEST_EVERY},
    shot::{Changes, PictureLight, View},
};

/// Contents of a data set, besides its pictures.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Short description of the source of the cameras: format, list, lenses.
    pub source: String,
    /// Rule of the held-out views.
    pub held_out: String,
    /// Number of pictures with a mask.
    pub masks: usize,
    /// Files and folders that are not used, with the reason.
    pub left_out: Vec<String>,
}

impl Report {
    fn of(files: &Files, listing: &Listing) -> Self {
        Self {
            source: listing.source.clone(),
            held_out: listing.held_out.clone(),
            masks: listing.shots().filter(|shot| shot.mask.is_some()).count(),
            left_out: left_out(files, listing),
        }
    }
}

/// Training views, test views and initial points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dataset {
    /// Views to train on.
    pub train: Vec<View>,
    /// Views held out.
    pub test: Vec<View>,
    /// Initial points.
    pub points: Option<PointCloud>,
    /// Origin of cameras and points in the data set's world ([`crate::origin`]).
    pub origin: [f64; 3],
    /// Contents of the data set, besides its pictures.
    pub report: Report,
    /// Notes on skipped, changed or assumed data, one sentence each.
    pub notes: Vec<String>,
}

/// Data set with pictures that are decoded one by one, on request.
#[derive(Debug)]
pub struct Album {
    shots: Vec<Shot>,
    /// Number of views to train on, which come first.
    train: usize,
    /// Initial points.
    pub points: Option<PointCloud>,
    /// Origin of cameras and points in the data set's world ([`crate::origin`]).
    pub origin: [f64; 3],
    /// Contents of the data set, besides its pictures.
    pub report: Report,
    /// Names of pictures that the options leave out.
    pub left_out: Vec<String>,
    /// Notes on skipped or assumed data, one sentence each.
    pub notes: Vec<String>,
}

impl Album {
    /// Lists a data set and reads its points, but no picture.
    ///
    /// # Errors
    ///
    /// An error of the listing or of the points.
    pub fn list(folder: &Path, options: &LoadOptions) -> Result<Self> {
        let (files, mut listing) = list(folder, options)?;
        if options.lights != LightSource::Unknown {
            listing.used.extend(light_tables(&files));
        }
        let report = Report::of(&files, &listing);
        if let Some(path) = &options.points {
            listing.points = Some(points_ply::read_noting(path, &mut listing.notes)?);
        }
        listing.points = listing.points.map(|points| points.relative_to(listing.origin));
        let doubts = doubts(&listing);
        let Listing { train: mut shots, test, left_out, points, origin, mut notes, .. } = listing;
        notes.extend(doubts);
        if !report.left_out.is_empty() {
            notes.push(format!("not used: {}", report.left_out.join("; ")));
        }
        let held_out = if options.with_test { test.len() } else { 0 };
        shots.extend(test);
        let left_out = left_out.into_iter().map(|shot| shot.name).collect();
        Ok(Self { train: shots.len() - held_out, shots, points, origin, report, left_out, notes })
    }

    /// Number of pictures: those to train on, then those held out.
    pub const fn len(&self) -> usize {
        self.shots.len()
    }

    /// Returns whether there is no picture.
    pub const fn is_empty(&self) -> bool {
        self.shots.is_empty()
    }

    /// Number of pictures to train on.
    pub const fn train_count(&self) -> usize {
        self.train
    }

    /// Name of a picture, without folder and extension.
    pub fn name(&self, index: usize) -> &str {
        &self.shots[index].name
    }

    /// Path of a picture.
    pub fn path(&self, index: usize) -> &Path {
        &self.shots[index].image
    }

    /// Light of a picture.
    pub fn light(&self, index: usize) -> &PictureLight {
        &self.shots[index].light
    }

    /// Returns whether a picture has ground-truth materials.
    pub fn has_materials(&self, index: usize) -> bool {
        let MaterialFiles { albedo, surface } = &self.shots[index].materials;
        albedo.is_some() || surface.is_some()
    }

    /// Names and poses of all pictures as text, the same on every machine.
    pub fn description(&self) -> String {
        let lines = self.shots.iter().map(|shot| format!("{:?} {:?}\n", shot.name, shot.pose));
        format!("{} to train on\n{}", self.train, lines.collect::<String>())
    }

    /// Decodes a picture.
    ///
    /// # Errors
    ///
    /// The error of its files.
    pub fn open(&self, index: usize) -> Result<(View, Changes)> {
        self.shots[index].open()
    }
}

/// Reads a data set on all cores. Calls `progress` with the number of decoded images and of all
/// images, from any thread, in order of completion.
///
/// # Errors
///
/// The first error of the listing, or of the images in order.
pub fn load(folder: &Path, options: &LoadOptions, progress: impl Fn(usize, usize) + Sync) -> Result<Dataset> {
    let album = Album::list(folder, options)?;
    let opened = open_all(&album, progress)?;
    let train_count = album.train;
    let Album { points, origin, report, mut notes, .. } = album;
    let (mut train, changes): (Vec<View>, Vec<Changes>) = opened.into_iter().unzip();
    note_changes(&changes, &mut notes);
    let test = train.split_off(train_count);
    note_missing_normals(test.iter().map(|view| view.normal.is_some()), &mut notes);
    Ok(Dataset { train, test, points, origin, report, notes })
}

/// Reads one view by its index among the training or test views of [`load`] with the same options.
///
/// # Errors
///
/// An error of the listing, or of the image.
pub fn load_one(folder: &Path, options: &LoadOptions, is_held_out: bool, index: usize) -> Result<Option<View>> {
    // A point cloud in the options replaces the data set's points.
    let without_points = LoadOptions { points: Some(PathBuf::new()), ..options.clone() };
    let (_, listing) = list(folder, &without_points)?;
    // Without held-out views, the test views follow the training views.
    let place = if is_held_out { listing.train.len() + index } else { index };
    listing.shots().nth(place).map(|shot| shot.open().map(|(view, _)| view)).transpose()
}

fn list(folder: &Path, options: &LoadOptions) -> Result<(Files, Listing)> {
    if options.downscale == 0 {
        return Err(Error::Downscale { path: folder.to_owned(), downscale: 0 });
    }
    if !folder.is_dir() {
        return Err(Error::NoFolder { path: folder.to_owned() });
    }
    let inner = undistorted_workspace(folder, options);
    let files = Files::below(inner.as_deref().unwrap_or(folder));
    let mut listing = list_files(&files, options)?;
    listing.notes.extend(inner.map(|inner| format!("the data set is that in {inner:?}")));
    if let Some(path) = points_ply::find(&files).filter(|_| listing.points.is_none() && options.points.is_none()) {
        listing.points = Some(points_ply::read_noting(&path, &mut listing.notes)?);
        listing.used.push(path);
    }
    move_to_origin(&mut listing, options);
    listing.leave_out(|shot| options.without.contains(&shot.name));
    if let LightSource::Table { path, only } = &options.lights {
        listing.used.push(path.clone());
        LightTable::read(path)?.select(path, only.as_deref(), &mut listing)?;
    }
    masks::apply(options.masks, &mut listing)?;
    listing.train.iter_mut().chain(&mut listing.test).for_each(|shot| shot.space = options.space);
    Ok((files, listing))
}

/// Makes positions of cameras relative to an origin near them, if they are far from that of their
/// world.
fn move_to_origin(listing: &mut Listing, options: &LoadOptions) {
    let positions = |listing: &Listing| listing.shots().map(|shot| shot.pose.position).collect::<Vec<_>>();
    let origin = options.origin.unwrap_or_else(|| origin::of_cameras(&positions(listing)));
    listing.train.iter_mut().chain(&mut listing.test).for_each(|shot| shot.pose.position -= DVec3::from(origin));
    if let Some(comment) = origin::comment(origin) {
        listing.notes.push(format!("positions are relative to the {comment}, because the cameras are far from 0 0 0"));
    }
    listing.notes.extend(origin::note_coarse(origin, &positions(listing)));
    listing.origin = origin;
}

fn list_files(files: &Files, options: &LoadOptions) -> Result<Listing> {
    let folder = &files.root;
    if folder.join(blender::TRAIN).is_file() {
        return blender::list(files, options);
    }
    if folder.join(nerfstudio::LIST).is_file() && !colmap::is_at(folder) {
        return nerfstudio::list(files, options);
    }
    if let (None, Some(cameras)) = (colmap::find(folder), metashape::find(folder)) {
        return metashape::list(files, &cameras, options);
    }
    let none = || colmap::incomplete(folder).unwrap_or_else(|| Error::NoTransforms { path: folder.clone() });
    let model = colmap::find(folder).ok_or_else(none)?;
    colmap::list(files, &model, options)
}

/// Data set in a subfolder of COLMAP's workspace, if the workspace has no images itself.
fn undistorted_workspace(folder: &Path, options: &LoadOptions) -> Option<PathBuf> {
    const PLACES: [&str; 2] = ["dense/0", "dense"];
    let has_own = [blender::TRAIN, nerfstudio::LIST, &options.images].iter().any(|name| folder.join(name).exists());
    PLACES.into_iter().filter(|_| !has_own).map(|place| folder.join(place)).find(|place| colmap::is_at(place))
}

/// Returns whether a folder has the layout of a data set.
pub fn is_dataset(folder: &Path) -> bool {
    let has_list = [blender::TRAIN, nerfstudio::LIST].iter().any(|name| folder.join(name).is_file());
    has_list
        || colmap::find(folder).is_some()
        || metashape::find(folder).is_some()
        || undistorted_workspace(folder, &LoadOptions::default()).is_some()
}

/// Opens all images. The error returned is the first in the list's order, independent of threads.
fn open_all(album: &Album, progress: impl Fn(usize, usize) + Sync) -> Result<Vec<(View, Changes)>> {
    let done = AtomicUsize::new(0);
    let views: Vec<Result<(View, Changes)>> = (0..album.len())
        .into_par_iter()
        .map(|index| {
            let view = album.open(index);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, album.len());
            view
        })
        .collect();
    views.into_iter().collect()
}

/// Notes pictures that were rotated, undistorted or masked.
pub fn note_changes(changes: &[Changes], notes: &mut Vec<String>) {
    let count = |is: fn(&Changes) -> bool| changes.iter().filter(|view| is(view)).count();
    let turned = count(|view| view.is_turned);
    if turned > 0 {
        notes.push(format!("rotated {turned} pictures by their EXIF orientation"));
    }
    let unclipped = count(|view| view.is_unclipped);
    if unclipped > 0 {
        let total = if unclipped < changes.len() { format!(" of {}", changes.len()) } else { String::new() };
        notes.push(format!("{unclipped}{total} pictures are linear, with radiance above white"));
    }
    let undistorted = count(|view| view.is_undistorted);
    if undistorted > 0 {
        notes.push(format!("removed the lens distortion of {undistorted} pictures"));
    }
    let unknown: u64 = changes.iter().map(|view| view.unknown).sum();
    if unknown > 0 {
        let pixels: u64 = changes.iter().map(|view| view.pixels).sum();
        let (masked, share) = (count(|view| view.unknown > 0), 100.0 * unknown as f64 / pixels as f64);
        notes.push(format!("{masked} pictures have pixels that a mask or the lens leaves open, {share:.1} % of all"));
    }
}

/// Notes test views without normals, if others have some.
pub fn note_missing_normals(has_normals: impl ExactSizeIterator<Item = bool>, notes: &mut Vec<String>) {
    let all = has_normals.len();
    let missing = has_normals.filter(|has_normals| !has_normals).count();
    if missing > 0 && missing < all {
        notes.push(format!("{missing} of {all} test views have no normal map"));
    }
}
