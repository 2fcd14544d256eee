//! Near field of a model: `near_field.safetensors` next to its light.
//!
//! ```text
//! nodes [N, 8], triangles [T, 4], vertices [V, 16]   f32; see specula_core::near_field
//! __metadata__                                       "specula": format and offset as JSON
//! ```

use crate::{
    budget::SCENE,
    error::{Error, Result},
    whole_file,
};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};
use specula_core::near_field::{NODE_LEN, NearField, TRIANGLE_LEN, VERTEX_LEN};
use std::{collections::HashMap, path::Path};

/// Version of the format; incremented when older programs would misread a file.
const FORMAT: u32 = 1;
/// Key of specula's entry in the metadata.
const KEY: &str = "specula";
/// Name of each tensor, and the length of its rows.
const TENSORS: [(&str, usize); 3] = [("nodes", NODE_LEN), ("triangles", TRIANGLE_LEN), ("vertices", VERTEX_LEN)];

/// Specula's entry in the metadata.
#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    offset: f32,
}

/// Writes a near field.
///
/// # Errors
///
/// [`Error::Write`] if the file cannot be written.
pub(crate) fn write(path: &Path, near_field: &NearField<Vec<f32>>) -> Result<()> {
    let refuse = |cause: &dyn core::fmt::Display| broken(path, cause);
    let bytes: Vec<u8> = near_field.values.iter().flat_map(|number| number.to_le_bytes()).collect();
    let mut start = 0;
    let views: core::result::Result<Vec<_>, _> = TENSORS
        .into_iter()
        .zip(near_field.sizes())
        .map(|((name, len), rows)| {
            let end = start + 4 * len * rows;
            let data = &bytes[start..end];
            start = end;
            TensorView::new(Dtype::F32, vec![rows, len], data).map(|view| (name, view))
        })
        .collect();
    let header = Header { format: FORMAT, offset: near_field.offset };
    let header = serde_json::to_string(&header).map_err(Error::json(path))?;
    let metadata = HashMap::from([(KEY.to_owned(), header)]);
    let file = safetensors::serialize(views.map_err(|error| refuse(&error))?, Some(metadata));
    whole_file::write_bytes(path, &file.map_err(|error| refuse(&error))?)
}

/// Reads a near field.
///
/// # Errors
///
/// [`Error::NearField`] for invalid content, [`Error::Read`], [`Error::TooLarge`].
pub(crate) fn read(path: &Path) -> Result<NearField<Vec<f32>>> {
    let refuse = |cause: &dyn core::fmt::Display| broken(path, cause);
    let bytes = SCENE.read(path)?;
    let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|error| refuse(&error))?;
    let ours = metadata
        .metadata()
        .as_ref()
        .and_then(|all| all.get(KEY))
        .ok_or_else(|| refuse(&"it was not written by specula"))?;
    let Header { format, offset } = serde_json::from_str(ours).map_err(|error| refuse(&error))?;
    if format != FORMAT {
        return Err(refuse(&format_args!("it has format {format}, but this program reads format {FORMAT}")));
    }
    let file = SafeTensors::deserialize(&bytes).map_err(|error| refuse(&error))?;
    let (mut sizes, mut values) = ([0; 3], Vec::new());
    for ((name, len), size) in TENSORS.into_iter().zip(&mut sizes) {
        let tensor = file.tensor(name).map_err(|error| refuse(&error))?;
        let [rows, columns] = tensor.shape() else { return Err(refuse(&format_args!("{name:?} is not a table"))) };
        if tensor.dtype() != Dtype::F32 || *columns != len {
            let (dtype, found) = (tensor.dtype(), tensor.shape());
            return Err(refuse(&format_args!("{name:?} is {dtype} {found:?} rather than F32 [rows, {len}]")));
        }
        *size = *rows;
        values.extend(tensor.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
    }
    let near_field = NearField::of_sizes(sizes, offset, values);
    near_field.check().map_err(|error| refuse(&error))?;
    Ok(near_field)
}

fn broken(path: &Path, cause: &dyn core::fmt::Display) -> Error {
    Error::NearField { path: path.to_owned(), cause: cause.to_string() }
}
