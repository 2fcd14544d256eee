//! Results of an evaluation.

use crate::{
    evaluation::{
        relit::{self, RelitScene},
        view::EvaluatedView,
    },
    light::LightQuality,
    measure::{self, ViewMeasures},
};
use serde_json::{Map, Value};
use specula_scene::text::printable;
use std::path::PathBuf;

/// Key of the network of LPIPS in `results.json`.
const LPIPS_NETWORK: &str = "LPIPS_network";

/// Results of an evaluation, and its conditions.
#[derive(Debug)]
pub struct Evaluation {
    /// Folder of the model, or PLY file.
    pub scene: PathBuf,
    /// Key of the results in `results.json`; none for a PLY file.
    pub method: Option<String>,
    /// Name of the set of views: test, train or all.
    pub split: &'static str,
    /// Background, sRGB from 0 to 1.
    pub background: [f32; 3],
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Name of the network that measured LPIPS.
    pub lpips_network: Option<String>,
    /// Views with their measures.
    pub views: Vec<EvaluatedView>,
    /// Results under other lights.
    pub relit: Vec<RelitScene>,
    /// Factors that fit the linear albedo to the true one; none without a true one.
    pub albedo_scale: Option<[f32; 3]>,
    /// Agreement of the learned light with the true one, and a picture of both; none without a true
    /// one.
    pub light: Option<EvaluatedLight>,
}

/// Learned light with its measures.
#[derive(Debug)]
pub struct EvaluatedLight {
    /// Agreement with the true light.
    pub quality: LightQuality,
    /// PNG of both lights for the page.
    pub picture: Option<Vec<u8>>,
}

/// Line of text about the factors of an albedo.
pub fn albedo_summary([r, g, b]: [f32; 3]) -> String {
    format!("albedo: scaled by {r:.3}, {g:.3}, {b:.3} in red, green, blue before comparison")
}

impl Evaluation {
    /// Measures of each view.
    pub fn measures(&self) -> Vec<ViewMeasures> {
        self.views.iter().map(|view| view.measures.clone()).collect()
    }

    /// Further entries of `results.json`: mean PSNR under other lights, agreement with the true
    /// light, network of LPIPS.
    pub fn facts(&self) -> Map<String, Value> {
        let mut facts = relit::means(&self.relit);
        facts.extend(self.light.iter().flat_map(|light| light.quality.facts()));
        facts.extend(self.lpips_network.iter().map(|network| (LPIPS_NETWORK.to_owned(), network.as_str().into())));
        facts
    }

    /// JSON object of all results.
    pub fn to_json(&self) -> Value {
        let mut report = measure::json_of_views(&self.measures());
        if let Some(network) = &self.lpips_network {
            report[LPIPS_NETWORK] = network.as_str().into();
        }
        if let Some(scale) = self.albedo_scale {
            report["albedo_scale"] = scale.as_slice().into();
        }
        if let Some(light) = &self.light {
            report["light"] = light.quality.to_json();
        }
        if !self.relit.is_empty() {
            report["relit"] = self.relit.iter().map(RelitScene::to_json).collect::<Vec<Value>>().into();
        }
        report
    }

    /// Lines of text: means, then lines for the albedo, the learned light and each other light.
    pub fn summary(&self) -> String {
        let means = measure::summary(&measure::means(&self.measures()));
        let first = format!("{means}  ({} {} views)", self.views.len(), self.split);
        let albedo = self.albedo_scale.map(albedo_summary);
        let light = self.light.as_ref().map(|light| light.quality.summary());
        let lines = core::iter::once(first).chain(albedo).chain(light);
        let lines = lines.chain(self.relit.iter().map(RelitScene::summary));
        lines.map(|line| printable(&line)).collect::<Vec<_>>().join("\n")
    }
}
