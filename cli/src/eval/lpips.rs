//! LPIPS of a model's views, by a network from a file.

use crate::{background::Background, failure::Failure, progress::Talk, scene::Renderer};
use specula_accuracy::lpips::Network;
use specula_core::{metrics::quantize, scene::Image};
use specula_io::Error;
use specula_train::{evaluate::Pair, view::View};
use std::{fs, path::Path};

/// Reads the network.
pub(super) fn read(path: &Path) -> Result<Network, Failure> {
    let bytes = fs::read(path).map_err(|cause| Error::Read { path: path.to_owned(), cause })?;
    Network::from_bytes(&bytes).map_err(|error| {
        Failure::Input(format!("{path:?} holds no network for LPIPS: {error}; scripts/lpips-weights.py writes one"))
    })
}

/// Distance of each view's 8-bit picture from the truth. Every core works on one view, so that the features of one at a
/// time have to be held.
pub(super) fn measure(
    network: &Network,
    renderer: &mut Renderer,
    views: &[View],
    background: Background,
    talk: Talk,
) -> Result<Vec<f64>, Failure> {
    let work = talk.work("LPIPS", views.len() as u64);
    let mut distances = Vec::new();
    for view in views {
        let image = renderer.view(&view.camera)?;
        let pair = Pair::new(&image, view, background.0);
        let [truth, rendered] = [&pair.truth, &pair.rendered].map(|planes| shown(planes, view));
        distances.push(network.distance(&truth, &rendered).ok_or_else(|| too_small(view))?);
        work.done(distances.len() as u64, String::new);
    }
    work.finish();
    Ok(distances)
}

/// Planes as 8 bits show them.
fn shown(planes: &[f32], view: &View) -> Image<Vec<f32>> {
    let values = planes.iter().map(|value| f32::from(quantize(*value)) / 255.0).collect();
    Image { width: view.camera.width as usize, height: view.camera.height as usize, channels: 3, values }
}

fn too_small(view: &View) -> Failure {
    let [width, height] = [view.camera.width, view.camera.height];
    Failure::Input(format!(
        "view {:?} has {width} × {height} pixels, of which nothing reaches the last layer of the network; leave --lpips \
         out, or measure larger pictures with -r 1",
        view.name
    ))
}
