//! Data sets for trainings: views with a common near plane, initial points, and the orientation
//! estimated from the cameras.

use crate::{number::group_digits, orientation::estimate};
use half::f16;
use specula_core::camera::{Camera, near_of};
use specula_io::{
    Result,
    cameras::NamedCamera,
    dataset::{
        self, IMAGES, InputSpace, LightSource, LoadOptions, MaskUse, Report, TEST_EVERY, has_image_ending, is_dataset,
        is_picture, is_video,
    },
    materials::Materials,
    model_folder::ModelInfo,
    orientation::Orientation,
    pixels::Pixels,
    points_ply::PointCloud,
};
use specula_train::{
    start::Point,
    view::{Normals, View, extent_of},
};
use std::path::{Path, PathBuf};

/// Default number of random points if a data set has none.
pub(crate) const RANDOM_POINTS: u32 = 20_000;

/// Initial points of a training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InitialPoints {
    /// Number of random points instead of those of the data set; by default 20 000 if it has none.
    pub random: Option<u32>,
    /// Number of random points appended to those of the data set.
    pub background: u32,
}

/// Views to train on and to measure, and initial points.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Views to train on.
    pub train: Vec<View>,
    /// Views held out.
    pub test: Vec<View>,
    /// Ground-truth materials of each view held out; empty if a view has none.
    pub test_materials: Vec<Materials>,
    /// Initial points.
    pub points: Option<Vec<Point>>,
    /// Origin of cameras and points in the data set's world.
    pub origin: [f64; 3],
    /// Orientation estimated from the cameras; none without cameras.
    pub orientation: Option<Orientation>,
    /// Contents of the data set, besides its pictures.
    pub report: Report,
    /// Notes on skipped, changed or assumed data, one sentence each.
    pub notes: Vec<String>,
}

impl Dataset {
    /// Reads a data set on all cores. `progress` is called with the number of decoded images and of
    /// all images, from any thread.
    ///
    /// # Errors
    ///
    /// Those of [`specula_io::dataset::load`].
    pub fn load(folder: &Path, options: &LoadOptions, progress: impl Fn(usize, usize) + Sync) -> Result<Self> {
        let dataset::Dataset { train, mut test, points, origin, report, notes } =
            dataset::load(folder, options, progress)?;
        let test_materials = test.iter_mut().map(|view| core::mem::take(&mut view.materials)).collect();
        let points = points.map(|cloud| points_of(&cloud));
        let positions: Vec<[f32; 3]> = points.iter().flatten().map(|point| point.position).collect();
        let orientation = estimate(train.iter().chain(&test).map(|view| &view.camera), &positions);
        let mut train: Vec<View> = train.into_iter().map(view_of).collect();
        let mut test: Vec<View> = test.into_iter().map(view_of).collect();
        let near = near_of(extent_of(if train.is_empty() { &test } else { &train }));
        train.iter_mut().chain(&mut test).for_each(|view| view.camera.near = near);
        Ok(Self { train, test, test_materials, points, origin, orientation, report, notes })
    }

    /// Source, number of views, their sizes, and number of points on one line.
    pub fn summary(&self) -> String {
        let Self { train, test, points, report, .. } = self;
        let [train, test] = [train, test].map(|views| views.iter().map(|view| &view.camera).collect::<Vec<_>>());
        summary(&report.source, &train, &test, points.as_ref().map_or(0, Vec::len))
    }

    /// Width of the widest training picture in pixels; 0 without any.
    pub fn width_max(&self) -> u32 {
        self.train.iter().map(|view| view.camera.width).max().unwrap_or(0)
    }
}

/// Source, number of views, their sizes, and number of points on one line.
pub(crate) fn summary(source: &str, train: &[&Camera], test: &[&Camera], points: usize) -> String {
    let held_out = if test.is_empty() { String::new() } else { format!(" and {} held out", test.len()) };
    let points = if points == 0 { "no points".to_owned() } else { format!("{} points", group_digits(points)) };
    let sizes = sizes(train.iter().chain(test));
    format!("{source}: {} training pictures{held_out}, {sizes} pixels, {points}", train.len())
}

