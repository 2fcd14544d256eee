//! The views that a scene knows, and their photographs, which are read when they are first looked at.

use super::request::Pose;
use crate::{dataset, failure::Failure};
use serde_json::{Value, json};
use specula_core::camera::Camera;
use specula_io::{cameras::NamedCamera, dataset::LoadOptions};
use specula_train::view::View;
use std::path::PathBuf;

/// Photographs that are kept: those that were looked at last.
const KEPT_MAX: usize = 4;

/// Where photographs come from.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    pub(crate) folder: PathBuf,
    pub(crate) options: LoadOptions,
}

/// Views, those that were held out first.
#[derive(Debug)]
pub(super) struct Album {
    views: Vec<NamedCamera>,
    held_out: usize,
    source: Option<Source>,
    /// By the number of the view.
    kept: Vec<(usize, View)>,
}

impl Album {
    pub(super) fn new(views: Vec<NamedCamera>, held_out: usize, source: Option<Source>) -> Self {
        let held_out = held_out.min(views.len());
        Self { views, held_out, source, kept: Vec::new() }
    }

    /// The camera of a view.
    pub(super) fn camera(&self, index: usize) -> Option<Camera> {
        self.views.get(index).map(|(_, camera)| *camera)
    }

    /// The name of a view.
    pub(super) fn name(&self, index: usize) -> &str {
        self.views.get(index).map_or("", |(name, _)| name)
    }

    /// Whether there may be photographs.
    pub(super) fn has_photographs(&self) -> bool {
        self.source.is_some() && !self.views.is_empty()
    }

    /// The view that is nearest to a pose, in place and direction.
    pub(super) fn nearest(&self, pose: &Pose) -> Option<usize> {
        let spread = self.views.iter().map(|(_, camera)| camera.position.length()).fold(f32::MIN_POSITIVE, f32::max);
        let distance = |index: &usize| {
            let camera = &self.views[*index].1;
            let moved = camera.position.distance(pose.eye) / spread;
            let turned = camera.camera_from_world.row(2).distance(pose.look);
            moved * moved + turned * turned
        };
        (0..self.views.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// The photograph of a view, at the size of this camera.
    pub(super) fn photograph(&mut self, index: usize, camera: &Camera) -> Result<&View, Failure> {
        let size = [camera.width, camera.height];
        let is_it =
            |(number, view): &(usize, View)| *number == index && [view.camera.width, view.camera.height] == size;
        if let Some(place) = self.kept.iter().position(is_it) {
            let kept = self.kept.remove(place);
            self.kept.push(kept);
        } else {
            let view = self.read(index, size)?;
            if self.kept.len() == KEPT_MAX {
                self.kept.remove(0);
            }
            self.kept.push((index, view));
        }
        Ok(&self.kept.last().expect("one was just put there").1)
    }

    fn read(&self, index: usize, size: [u32; 2]) -> Result<View, Failure> {
        let Some(Source { folder, options }) = &self.source else {
            return Err(Failure::Input("the scene does not say where its photographs are".into()));
        };
        let is_held_out = index < self.held_out;
        let place = if is_held_out { index } else { index - self.held_out };
        dataset::load_one(folder, options, is_held_out, place, size)?.ok_or_else(|| {
            let name = self.name(index);
            Failure::Input(format!("{folder:?} has no photograph of view {name:?} any more"))
        })
    }

    /// The views as the page needs them.
    pub(super) fn facts(&self) -> Vec<Value> {
        let fact = |(index, (name, camera)): (usize, &NamedCamera)| {
            let mut fact = camera_facts(camera);
            fact["name"] = name.as_str().into();
            fact["held_out"] = (index < self.held_out).into();
            fact
        };
        self.views.iter().enumerate().map(fact).collect()
    }
}

/// A camera as the page needs it; its angle is the horizontal field of view in degrees.
pub(super) fn camera_facts(camera: &Camera) -> Value {
    let angle = 2.0 * (0.5 * camera.width as f32 / camera.focal_px[0]).atan();
    json!({
        "eye": camera.position.to_array(),
        "look": camera.camera_from_world.row(2).to_array(),
        "up": (-camera.camera_from_world.row(1)).to_array(),
        "angle": angle.to_degrees(),
        "size": [camera.width, camera.height],
    })
}
