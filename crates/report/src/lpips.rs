//! LPIPS (Zhang et al. 2018) of rendered views, by a network from an ONNX file.

use crate::error::{Error, Result};
use specula_accuracy::lpips::{Network, Unfit};
use specula_core::{metrics::quantize, scene::Image};
use specula_io::budget::NETWORK;
use specula_train::{evaluate::Pair, view::View};
use std::path::{Path, PathBuf};

/// Network that measures LPIPS, and its origin.
#[derive(Debug)]
pub struct LpipsNetwork {
    network: Network,
    path: PathBuf,
    /// Name in the file's metadata, else the name of the file.
    pub name: String,
}

impl LpipsNetwork {
    /// Reads a network. A network is a program: test an untrusted one first in a process with
    /// limits on time and memory.
    ///
    /// # Errors
    ///
    /// A file that cannot be read or is not an LPIPS network.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = NETWORK.read(path)?;
        let network = Network::from_bytes(bytes).map_err(|error| {
            Error::Input(format!("{path:?} is not a usable LPIPS network: {error}; scripts/lpips-onnx.py writes one"))
        })?;
        let file = || path.file_name().unwrap_or_default().to_string_lossy();
        let name = network.name().map_or_else(|| file().into_owned(), str::to_owned);
        Ok(Self { network, path: path.to_owned(), name })
    }

    /// Compares two uniform pictures of this width and height, only to consume time and memory.
    pub fn try_size(&self, [width, height]: [u32; 2]) {
        let [width, height] = [width, height].map(|edge| edge as usize);
        let picture = |value: f32| Image { width, height, channels: 3, values: vec![value; 3 * width * height] };
        // A size that is too small is reported later, with its view.
        let _ = self.network.distance(&picture(0.25), &picture(0.75));
    }

    /// Distance of a rendered view's 8-bit picture from the ground truth.
    ///
    /// # Errors
    ///
    /// A view that is too small for the network.
    pub fn distance(&self, view: &View, image: &Image<Vec<f32>>, background: [f32; 3]) -> Result<f64> {
        let pair = Pair::new(image, view, background);
        let [truth, rendered] = [&pair.truth, &pair.rendered].map(|planes| quantized(planes, view));
        self.network.distance(&truth, &rendered).map_err(|error| self.not_measured(view, &error))
    }

    fn not_measured(&self, view: &View, error: &Unfit) -> Error {
        let [width, height] = [view.camera.width, view.camera.height];
        Error::Input(format!(
            "cannot measure LPIPS of view {:?} ({width} × {height} pixels) by {:?}: {error}",
            view.name, self.path
        ))
    }
}

/// Planes with the 256 values of 8 bits.
fn quantized(planes: &[f32], view: &View) -> Image<Vec<f32>> {
    let values = planes.iter().map(|value| f32::from(quantize(*value)) / 255.0).collect();
    Image { width: view.camera.width as usize, height: view.camera.height as usize, channels: 3, values }
}
