//! Results under other lights, where a data set has pictures under them.

use crate::{
    error::Result,
    relighting::{GroundTruth, RelightingQuality},
};
use serde_json::{Map, Value};
use specula_io::cameras::NamedCamera;
use specula_scene::SceneRenderer;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Folders of a data set with lights, and with a folder of ground truth for each light.
const FOLDERS: [[&str; 2]; 2] = [["relight", "relight"], ["light", "relit"]];

/// Scene under another light.
#[derive(Debug)]
pub struct RelitScene {
    /// Name of the light.
    pub light: String,
    /// Number of views with ground truth.
    pub views: usize,
    /// Agreement with ground truth.
    pub quality: RelightingQuality,
}

impl RelitScene {
    /// Measures the views that have ground truth over a background in sRGB. `renderer` renders
    /// the scene under the light; `progress` is given the number of views so far.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`].
    pub fn measure(
        light: String,
        renderer: &mut SceneRenderer,
        cameras: &[NamedCamera],
        truth: &GroundTruth,
        background: [f32; 3],
        mut progress: impl FnMut(usize),
    ) -> Result<Self> {
        let mut pairs = Vec::new();
        for (index, (_, camera)) in cameras.iter().enumerate().filter(|(index, _)| truth.has(*index)) {
            pairs.extend(truth.pair(index, &renderer.render(camera)?));
            progress(index + 1);
        }
        Ok(Self { light, views: pairs.len(), quality: RelightingQuality::of(&pairs, background) })
    }

    /// One line of text.
    pub(super) fn summary(&self) -> String {
        let Self { light, views, quality } = self;
        format!("under {light}: {quality}  ({views} views)")
    }

    /// Cells of a table: light, PSNR as rendered and scaled, factors, number of views.
    pub(super) fn cells(&self) -> [String; 5] {
        let Self { light, views, quality: RelightingQuality { psnr, psnr_scaled, scale } } = self;
        let factors = scale.map(|factor| format!("{factor:.3}")).join(", ");
        [light.clone(), format!("{psnr:.2}"), format!("{psnr_scaled:.2}"), factors, views.to_string()]
    }

    /// JSON object.
    pub(super) fn to_json(&self) -> Value {
        let mut facts = self.quality.to_json(self.views);
        facts["light"] = self.light.as_str().into();
        facts
    }
}

/// Means over lights as entries of `results.json`; empty without lights.
pub(super) fn means(relit: &[RelitScene]) -> Map<String, Value> {
    if relit.is_empty() {
        return Map::new();
    }
    let mean = |psnr: fn(&RelightingQuality) -> f64| {
        relit.iter().map(|relit| psnr(&relit.quality)).sum::<f64>() / relit.len() as f64
    };
    let means =
        [("relit_PSNR", mean(|quality| quality.psnr)), ("relit_PSNR_scaled", mean(|quality| quality.psnr_scaled))];
    means.into_iter().map(|(name, mean)| (name.to_owned(), mean.into())).collect()
}

/// Lights of a data set, sorted by path, each with the folder of its ground truth.
pub fn lights(dataset: &Path) -> Vec<(PathBuf, PathBuf)> {
    let lights_in = |[lights, pictures]: [&str; 2]| {
        let entries = fs::read_dir(dataset.join(lights)).into_iter().flatten().flatten();
        let is_light = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "hdr" || ending == "exr");
        let with_truth = move |path: PathBuf| {
            let folder = dataset.join(pictures).join(path.file_stem()?);
            folder.is_dir().then_some((path, folder))
        };
        entries.map(|entry| entry.path()).filter(is_light).filter_map(with_truth).collect::<Vec<_>>()
    };
    let mut lights: Vec<(PathBuf, PathBuf)> = FOLDERS.into_iter().flat_map(lights_in).collect();
    lights.sort();
    lights
}
