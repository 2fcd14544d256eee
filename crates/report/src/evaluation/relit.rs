//! Results under other lights, if a data set has pictures under them.

use crate::{
    error::Result,
    relighting::{GroundTruth, RelightingQuality, mean_psnr},
};
use serde_json::{Map, Value};
use specula_io::{cameras::NamedCamera, latlong::RADIANCE_ENDINGS};
use specula_scene::SceneRenderer;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Folders of a data set with lights, and with a folder of ground truth for each light.
const FOLDERS: [[&str; 2]; 2] = [["relight", "relight"], ["light", "relit"]];

/// Protocol by which relit views are compared.
#[derive(Clone, Copy, Debug)]
pub struct Protocol {
    /// Key of the mean PSNR over lights in `results.json`.
    pub name: &'static str,
    /// Name in tables.
    pub label: &'static str,
    /// PSNR of a relit scene, if it was measured.
    psnr: fn(&RelitScene) -> Option<f64>,
}

/// Every protocol, in the order of tables.
pub const RELIT: [Protocol; 4] = [
    Protocol { name: "relit_PSNR", label: "relit PSNR", psnr: |relit| Some(relit.quality.psnr) },
    Protocol { name: "relit_PSNR_scaled", label: "relit PSNR, scaled", psnr: |relit| Some(relit.quality.psnr_scaled) },
    Protocol {
        name: "relit_PSNR_albedo_scaled",
        label: "relit PSNR, albedo scaled",
        psnr: |relit| relit.psnr_albedo_scaled,
    },
    Protocol {
        name: "relit_PSNR_view_scaled",
        label: "relit PSNR, views scaled",
        psnr: |relit| Some(relit.quality.psnr_view_scaled),
    },
];

/// Scene under another light.
#[derive(Debug)]
pub struct RelitScene {
    /// Name of the light.
    pub light: String,
    /// Number of views with ground truth.
    pub views: usize,
    /// Agreement with ground truth.
    pub quality: RelightingQuality,
    /// Mean PSNR in dB after scaling the albedo to the true one; `None` if that is unknown.
    pub psnr_albedo_scaled: Option<f64>,
}

impl RelitScene {
    /// Measures the views that have ground truth over a background in sRGB. `renderer` renders
    /// the scene under the light, `scaled` with the albedo scaled to the true one; `progress` is
    /// given the number of views so far.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`].
    pub fn measure(
        light: String,
        renderer: &mut SceneRenderer,
        mut scaled: Option<&mut SceneRenderer>,
        cameras: &[NamedCamera],
        truth: &GroundTruth,
        background: [f32; 3],
        mut progress: impl FnMut(usize),
    ) -> Result<Self> {
        let [mut pairs, mut scaled_pairs] = [Vec::new(), Vec::new()];
        for (index, (_, camera)) in cameras.iter().enumerate().filter(|(index, _)| truth.has(*index)) {
            pairs.extend(truth.pair(index, &renderer.render(camera)?));
            if let Some(scaled) = &mut scaled {
                scaled_pairs.extend(truth.pair(index, &scaled.render(camera)?));
            }
            progress(index + 1);
        }
        let psnr_albedo_scaled = scaled.map(|_| mean_psnr(&scaled_pairs, background));
        Ok(Self { light, views: pairs.len(), quality: RelightingQuality::of(&pairs, background), psnr_albedo_scaled })
    }

    /// One line of text.
    pub(super) fn summary(&self) -> String {
        let Self { light, views, quality, psnr_albedo_scaled } = self;
        let scaled = psnr_albedo_scaled.map(|psnr| format!("; {psnr:.2} dB after scaling the albedo"));
        format!("under {light}: {quality}{}  ({views} views)", scaled.unwrap_or_default())
    }

    /// Cells of a table: light, PSNR as rendered and scaled, factors, PSNR after scaling the albedo
    /// and after scaling each view, number of views.
    pub(super) fn cells(&self) -> [String; 7] {
        let Self { light, views, quality, psnr_albedo_scaled } = self;
        let RelightingQuality { psnr, psnr_scaled, scale, psnr_view_scaled } = quality;
        let factors = scale.map(|factor| format!("{factor:.3}")).join(", ");
        let [psnr, psnr_scaled, by_view] = [psnr, psnr_scaled, psnr_view_scaled].map(|psnr| format!("{psnr:.2}"));
        let by_albedo = psnr_albedo_scaled.map_or_else(|| "–".to_owned(), |psnr| format!("{psnr:.2}"));
        [light.clone(), psnr, psnr_scaled, factors, by_albedo, by_view, views.to_string()]
    }

    /// JSON object.
    pub(super) fn to_json(&self) -> Value {
        let mut facts = self.quality.to_json(self.views);
        facts["light"] = self.light.as_str().into();
        if let Some(psnr) = self.psnr_albedo_scaled {
            facts["PSNR_albedo_scaled"] = psnr.into();
        }
        facts
    }
}

/// Means over lights as entries of `results.json`; empty without lights.
pub(super) fn means(relit: &[RelitScene]) -> Map<String, Value> {
    if relit.is_empty() {
        return Map::new();
    }
    let means = RELIT.iter().filter_map(|protocol| {
        let psnrs: Option<Vec<f64>> = relit.iter().map(protocol.psnr).collect();
        let psnrs = psnrs?;
        Some((protocol.name.to_owned(), (psnrs.iter().sum::<f64>() / psnrs.len() as f64).into()))
    });
    means.collect()
}

/// Lights of a data set, sorted by path, each with the folder of its ground truth.
pub fn lights(dataset: &Path) -> Vec<(PathBuf, PathBuf)> {
    let lights_in = |[lights, pictures]: [&str; 2]| {
        let entries = fs::read_dir(dataset.join(lights)).into_iter().flatten().flatten();
        let is_light = |path: &PathBuf| {
            path.extension().is_some_and(|ending| RADIANCE_ENDINGS.iter().any(|known| ending == *known))
        };
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