/// Size of the pictures, or the smallest and the largest.
fn sizes<'a>(cameras: impl Iterator<Item = &'a &'a Camera>) -> String {
    let mut sizes: Vec<[u32; 2]> = cameras.map(|camera| [camera.width, camera.height]).collect();
    sizes.sort_unstable_by_key(|[width, height]| (u64::from(*width) * u64::from(*height), *width));
    let text = |[width, height]: &[u32; 2]| format!("{width} × {height}");
    match (sizes.first(), sizes.last()) {
        (Some(first), Some(last)) if first != last => format!("{} to {}", text(first), text(last)),
        (first, _) => first.map_or_else(String::new, text),
    }
}

/// View of a picture that was decoded.
pub(crate) fn view_of(view: dataset::View) -> View {
    let normals = view.normal.map(|normal| Normals { values: normal.values, mask: normal.mask });
    let Pixels { rgba, unclipped, .. } = view.image;
    View { name: view.name, camera: view.camera, rgba, unclipped, normals }
}

/// CRC-32 of the pixels of a picture.
pub(crate) fn pixel_checksum(rgba: &[u8], unclipped: Option<&[[f16; 3]]>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(rgba);
    for color in unclipped.unwrap_or_default() {
        color.iter().for_each(|number| hasher.update(&number.to_le_bytes()));
    }
    hasher.finalize()
}

/// Cameras of views, with the names of the views.
pub fn named_cameras<'a>(views: impl IntoIterator<Item = &'a View>) -> Vec<NamedCamera> {
    views.into_iter().map(|view| (view.name.clone(), view.camera)).collect()
}

/// Points of a point cloud.
pub fn points_of(cloud: &PointCloud) -> Vec<Point> {
    let pairs = cloud.positions.iter().zip(&cloud.colors);
    let place = |position: &[f64; 3]| position.map(|coordinate| coordinate as f32);
    pairs.map(|(position, color)| Point { position: place(position), color: *color }).collect()
}

/// Point cloud of points.
pub fn cloud_of(points: &[Point]) -> PointCloud {
    PointCloud {
        positions: points.iter().map(|point| point.position.map(f64::from)).collect(),
        colors: points.iter().map(|point| point.color).collect(),
    }
}

/// Options with which the training of a model read its data set.
pub fn options_of(info: &ModelInfo) -> LoadOptions {
    let named = |key: &str| info.rest.get(key).and_then(|name| name.as_str());
    let every = info.rest.get("test_every").and_then(|every| u32::try_from(every.as_u64()?).ok());
    LoadOptions {
        downscale: info.downscale.max(1),
        with_test: info.eval,
        points: None,
        images: named("images").unwrap_or(IMAGES).to_owned(),
        test_every: every.unwrap_or(TEST_EVERY),
        origin: Some(info.origin),
        masks: named("masks").and_then(MaskUse::named).unwrap_or_default(),
        lights: if info.light_names().is_empty() { LightSource::Unknown } else { LightSource::Known },
        without: info.left_out().into_iter().map(str::to_owned).collect(),
        space: named("input_space").and_then(InputSpace::named).unwrap_or_default(),
    }
}

/// Folder that is not a data set, but near one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Misplaced {
    /// Part of this data set.
    PartOf(PathBuf),
    /// A model.
    Model,
    /// Parent of these data sets, by name.
    ParentOf(Vec<PathBuf>),
    /// Cameras of another program.
    CamerasOf {
        /// The program.
        program: &'static str,
        /// Way to export supported cameras.
        remedy: &'static str,
    },
    /// Pictures without cameras.
    Pictures {
        /// Their number.
        count: usize,
        /// Their folder.
        folder: PathBuf,
        /// Ending of their format, if none of them is of one that is read.
        unread: Option<String>,
    },
    /// A video.
    Video(PathBuf),
    /// A picture, not a folder of them.
    Picture,
    /// Another file.
    File,
}

