//! Upload of lights: one at a time, received into a file, so that memory is bounded.

use crate::{
    ViewerError,
    http::{HttpError, json_response},
    new_light::{LIGHT_MAX, UploadParameters, refuse_large, too_large},
    request::query,
    state::ServerState,
};
use axum::{
    body::Body,
    extract::{Request, State},
    http::{HeaderMap, StatusCode, Uri, header},
    response::Response,
};
use core::time::Duration;
use http_body_util::BodyExt;
use specula_io::Input;
use std::{io::Write, path::Path, sync::Arc};
use tempfile::NamedTempFile;
use tokio::{
    task::spawn_blocking,
    time::{Instant, timeout, timeout_at},
};

/// Maximum time between two parts of a light.
const PART_TIMEOUT: Duration = Duration::from_secs(10);
/// Maximum time for a light, in addition to that of its bytes at the minimum rate.
const BASE_TIMEOUT: Duration = Duration::from_secs(20);
const BYTES_PER_SECOND_MIN: f64 = 262_144.0;

/// Adds a light from the body of a request.
pub(crate) async fn add_light(
    State(state): State<Arc<ServerState>>,
    uri: Uri,
    request: Request,
) -> Result<Response, HttpError> {
    if !state.is_shaded {
        let message = "the scene is plain Gaussian splatting, whose colours include their light";
        return Err(HttpError::bad_request(message));
    }
    let parameters: UploadParameters = query(&uri)?;
    let extension = parameters.extension()?;
    if content_length(request.headers()).is_some_and(|length| length > LIGHT_MAX) {
        return Err(too_large());
    }
    let permit = state.uploads.clone().try_acquire_owned();
    let permit = permit.map_err(|_| HttpError::busy("another light is being read; send this one in a moment"))?;
    let file = received(request.into_body(), &extension, &state.upload_folder).await?;
    let added = spawn_blocking(move || {
        let added = add(&state, &parameters, &file);
        drop(permit);
        added
    });
    added.await.map_err(HttpError::internal)?
}

fn content_length(headers: &HeaderMap) -> Option<usize> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

/// Maximum time to receive a number of bytes.
fn timeout_of(bytes: usize) -> Duration {
    BASE_TIMEOUT + Duration::from_secs_f64(bytes as f64 / BYTES_PER_SECOND_MIN)
}

/// Receives a light into a file, whose size bounds the memory of its reader.
async fn received(mut body: Body, extension: &str, folder: &Path) -> Result<NamedTempFile, HttpError> {
    let no_room = |error: std::io::Error| HttpError::internal(format!("cannot store the light: {error}"));
    let too_slow =
        |_| HttpError::new(StatusCode::REQUEST_TIMEOUT, "the upload of the light is too slow; send it again");
    let start = Instant::now();
    let mut file = tempfile::Builder::new().suffix(&format!(".{extension}")).tempfile_in(folder).map_err(no_room)?;
    let mut length = 0;
    loop {
        let frame = timeout_at(start + timeout_of(length), timeout(PART_TIMEOUT, body.frame())).await;
        let Some(frame) = frame.and_then(|frame| frame).map_err(too_slow)? else { return Ok(file) };
        let frame = frame.map_err(|error| HttpError::bad_request(format!("the light is incomplete: {error}")))?;
        let Ok(bytes) = frame.into_data() else { continue };
        length += bytes.len();
        if length > LIGHT_MAX {
            return Err(too_large());
        }
        file.write_all(&bytes).map_err(no_room)?;
    }
}

/// Reads a received light and adds it to the lights of the scene.
fn add(
    state: &ServerState,
    UploadParameters { name, up }: &UploadParameters,
    file: &NamedTempFile,
) -> Result<Response, HttpError> {
    // Messages name the file of the client instead of the temporary one.
    let renamed = |message: &str| message.replace(&format!("{:?}", file.path()), &format!("{name:?}"));
    let bad_request = |error: ViewerError| HttpError::bad_request(renamed(&error.to_string()));
    refuse_large(Input::file(file.path()), name)
        .map_err(|error| HttpError::bad_request(renamed(&error.to_string())))?;
    let (label, warnings) = state.lights.add(Input::file(file.path()), name, *up).map_err(bad_request)?;
    let warnings: Vec<String> = warnings.iter().map(|warning| renamed(warning)).collect();
    warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    let mut answer = label.json();
    answer["notes"] = warnings.into();
    Ok(json_response(&answer))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uploads_have_a_minimum_rate() {
        let seconds = [0, 1 << 10, 1 << 20, LIGHT_MAX].map(|bytes| timeout_of(bytes).as_secs_f64());
        assert_eq!(seconds, [20.0, 20.003_906_25, 24.0, 276.0]);
    }
}
