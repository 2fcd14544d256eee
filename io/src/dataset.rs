//! Data sets: photographs with their cameras, as NeRF Synthetic and Shiny Blender lay them out.

use crate::{
    error::{Error, Result},
    pixels::{Normals, Pixels},
    points_ply::{self, PointCloud},
    transforms::{Frame, Transforms},
};
use core::sync::atomic::{AtomicUsize, Ordering};
use rayon::prelude::*;
use specula_core::camera::Camera;
use std::path::{Path, PathBuf};

/// What to read of a data set, and how.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoadOptions {
    /// How many times smaller images become: 1, 2, 4 or 8. Sizes are rounded.
    pub downscale: u32,
    /// Whether the test views are held out; if not, they are trained on as well.
    pub with_test: bool,
    /// A point cloud to start from, instead of the folder's `points3d.ply`.
    pub points: Option<PathBuf>,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self { downscale: 1, with_test: true, points: None }
    }
}

/// One photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The image's name, without folder and ending.
    pub name: String,
    /// Where it was taken from; of the image's size.
    pub camera: Camera,
    /// What was seen.
    pub image: Pixels,
    /// True normals, where a test view has them.
    pub normal: Option<Normals>,
}

/// Photographs to fit, photographs to judge by, and points to start from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dataset {
    /// Views to fit.
    pub train: Vec<View>,
    /// Views held out.
    pub test: Vec<View>,
    /// Points to start from.
    pub points: Option<PointCloud>,
    /// What was left out or assumed, and why: one sentence each.
    pub notes: Vec<String>,
}

/// Reads a data set on all cores. `progress` is called with the number of images done and of all images, from any
/// thread and in order of completion.
pub fn load(folder: &Path, options: &LoadOptions, progress: impl Fn(usize, usize) + Sync) -> Result<Dataset> {
    refuse_impossible(folder, options)?;
    let mut notes = Vec::new();
    let train = Transforms::read(&folder.join("transforms_train.json"))?;
    let test = read_test(folder, &mut notes)?;
    note_distortion([Some(&train), test.as_ref()], &mut notes);

    let train_jobs = jobs(&train, Split::Train, &mut notes)?;
    let test_jobs = test.as_ref().map_or(Ok(Vec::new()), |test| jobs(test, Split::Test, &mut notes))?;
    let points = read_points(folder, options)?;

    let all_jobs: Vec<Job<'_>> = train_jobs.into_iter().chain(test_jobs).collect();
    let mut train = decode_all(&all_jobs, options.downscale, progress)?;
    let held_out = if options.with_test { all_jobs.iter().filter(|job| job.split == Split::Test).count() } else { 0 };
    let test = train.split_off(train.len() - held_out);
    note_missing_normals(&test, &mut notes);
    Ok(Dataset { train, test, points, notes })
}

/// Reads one photograph, by its place among those that [`load`] fits with the same options, or among those held out.
pub fn load_one(folder: &Path, options: &LoadOptions, is_held_out: bool, index: usize) -> Result<Option<View>> {
    refuse_impossible(folder, options)?;
    let mut notes = Vec::new();
    let train = Transforms::read(&folder.join("transforms_train.json"))?;
    let test = read_test(folder, &mut notes)?;
    let train_jobs = jobs(&train, Split::Train, &mut notes)?;
    let test_jobs = test.as_ref().map_or(Ok(Vec::new()), |test| jobs(test, Split::Test, &mut notes))?;
    let place = if is_held_out { train_jobs.len() + index } else { index };
    let mut all_jobs = train_jobs.into_iter().chain(test_jobs);
    all_jobs.nth(place).map(|job| job.view(options.downscale)).transpose()
}

fn refuse_impossible(folder: &Path, options: &LoadOptions) -> Result<()> {
    if options.downscale == 0 {
        return Err(Error::Downscale { path: folder.to_owned(), downscale: 0 });
    }
    if !folder.is_dir() {
        return Err(Error::NoFolder { path: folder.to_owned() });
    }
    if !folder.join("transforms_train.json").is_file() {
        return Err(Error::NoTransforms { path: folder.to_owned() });
    }
    Ok(())
}