/// Camera files of other programs, by name or extension, and how to export supported ones.
const OTHERS: [(&str, &str, &str); 5] = [
    ("reconstruction.json", "OpenSfM", "write it for COLMAP with `opensfm export_colmap`"),
    (".psx", "Metashape", "write them as XML with File > Export > Export Cameras, beside the folder images"),
    (".rcproj", "RealityScan", "write it for COLMAP with Export > Registration"),
    ("bundle.out", "Bundler", "open the pictures with COLMAP and reconstruct them there"),
    ("database.db", "COLMAP", "reconstruct it with `colmap mapper`, which writes sparse/0"),
];

impl Misplaced {
    /// Relation of a folder without a data set to one nearby; none if there is none.
    pub fn find(folder: &Path) -> Option<Self> {
        if folder.is_file() {
            return Some(match is_video(folder) {
                true => Self::Video(folder.to_owned()),
                false if is_picture(folder) => Self::Picture,
                false => Self::File,
            });
        }
        let whole = std::path::absolute(folder).ok()?;
        if let Some(meant) = whole.ancestors().skip(1).take(2).find(|above| has_files(above)) {
            return Some(Self::PartOf(meant.to_owned()));
        }
        if folder.join("specula.json").is_file() {
            return Some(Self::Model);
        }
        let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).collect();
        entries.sort_unstable();
        let children: Vec<PathBuf> = entries.iter().filter(|path| has_files(path)).cloned().collect();
        if !children.is_empty() {
            return Some(Self::ParentOf(children));
        }
        Self::of_others(&entries).or_else(|| Self::bare(folder, &entries))
    }

    /// Cameras of another program among the entries of a folder.
    fn of_others(entries: &[PathBuf]) -> Option<Self> {
        let names: Vec<String> =
            entries.iter().filter_map(|path| Some(path.file_name()?.to_string_lossy().to_lowercase())).collect();
        let is_there = |wanted: &str| names.iter().any(|name| name.ends_with(wanted));
        let found = OTHERS.into_iter().find(|(wanted, ..)| is_there(wanted));
        found.map(|(_, program, remedy)| Self::CamerasOf { program, remedy })
    }

    /// Pictures of a folder or of one below it, or else a video.
    fn bare(folder: &Path, entries: &[PathBuf]) -> Option<Self> {
        let pictures = |folder: &Path| -> Vec<PathBuf> {
            let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
            entries.map(|entry| entry.path()).filter(|path| is_picture(path) && !is_video(path)).collect()
        };
        let folders = core::iter::once(folder).chain(entries.iter().filter(|path| path.is_dir()).map(PathBuf::as_path));
        let found = folders.map(|folder| (pictures(folder), folder)).find(|(pictures, _)| !pictures.is_empty());
        if let Some((pictures, folder)) = found {
            let unread = pictures[0].extension().filter(|_| !pictures.iter().any(|path| has_image_ending(path)));
            let unread = unread.map(|ending| ending.to_string_lossy().to_lowercase());
            return Some(Self::Pictures { count: pictures.len(), folder: folder.to_owned(), unread });
        }
        entries.iter().find(|path| is_video(path)).map(|path| Self::Video(path.clone()))
    }
}

/// Pictures of a folder and the folders below that are read: their paths from it, with slashes, in
/// order.
pub fn picture_names(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let (name, path) = (entry.file_name().to_string_lossy().into_owned(), entry.path());
        if name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            names.extend(picture_names(&path).into_iter().map(|below| format!("{name}/{below}")));
        } else if has_image_ending(&path) {
            names.push(name);
        }
    }
    names.sort();
    names
}

/// Returns whether a folder has files of a data set.
pub fn has_files(folder: &Path) -> bool {
    const FILES: [&str; 5] =
        ["transforms_train.json", "transforms.json", "sparse/0", "sparse/cameras.bin", "sparse/cameras.txt"];
    FILES.iter().any(|name| folder.join(name).exists()) || is_dataset(folder)
}
