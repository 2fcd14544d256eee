//! Uploaded lights: parameters and limits.

use crate::{ViewerError, http::HttpError};
use axum::http::StatusCode;
use serde::Deserialize;
use specula_io::{Input, latlong};
use specula_scene::light_file::MapUp;
use std::path::Path;

/// Largest size of a light, in bytes.
pub(crate) const LIGHT_MAX: usize = 64 << 20;
/// Largest number of pixels of a light, which take 400 MB decoded.
const PIXELS_MAX: u64 = 1 << 25;

/// Light to be received.
#[derive(Debug, Deserialize)]
pub(crate) struct UploadParameters {
    /// File name.
    #[serde(default)]
    pub(crate) name: String,
    /// Up direction of the map.
    #[serde(default)]
    pub(crate) up: MapUp,
}

impl UploadParameters {
    /// Extension of the file in lower case, if it is one of a lat-long map.
    pub(crate) fn extension(&self) -> Result<String, HttpError> {
        let extension = Path::new(&self.name).extension().and_then(|extension| extension.to_str());
        let extension = extension.map(str::to_ascii_lowercase).unwrap_or_default();
        if latlong::RADIANCE_ENDINGS.contains(&extension.as_str()) {
            return Ok(extension);
        }
        let name = &self.name;
        Err(HttpError::bad_request(format!(
            "{name:?} is not a light; use a lat-long map with the extension .hdr or .exr"
        )))
    }
}

/// 413 Content Too Large: a light of more than [`LIGHT_MAX`] bytes.
pub(crate) fn too_large() -> HttpError {
    let message = format!("the light is larger than {} MiB; reduce its size", LIGHT_MAX >> 20);
    HttpError::new(StatusCode::PAYLOAD_TOO_LARGE, message)
}

/// Rejects a light called `name` with too many pixels.
///
/// # Errors
///
/// A sentence with its size, or the error of its reader.
pub(crate) fn refuse_large(input: Input<'_>, name: &str) -> Result<(), ViewerError> {
    let [width, height] = latlong::size(input)?;
    if u64::from(width) * u64::from(height) <= PIXELS_MAX {
        return Ok(());
    }
    let message = format!("{name:?} has {width} × {height} pixels; reduce it to at most 8192 × 4096");
    Err(ViewerError::Request(message))
}