fn read_test(folder: &Path, notes: &mut Vec<String>) -> Result<Option<Transforms>> {
    let path = folder.join("transforms_test.json");
    if path.is_file() {
        return Transforms::read(&path).map(Some);
    }
    notes.push(format!("no {path:?}, so there are no test views"));
    Ok(None)
}

fn read_points(folder: &Path, options: &LoadOptions) -> Result<Option<PointCloud>> {
    let usual = folder.join("points3d.ply");
    match &options.points {
        Some(path) => points_ply::read(path).map(Some),
        None if usual.is_file() => points_ply::read(&usual).map(Some),
        None => Ok(None),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Split {
    Train,
    Test,
}

/// One image that is to be read.
struct Job<'a> {
    split: Split,
    transforms: &'a Transforms,
    frame: &'a Frame,
    image: PathBuf,
    normal: Option<PathBuf>,
}

/// Finds the images of a list, before any is decoded: a missing one is reported at once.
fn jobs<'a>(transforms: &'a Transforms, split: Split, notes: &mut Vec<String>) -> Result<Vec<Job<'a>>> {
    let mut jobs = Vec::with_capacity(transforms.frames.len());
    for frame in &transforms.frames {
        if frame.is_macos_shadow() {
            notes.push(format!("skipped {:?}, which macOS made for its own use", frame.file_path));
            continue;
        }
        let image = transforms.image_of(frame)?;
        let normal = if split == Split::Test { normal_beside(&image) } else { None };
        jobs.push(Job { split, transforms, frame, image, normal });
    }
    Ok(jobs)
}

/// `r_0_normal.png` beside `r_0.png`.
fn normal_beside(image: &Path) -> Option<PathBuf> {
    let stem = image.file_stem()?.to_string_lossy().into_owned();
    Some(image.with_file_name(format!("{stem}_normal.png"))).filter(|path| path.is_file())
}

/// Decodes all images; of several faults the first in the list is reported, whatever the threads do.
fn decode_all(jobs: &[Job<'_>], downscale: u32, progress: impl Fn(usize, usize) + Sync) -> Result<Vec<View>> {
    let done = AtomicUsize::new(0);
    let views: Vec<Result<View>> = jobs
        .par_iter()
        .map(|job| {
            let view = job.view(downscale);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, jobs.len());
            view
        })
        .collect();
    views.into_iter().collect()
}

impl Job<'_> {
    fn view(&self, downscale: u32) -> Result<View> {
        let image = Pixels::read(&self.image)?;
        let camera = self.transforms.camera(self.frame, image.width, image.height)?;
        let [width, height] = [image.width, image.height].map(|size| rounded_quotient(size, downscale));
        let normal = self.normal.as_deref().map(Normals::read).transpose()?;
        Ok(View {
            name: self.frame.name(),
            camera: camera.resized(width, height),
            image: if downscale == 1 { image } else { image.resized(width, height) },
            normal: normal.map(|normal| normal.fitted(width, height)),
        })
    }
}

impl Normals {
    fn fitted(self, width: u32, height: u32) -> Self {
        if [self.width, self.height] == [width, height] { self } else { self.resized(width, height) }
    }
}

fn rounded_quotient(size: u32, downscale: u32) -> u32 {
    (f64::from(size) / f64::from(downscale)).round().max(1.0) as u32
}

fn note_distortion(lists: [Option<&Transforms>; 2], notes: &mut Vec<String>) {
    if lists.into_iter().flatten().any(|list| list.is_distorted) {
        notes.push("the lens distortion (k1) of the cameras is ignored; undistort the images for sharp results".into());
    }
}

fn note_missing_normals(test: &[View], notes: &mut Vec<String>) {
    let missing = test.iter().filter(|view| view.normal.is_none()).count();
    if missing > 0 && missing < test.len() {
        notes.push(format!("{missing} of {} test views have no normal map", test.len()));
    }
}
