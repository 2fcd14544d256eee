//! Data sets as trainings take them.

use crate::{failure::Failure, progress::Talk};
use specula_core::camera::near_of;
use specula_io::{
    dataset::{self, LoadOptions},
    points_ply::PointCloud,
};
use specula_train::{
    start::Point,
    view::{Normals, View, extent_of},
};
use std::path::Path;

/// Pictures to fit and to measure by, and points to start from.
#[derive(Debug)]
pub(crate) struct Dataset {
    pub(crate) train: Vec<View>,
    pub(crate) test: Vec<View>,
    pub(crate) points: Option<Vec<Point>>,
}

/// Reads a data set; what is worth knowing about it goes to stderr.
pub(crate) fn load(folder: &Path, options: &LoadOptions, talk: Talk) -> Result<Dataset, Failure> {
    let work = talk.work("loading", 0);
    let loaded = dataset::load(folder, options, |done, all| {
        work.set_steps(all as u64);
        work.done(done as u64, String::new);
    });
    work.finish();
    let loaded = loaded?;
    loaded.notes.iter().for_each(|note| talk.note(note));
    let mut train: Vec<View> = loaded.train.into_iter().map(view_of).collect();
    let mut test: Vec<View> = loaded.test.into_iter().map(view_of).collect();
    let near = near_of(extent_of(if train.is_empty() { &test } else { &train }));
    train.iter_mut().chain(&mut test).for_each(|view| view.camera.near = near);
    Ok(Dataset { train, test, points: loaded.points.map(|cloud| points_of(&cloud)) })
}

/// One view of a data set at another size, by its place among those to fit or those held out.
pub(crate) fn load_one(
    folder: &Path,
    options: &LoadOptions,
    is_held_out: bool,
    index: usize,
    [width, height]: [u32; 2],
) -> Result<Option<View>, Failure> {
    let view = dataset::load_one(folder, options, is_held_out, index)?;
    Ok(view.map(|mut view| {
        if [view.image.width, view.image.height] != [width, height] {
            view.image = view.image.resized(width, height);
            view.camera = view.camera.resized(width, height);
            view.normal = None;
        }
        view_of(view)
    }))
}

fn view_of(view: dataset::View) -> View {
    let normals = view.normal.map(|normal| Normals { values: normal.values, mask: normal.mask });
    View { name: view.name, camera: view.camera, rgba: view.image.rgba, normals }
}

/// Points as a training takes them.
pub(crate) fn points_of(cloud: &PointCloud) -> Vec<Point> {
    let pairs = cloud.positions.iter().zip(&cloud.colors);
    pairs.map(|(position, color)| Point { position: *position, color: *color }).collect()
}

/// Points as a file holds them.
pub(crate) fn cloud_of(points: &[Point]) -> PointCloud {
    PointCloud {
        positions: points.iter().map(|point| point.position).collect(),
        colors: points.iter().map(|point| point.color).collect(),
    }
}
