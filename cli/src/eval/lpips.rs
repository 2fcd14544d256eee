//! LPIPS of a model's views, by a network from a file.

use super::trial::try_network;
use crate::{background::Background, failure::Failure, progress, scene::Renderer};
use specula_accuracy::lpips::{Network, Unfit};
use specula_core::{metrics::quantize, scene::Image};
use specula_io::budget::NETWORK;
use specula_train::{evaluate::Pair, view::View};
use std::path::{Path, PathBuf};

/// A network and where it is from.
#[derive(Debug)]
pub(super) struct Judge {
    network: Network,
    path: PathBuf,
    /// What its file calls it; the file's own name where that says nothing.
    pub(super) name: String,
}

impl Judge {
    /// Reads a network that was tried in another process first, on pictures of this width and height.
    pub(super) fn read(path: &Path, size: [u32; 2]) -> Result<Self, Failure> {
        try_network(path, size)?;
        Self::trusted(path)
    }

    /// Compares two pictures of this width and height, for nothing but what it takes.
    pub(super) fn try_size(&self, [width, height]: [u32; 2]) {
        let [width, height] = [width, height].map(|edge| edge as usize);
        let picture = |value: f32| Image { width, height, channels: 3, values: vec![value; 3 * width * height] };
        // A refusal is told for the view that it is of.
        let _ = self.network.distance(&picture(0.25), &picture(0.75));
    }

    /// Reads a network in this process.
    pub(super) fn trusted(path: &Path) -> Result<Self, Failure> {
        let bytes = NETWORK.read(path)?;
        let network = Network::from_bytes(bytes).map_err(|error| {
            Failure::Input(format!("{path:?} holds no network for LPIPS: {error}; scripts/lpips-onnx.py writes one"))
        })?;
        let file = || path.file_name().unwrap_or_default().to_string_lossy();
        let name = network.name().map_or_else(|| file().into_owned(), str::to_owned);
        Ok(Self { network, path: path.to_owned(), name })
    }

    /// Distance of each view's 8-bit picture from the truth. Every core works on one view, so that the features of one at
    /// a time have to be held.
    pub(super) fn measure(
        &self,
        renderer: &mut Renderer,
        views: &[View],
        background: Background,
    ) -> Result<Vec<f64>, Failure> {
        let work = progress::work("LPIPS", views.len() as u64);
        let mut distances = Vec::new();
        for view in views {
            let image = renderer.view(&view.camera)?;
            let pair = Pair::new(&image, view, background.0);
            let [truth, rendered] = [&pair.truth, &pair.rendered].map(|planes| shown(planes, view));
            distances.push(self.network.distance(&truth, &rendered).map_err(|error| self.not_measured(view, &error))?);
            work.done(distances.len() as u64, String::new);
        }
        work.finish();
        Ok(distances)
    }

    fn not_measured(&self, view: &View, error: &Unfit) -> Failure {
        let [width, height] = [view.camera.width, view.camera.height];
        Failure::Input(format!(
            "LPIPS of view {:?} ({width} × {height} pixels) is not to be had from {:?}: {error}; leave --lpips out, or \
             measure larger pictures with -r 1 if nothing of these reaches the last layer",
            view.name, self.path
        ))
    }
}

/// Planes as 8 bits show them.
fn shown(planes: &[f32], view: &View) -> Image<Vec<f32>> {
    let values = planes.iter().map(|value| f32::from(quantize(*value)) / 255.0).collect();
    Image { width: view.camera.width as usize, height: view.camera.height as usize, channels: 3, values }
}
