//! Views of the data set, and their photographs, which are read on first use.

use crate::{ViewerError, request::Pose};
use serde_json::{Value, json};
use specula_core::camera::Camera;
use specula_io::{
    cameras::NamedCamera,
    dataset::{self, LoadOptions},
};
use specula_train::view::View;
use std::path::PathBuf;

/// Maximum number of photographs in memory: the last ones used.
const CACHED_MAX: usize = 4;

/// Data set of the photographs.
#[derive(Clone, Debug)]
pub struct PhotographSource {
    /// Folder of the data set.
    pub folder: PathBuf,
    /// Options of the training, which determine the held-out views.
    pub options: LoadOptions,
}

/// Views of the data set, held-out ones first.
#[derive(Debug)]
pub(crate) struct Views {
    cameras: Vec<NamedCamera>,
    held_out: usize,
    source: Option<PhotographSource>,
    /// Photographs by index of the view, in the order of their last use.
    cached: Vec<(usize, View)>,
}

impl Views {
    pub(crate) fn new(cameras: Vec<NamedCamera>, held_out: usize, source: Option<PhotographSource>) -> Self {
        let held_out = held_out.min(cameras.len());
        Self { cameras, held_out, source, cached: Vec::new() }
    }

    /// Camera of a view.
    pub(crate) fn camera(&self, index: usize) -> Option<Camera> {
        self.cameras.get(index).map(|(_, camera)| *camera)
    }

    /// Cameras of the training; all if all are held out.
    pub(crate) fn training_cameras(&self) -> Vec<Camera> {
        let held_out = if self.held_out < self.cameras.len() { self.held_out } else { 0 };
        self.cameras[held_out..].iter().map(|(_, camera)| *camera).collect()
    }

    /// Name of a view.
    pub(crate) fn name(&self, index: usize) -> &str {
        self.cameras.get(index).map_or("", |(name, _)| name)
    }

    /// True if the views have photographs to compare with.
    pub(crate) fn has_photographs(&self) -> bool {
        self.source.is_some() && !self.cameras.is_empty()
    }

    /// View nearest to a pose, by position and viewing direction.
    pub(crate) fn nearest(&self, pose: &Pose) -> Option<usize> {
        let spread = self.cameras.iter().map(|(_, camera)| camera.position.length()).fold(f32::MIN_POSITIVE, f32::max);
        let distance = |index: &usize| {
            let camera = &self.cameras[*index].1;
            let moved = camera.position.distance(pose.eye) / spread;
            let turned = camera.camera_from_world.row(2).distance(pose.look);
            moved * moved + turned * turned
        };
        (0..self.cameras.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// Photograph of a view at the size of `camera`.
    pub(crate) fn photograph(&mut self, index: usize, camera: &Camera) -> Result<&View, ViewerError> {
        let size = [camera.width, camera.height];
        let is_cached =
            |(cached, view): &(usize, View)| *cached == index && [view.camera.width, view.camera.height] == size;
        if let Some(position) = self.cached.iter().position(is_cached) {
            let cached = self.cached.remove(position);
            self.cached.push(cached);
        } else {
            let view = self.read(index, size)?;
            if self.cached.len() == CACHED_MAX {
                self.cached.remove(0);
            }
            self.cached.push((index, view));
        }
        Ok(&self.cached.last().expect("it was just appended").1)
    }

    fn read(&self, index: usize, [width, height]: [u32; 2]) -> Result<View, ViewerError> {
        let Some(PhotographSource { folder, options }) = &self.source else {
            return Err(ViewerError::Request("the scene has no photographs".into()));
        };
        let is_held_out = index < self.held_out;
        let index_in_split = if is_held_out { index } else { index - self.held_out };
        let read = dataset::load_one(folder, options, is_held_out, index_in_split)?;
        let mut view = read.ok_or_else(|| {
            let name = self.name(index);
            ViewerError::Request(format!("{folder:?} no longer has a photograph of view {name:?}"))
        })?;
        if [view.image.width, view.image.height] != [width, height] {
            view.image = view.image.resized(width, height);
            view.camera = view.camera.resized(width, height);
        }
        Ok(View { name: view.name, camera: view.camera, rgba: view.image.rgba, unclipped: None, normals: None })
    }

    /// Views for the page.
    pub(crate) fn json(&self) -> Vec<Value> {
        let view = |(index, (name, camera)): (usize, &NamedCamera)| {
            let mut json = camera_json(camera);
            json["name"] = name.as_str().into();
            json["held_out"] = (index < self.held_out).into();
            json
        };
        self.cameras.iter().enumerate().map(view).collect()
    }
}

/// Camera for the page: horizontal field of view in degrees; focal lengths and principal point as
/// fractions of width and height.
pub(crate) fn camera_json(camera: &Camera) -> Value {
    let Pose { eye, look, up, angle } = Pose::of(camera);
    let size = [camera.width, camera.height].map(|edge| edge as f32);
    let in_picture = |pixels: [f32; 2]| [pixels[0] / size[0], pixels[1] / size[1]];
    json!({
        "focal": in_picture(camera.focal_px),
        "principal": in_picture(camera.principal_px),
        "eye": eye.to_array(),
        "look": look.to_array(),
        "up": up.to_array(),
        "angle": angle.to_degrees(),
        "size": [camera.width, camera.height],
    })
}
