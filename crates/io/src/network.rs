//! Light as a network: `network.safetensors` next to the light of a model.
//!
//! ```text
//! layer1.weight [34, 64], layer1.bias [64]   f32, inputs by outputs
//! layer2.weight [64, 64], layer2.bias [64]
//! layer3.weight [64, 3], layer3.bias [3]
//! __metadata__                               "specula": format and resolution as JSON
//! ```
//!
//! [`specula_core::light_network`] describes the inputs; e to the power of an output is radiance.
//! `environment.exr` next to it contains the network's values at roughness 0, for programs that do
//! not support the network.

use crate::{
    budget::FACTS,
    error::{Error, Result},
    whole_file,
};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};
use specula_core::{
    environment::texels,
    light_network::{CHANNELS, ENCODING, LAYER_STARTS, LightNetworkError, NETWORK_RESOLUTION_MAX, WEIGHT_COUNT, WIDTH},
    scene::{Environment, RadianceActivation},
};
use std::{collections::HashMap, path::Path};

/// Version of the format; incremented when older programs would misread a file.
const FORMAT: u32 = 1;
/// Key of specula's entry in the metadata.
const KEY: &str = "specula";
/// Largest difference between a network and `environment.exr`, as a share of all radiance:
/// exponentials of other machines differ in the last place.
const SAME_LIGHT: f64 = 1e-3;
/// Name, inputs and outputs of each layer.
const LAYERS: [(&str, [usize; 2]); 3] =
    [("layer1", [ENCODING, WIDTH]), ("layer2", [WIDTH, WIDTH]), ("layer3", [WIDTH, CHANNELS])];

/// Specula's entry in the metadata.
#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    /// Texels along an edge of a face.
    resolution: usize,
}

/// Name, shape and range of each tensor among the weights.
fn tensors() -> impl Iterator<Item = (String, Vec<usize>, core::ops::Range<usize>)> {
    LAYERS.into_iter().zip(LAYER_STARTS).flat_map(|((name, [inputs, outputs]), start)| {
        let biases = start + inputs * outputs;
        [
            (format!("{name}.weight"), vec![inputs, outputs], start..biases),
            (format!("{name}.bias"), vec![outputs], biases..biases + outputs),
        ]
    })
}

/// Writes the network of a light.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub(crate) fn write(path: &Path, light: &Environment<Vec<f32>>) -> Result<()> {
    let refuse = |cause: &dyn core::fmt::Display| broken(path, cause);
    let bytes: Vec<u8> = light.values.iter().flat_map(|weight| weight.to_le_bytes()).collect();
    let views: core::result::Result<Vec<_>, _> = tensors()
        .map(|(name, shape, range)| {
            TensorView::new(Dtype::F32, shape, &bytes[4 * range.start..4 * range.end]).map(|view| (name, view))
        })
        .collect();
    let header = Header { format: FORMAT, resolution: light.resolution };
    let header = serde_json::to_string(&header).map_err(Error::json(path))?;
    let metadata = HashMap::from([(KEY.to_owned(), header)]);
    let file = safetensors::serialize(views.map_err(|error| refuse(&error))?, Some(metadata));
    whole_file::write_bytes(path, &file.map_err(|error| refuse(&error))?)
}

/// Reads the network of a light, and compares it with `environment.exr`.
///
/// # Errors
///
/// [`Error::LightNetwork`] for invalid content or another light, [`Error::Read`],
/// [`Error::TooLarge`].
pub(crate) fn read_beside(path: &Path, beside: &Environment<Vec<f32>>) -> Result<Environment<Vec<f32>>> {
    let light = read(path)?;
    let is_same = light.resolution == beside.resolution && {
        let mut sums = [0.0_f64; 2];
        for (ours, theirs) in texels(&light).flatten().zip(&beside.values) {
            sums[0] += f64::from((ours - theirs).abs());
            sums[1] += f64::from(theirs.abs());
        }
        sums[0] <= SAME_LIGHT * sums[1]
    };
    if is_same {
        return Ok(light);
    }
    Err(broken(path, &"environment.exr next to it is another light; remove one of them"))
}

fn read(path: &Path) -> Result<Environment<Vec<f32>>> {
    let refuse = |cause: &dyn core::fmt::Display| broken(path, cause);
    let bytes = FACTS.read(path)?;
    let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|error| refuse(&error))?;
    let ours = metadata
        .metadata()
        .as_ref()
        .and_then(|all| all.get(KEY))
        .ok_or_else(|| refuse(&"it was not written by specula"))?;
    let Header { format, resolution } = serde_json::from_str(ours).map_err(|error| refuse(&error))?;
    if format != FORMAT {
        return Err(refuse(&format_args!("it has format {format}, but this program reads format {FORMAT}")));
    }
    if !(1..=NETWORK_RESOLUTION_MAX).contains(&resolution) {
        return Err(refuse(&format_args!("its resolution is {resolution}, not 1 to {NETWORK_RESOLUTION_MAX}")));
    }
    let file = SafeTensors::deserialize(&bytes).map_err(|error| refuse(&error))?;
    let mut values = vec![0.0; WEIGHT_COUNT];
    for (name, shape, range) in tensors() {
        let tensor = file.tensor(&name).map_err(|error| refuse(&error))?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            let (dtype, found) = (tensor.dtype(), tensor.shape());
            return Err(refuse(&format_args!("{name:?} is {dtype} {found:?} rather than F32 {shape:?}")));
        }
        for (weight, bytes) in values[range].iter_mut().zip(tensor.data().as_chunks::<4>().0) {
            *weight = f32::from_le_bytes(*bytes);
        }
    }
    LightNetworkError::check_weights(&values).map_err(|error| refuse(&error))?;
    Ok(Environment { resolution, activation: RadianceActivation::Network, values })
}

fn broken(path: &Path, cause: &dyn core::fmt::Display) -> Error {
    Error::LightNetwork { path: path.to_owned(), cause: cause.to_string() }
}
