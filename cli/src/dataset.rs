//! Data sets, loaded for training and measurement.

use crate::{failure::Failure, orientation, progress};
use specula_core::camera::near_of;
use specula_io::{
    Error,
    dataset::{self, IMAGES, LoadOptions, TEST_EVERY},
    model_folder::ModelInfo,
    orientation::Orientation,
    points_ply::PointCloud,
};
use specula_report::number::group_digits;
use specula_train::{
    start::Point,
    view::{Normals, View, extent_of},
};
use std::path::Path;

/// Views to train on and to measure, and initial points.
#[derive(Debug)]
pub(crate) struct Dataset {
    pub(crate) train: Vec<View>,
    pub(crate) test: Vec<View>,
    pub(crate) points: Option<Vec<Point>>,
    /// Orientation estimated from its cameras; `None` without cameras.
    pub(crate) orientation: Option<Orientation>,
}

/// Loads a data set and prints notes about it.
///
/// # Errors
/// Those of [`specula_io::dataset::load`]; the folder of a data set that is nearby is suggested.
pub(crate) fn load(folder: &Path, options: &LoadOptions) -> Result<Dataset, Failure> {
    let work = progress::work("loading", 0);
    let loaded = dataset::load(folder, options, |done, all| {
        work.set_steps(all as u64);
        work.done(done as u64, String::new);
    });
    work.finish();
    let loaded = loaded.map_err(|error| misplaced(folder, &error).unwrap_or_else(|| error.into()))?;
    tracing::info!("{}", summary(&loaded));
    loaded.notes.iter().for_each(|note| tracing::info!("{note}"));
    let orientation = orientation_of(&loaded);
    orientation.iter().for_each(|found| tracing::info!("{}", orientation::words(found)));
    if let Some(advice) = advice_on_size(&loaded) {
        tracing::info!("{advice}");
    }
    let mut train: Vec<View> = loaded.train.into_iter().map(view_of).collect();
    let mut test: Vec<View> = loaded.test.into_iter().map(view_of).collect();
    let near = near_of(extent_of(if train.is_empty() { &test } else { &train }));
    train.iter_mut().chain(&mut test).for_each(|view| view.camera.near = near);
    Ok(Dataset { train, test, points: loaded.points.map(|cloud| points_of(&cloud)), orientation })
}

/// True for a folder with the files of a data set.
fn is_data_set(folder: &Path) -> bool {
    const MARKS: [&str; 5] =
        ["transforms_train.json", "transforms.json", "sparse/0", "sparse/cameras.bin", "sparse/cameras.txt"];
    MARKS.iter().any(|mark| folder.join(mark).exists())
}

/// Error for a folder that is no data set but close to one: a part of it, its parent, or a model.
fn misplaced(folder: &Path, error: &Error) -> Option<Failure> {
    if !matches!(error, Error::NoTransforms { .. } | Error::NoImages { .. }) {
        return None;
    }
    let whole = std::path::absolute(folder).ok()?;
    if let Some(meant) = whole.ancestors().skip(1).take(2).find(|above| is_data_set(above)) {
        let words = format!("{folder:?} is a part of a data set; did you mean the folder above, {meant:?}?");
        return Some(Failure::Input(words));
    }
    if folder.join("specula.json").is_file() {
        let words =
            format!("{folder:?} is a model, not a data set; to go on with its training, use -m {folder:?} --resume");
        return Some(Failure::Input(words));
    }
    let within = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let meant = within.filter(|path| is_data_set(path)).min()?;
    Some(Failure::Input(format!("{folder:?} is no data set, but there is one in it; did you mean {meant:?}?")))
}

/// Options that the training of a model read its data set with.
pub(crate) fn options_of(info: &ModelInfo) -> LoadOptions {
    let images = info.rest.get("images").and_then(|images| images.as_str()).unwrap_or(IMAGES).to_owned();
    let every = info.rest.get("test_every").and_then(|every| u32::try_from(every.as_u64()?).ok());
    LoadOptions {
        downscale: info.downscale.max(1),
        with_test: info.eval,
        points: None,
        images,
        test_every: every.unwrap_or(TEST_EVERY),
    }
}

/// Summary of a data set in a line.
fn summary(loaded: &dataset::Dataset) -> String {
    let dataset::Dataset { train, test, points, source, .. } = loaded;
    let held_out = if test.is_empty() { String::new() } else { format!(" and {} held out", test.len()) };
    let points = points.as_ref().map_or(0, |points| points.positions.len());
    let points = if points == 0 { "no points".to_owned() } else { format!("{} points", group_digits(points)) };
    let sizes = sizes(train.iter().chain(test));
    format!("{source}: {} training pictures{held_out}, {sizes} pixels, {points}", train.len())
}

/// Orientation estimated from all cameras.
fn orientation_of(loaded: &dataset::Dataset) -> Option<Orientation> {
    let points = loaded.points.as_ref().map_or(&[][..], |cloud| &cloud.positions);
    specula_scene::orientation::estimate(loaded.train.iter().chain(&loaded.test).map(|view| &view.camera), points)
}

/// Advice for pictures that are wider than usual.
fn advice_on_size(loaded: &dataset::Dataset) -> Option<String> {
    const WIDE: u32 = 1600;
    let widest = loaded.train.iter().map(|view| view.camera.width).max().unwrap_or(0);
    let factor = [2, 4, 8].into_iter().find(|factor| widest / factor <= WIDE).unwrap_or(8);
    (widest > WIDE).then(|| {
        format!("pictures are up to {widest} pixels wide; with -r {factor} training takes far less time and memory")
    })
}

/// Size of the pictures, or the smallest and the largest.
fn sizes<'a>(views: impl Iterator<Item = &'a dataset::View>) -> String {
    let mut sizes: Vec<[u32; 2]> = views.map(|view| [view.camera.width, view.camera.height]).collect();
    sizes.sort_unstable_by_key(|[width, height]| (u64::from(*width) * u64::from(*height), *width));
    let words = |[width, height]: &[u32; 2]| format!("{width} × {height}");
    match (sizes.first(), sizes.last()) {
        (Some(first), Some(last)) if first != last => format!("{} to {}", words(first), words(last)),
        (first, _) => first.map_or_else(String::new, words),
    }
}

fn view_of(view: dataset::View) -> View {
    let normals = view.normal.map(|normal| Normals { values: normal.values, mask: normal.mask });
    View { name: view.name, camera: view.camera, rgba: view.image.rgba, normals }
}

/// Points of a point cloud.
pub(crate) fn points_of(cloud: &PointCloud) -> Vec<Point> {
    let pairs = cloud.positions.iter().zip(&cloud.colors);
    pairs.map(|(position, color)| Point { position: *position, color: *color }).collect()
}

/// Point cloud of points.
pub(crate) fn cloud_of(points: &[Point]) -> PointCloud {
    PointCloud {
        positions: points.iter().map(|point| point.position).collect(),
        colors: points.iter().map(|point| point.color).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demos_cameras_have_exactly_z_above() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/demo");
        let data = load(&folder, &LoadOptions::default()).unwrap();
        let found = data.orientation.unwrap();
        assert_eq!((found.up, found.rolled), ([0.0, 0.0, 1.0], 0), "{found:?}");
        assert!(found.error_degrees.is_some_and(|error| error < 0.5), "{found:?}");
    }
}
