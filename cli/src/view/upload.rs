//! Lights that are dropped onto the page: one is read at a time, by way of a file, so that memory stays bounded.

use super::server::{Refusal, Site, bad, json_of};
use crate::{args::EnvUp, failure::Failure, output};
use axum::{
    body::Body,
    extract::{Query, Request, State},
    http::{HeaderMap, StatusCode, header},
    response::Response,
};
use clap::ValueEnum;
use core::time::Duration;
use http_body_util::BodyExt;
use serde_json::json;
use specula_io::latlong;
use std::{collections::HashMap, io::Write, path::Path, sync::Arc};
use tempfile::NamedTempFile;
use tokio::{
    task::spawn_blocking,
    time::{Instant, timeout, timeout_at},
};

/// Bytes of a light that comes in, at most.
const LIGHT_MAX: usize = 64 << 20;
/// Pixels of a light, at most: 400 MB when they are decoded.
const PIXELS_MAX: u64 = 1 << 25;
/// Longest time in which nothing comes of a light.
const PATIENCE: Duration = Duration::from_secs(10);
/// A light may take this long, and as long as its bytes take at the least rate.
const PATIENCE_FOR_ALL: Duration = Duration::from_secs(20);
const BYTES_PER_SECOND_MIN: f64 = 262_144.0;

/// A light that was announced.
#[derive(Debug)]
struct Announced {
    name: String,
    ending: String,
    up: EnvUp,
}

impl Announced {
    fn of(words: &HashMap<String, String>) -> Result<Self, Refusal> {
        let name = words.get("name").cloned().unwrap_or_default();
        let ending = output::ending(Path::new(&name)).unwrap_or_default();
        if !["hdr", "exr"].contains(&ending.as_str()) {
            return Err(bad(format!("{name:?} is no light; drop a lat-long map that ends in .hdr or .exr")));
        }
        let up = words.get("up").map_or(Ok(EnvUp::Scene), |word| EnvUp::from_str(word, false));
        let up = up.map_err(|_| bad("up is scene, y or z".into()))?;
        Ok(Self { name, ending, up })
    }
}

/// Takes a light that was dropped onto the page.
pub(super) async fn add_light(
    State(site): State<Arc<Site>>,
    Query(words): Query<HashMap<String, String>>,
    request: Request,
) -> Result<Response, Refusal> {
    if site.facts["shaded"] != true {
        return Err(bad("the scene is plain Gaussian splatting, whose colours hold their light for ever".into()));
    }
    let announced = Announced::of(&words)?;
    if length(request.headers()).is_some_and(|length| length > LIGHT_MAX) {
        return Err(too_large());
    }
    let turn = site.uploads.clone().try_acquire_owned().map_err(|_| {
        Refusal(StatusCode::SERVICE_UNAVAILABLE, "another light is being read; send this one in a moment".into())
    })?;
    let file = received(request.into_body(), &announced.ending, &site.arrivals).await?;
    let added = spawn_blocking(move || {
        let added = add(&site, &announced, &file);
        drop(turn);
        added
    });
    added.await.map_err(|error| Refusal(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()))?
}

fn length(headers: &HeaderMap) -> Option<usize> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

fn too_large() -> Refusal {
    let sentence = format!("the light is larger than {} MiB; make it smaller", LIGHT_MAX >> 20);
    Refusal(StatusCode::PAYLOAD_TOO_LARGE, sentence)
}

/// Longest time for so many bytes to come.
fn time_for(bytes: usize) -> Duration {
    PATIENCE_FOR_ALL + Duration::from_secs_f64(bytes as f64 / BYTES_PER_SECOND_MIN)
}

/// The bytes of a light, written to a file as they come: readers take files, and bound what they read by their size.
async fn received(mut body: Body, ending: &str, folder: &Path) -> Result<NamedTempFile, Refusal> {
    let no_room = |error: std::io::Error| {
        Refusal(StatusCode::INTERNAL_SERVER_ERROR, format!("there is no room for the light: {error}"))
    };
    let too_slow = |_| Refusal(StatusCode::REQUEST_TIMEOUT, "the light comes too slowly; send it again".into());
    let start = Instant::now();
    let mut file = tempfile::Builder::new().suffix(&format!(".{ending}")).tempfile_in(folder).map_err(no_room)?;
    let mut length = 0;
    loop {
        let frame = timeout_at(start + time_for(length), timeout(PATIENCE, body.frame())).await;
        let Some(frame) = frame.and_then(|frame| frame).map_err(too_slow)? else { return Ok(file) };
        let frame = frame.map_err(|error| bad(format!("the light did not come whole: {error}")))?;
        let Ok(bytes) = frame.into_data() else { continue };
        length += bytes.len();
        if length > LIGHT_MAX {
            return Err(too_large());
        }
        file.write_all(&bytes).map_err(no_room)?;
    }
}

fn add(site: &Site, Announced { name, up, .. }: &Announced, file: &NamedTempFile) -> Result<Response, Refusal> {
    let stem = output::stem(Path::new(name));
    // The name that was dropped says more than that of the file in between.
    let renamed = |sentence: &str| sentence.replace(&format!("{:?}", file.path()), &format!("{name:?}"));
    let named = |failure: Failure| bad(renamed(&failure.to_string()));
    let size = latlong::size(file.path()).map_err(|error| named(error.into()))?;
    if size.into_iter().map(u64::from).product::<u64>() > PIXELS_MAX {
        let [width, height] = size;
        return Err(bad(format!("{name:?} has {width} × {height} pixels; make it smaller, to 8192 × 4096 at most")));
    }
    let (label, notes) = site.lights.add(file.path(), &stem, *up).map_err(named)?;
    let notes: Vec<String> = notes.iter().map(|note| renamed(note)).collect();
    notes.iter().for_each(|note| tracing::info!("{note}"));
    Ok(json_of(&json!({"id": label.id, "name": label.name, "notes": notes})))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_has_to_come_at_a_least_rate() {
        let seconds = [0, 1 << 10, 1 << 20, LIGHT_MAX].map(|bytes| time_for(bytes).as_secs_f64());
        assert_eq!(seconds, [20.0, 20.003_906_25, 24.0, 276.0]);
    }
}
