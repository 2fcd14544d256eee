//! What is served: the page, facts about the scene, pictures, lights.

use super::{
    guard::{Denied, Guard},
    lights::Lights,
    live::Live,
    queue::{Queue, Refused},
    request::{Ask, Packing, Words},
    studio::Shot,
};
use crate::{args::EnvUp, failure::Failure, interrupt, output, progress::Talk};
use axum::{
    Router,
    body::Bytes,
    extract::{DefaultBodyLimit, Query, Request, State, rejection::BytesRejection},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};
use clap::ValueEnum;
use core::{net::SocketAddr, time::Duration};
use serde_json::{Value, json};
use specula_io::picture;
use std::{collections::HashMap, io::Write, path::Path, sync::Arc};
use tokio::{net::TcpListener, sync::oneshot, task::spawn_blocking};

/// Bytes of a light that comes in, at most.
const LIGHT_MAX: usize = 64 << 20;
/// How often it is looked whether an end was asked for.
const PATIENCE: Duration = Duration::from_millis(100);
/// Quality of the preview of a light.
const PREVIEW_QUALITY: u8 = 85;
/// The page asks for nothing from outside, and nothing may show it inside of itself.
const POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'";

/// The files of the page: name, kind, text.
const FILES: [(&str, &str, &str); 9] = [
    ("/", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("/style.css", "text/css; charset=utf-8", include_str!("page/style.css")),
    ("/main.js", SCRIPT, include_str!("page/main.js")),
    ("/camera.js", SCRIPT, include_str!("page/camera.js")),
    ("/controls.js", SCRIPT, include_str!("page/controls.js")),
    ("/stream.js", SCRIPT, include_str!("page/stream.js")),
    ("/light.js", SCRIPT, include_str!("page/light.js")),
    ("/path.js", SCRIPT, include_str!("page/path.js")),
    ("/training.js", SCRIPT, include_str!("page/training.js")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// A picture that is wanted, and who waits for it.
#[derive(Debug)]
pub(super) struct Job {
    pub(super) ask: Ask,
    pub(super) reply: oneshot::Sender<Result<Shot, Failure>>,
}

/// What the server hands out.
#[derive(Debug)]
pub(super) struct Site {
    pub(super) guard: Guard,
    pub(super) queue: Arc<Queue<Job>>,
    pub(super) lights: Arc<Lights>,
    /// What does not change: name, layers, views, where to begin.
    pub(super) facts: Value,
    /// The training that is watched.
    pub(super) live: Option<Arc<Live>>,
    pub(super) talk: Talk,
}

/// Why a request is not answered as it was meant.
#[derive(Debug)]
struct Refusal(StatusCode, String);

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, self.1).into_response()
    }
}

impl From<Failure> for Refusal {
    fn from(failure: Failure) -> Self {
        let status = match failure {
            Failure::File(_) | Failure::Input(_) => StatusCode::BAD_REQUEST,
            _ => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self(status, failure.to_string())
    }
}

fn bad(sentence: String) -> Refusal {
    Refusal(StatusCode::BAD_REQUEST, sentence)
}

/// Takes an address; the next free port where none is named (0).
pub(super) async fn listen(address: SocketAddr) -> Result<TcpListener, Failure> {
    TcpListener::bind(address).await.map_err(|error| {
        Failure::Input(format!(
            "cannot listen at {address}: {error}; choose another address or port, or port 0 for any"
        ))
    })
}

/// Serves until an end is asked for.
pub(super) async fn serve(listener: TcpListener, site: Arc<Site>) -> Result<(), Failure> {
    let server = tokio::spawn(async move { axum::serve(listener, router(site)).await });
    while !interrupt::is_requested() && !server.is_finished() {
        tokio::time::sleep(PATIENCE).await;
    }
    if !server.is_finished() {
        server.abort();
        return Ok(());
    }
    match server.await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(Failure::Internal(format!("the server ended: {error}"))),
        Err(error) => Err(Failure::Internal(format!("the server ended: {error}"))),
    }
}

fn router(site: Arc<Site>) -> Router {
    let mut router = Router::new()
        .route("/scene", get(scene))
        .route("/frame", get(frame))
        .route("/light", get(preview).post(add_light))
        .route("/training", get(training).post(steer));
    for (name, kind, text) in FILES {
        router = router.route(name, get(move || async move { ([(header::CONTENT_TYPE, kind)], text) }));
    }
    router
        .layer(DefaultBodyLimit::max(LIGHT_MAX))
        .layer(middleware::from_fn_with_state(site.clone(), guarded))
        .with_state(site)
}

/// Checks who asks, and says what the page may do.
async fn guarded(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    let is_page = FILES.iter().any(|(name, ..)| *name == request.uri().path());
    let mut response = match site.guard.check(request.headers(), is_page) {
        Ok(()) => next.run(request).await,
        Err(denied @ Denied::Token) => Refusal(StatusCode::UNAUTHORIZED, denied.sentence().into()).into_response(),
        Err(denied) => Refusal(StatusCode::FORBIDDEN, denied.sentence().into()).into_response(),
    };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

type Named = Query<HashMap<String, String>>;

async fn scene(State(site): State<Arc<Site>>) -> Response {
    let mut facts = site.facts.clone();
    facts["lights"] =
        site.lights.labels().into_iter().map(|label| json!({"id": label.id, "name": label.name})).collect();
    facts["live"] = site.live.is_some().into();
    json_of(&facts)
}

fn json_of(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

async fn frame(State(site): State<Arc<Site>>, Query(words): Named) -> Result<Response, Refusal> {
    let words = Words(words);
    let (ask, packing, client) = (words.ask(), words.packing(), words.client());
    let (ask, packing, client) = (ask.map_err(bad)?, packing.map_err(bad)?, client.map_err(bad)?);
    let (reply, answer) = oneshot::channel();
    site.queue.push(client, Job { ask, reply }).map_err(refused)?;
    // Who is overtaken by a later request of the same client has asked for nothing any more.
    let overtaken = || Refusal(StatusCode::CONFLICT, "the same client has asked for another picture since".into());
    let shot = answer.await.map_err(|_| overtaken())??;
    let iteration = site.live.as_ref().map(|live| live.iteration_shown());
    let packed = spawn_blocking(move || packed(&shot, packing, iteration)).await;
    packed.map_err(|error| Refusal(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()))
}

fn refused(refused: Refused) -> Refusal {
    let words = match refused {
        Refused::Full => "too many pictures are waiting; ask again in a moment",
        Refused::Closed => "nothing is rendered any more; start specula again",
    };
    Refusal(StatusCode::SERVICE_UNAVAILABLE, words.into())
}

/// A picture as it is sent, with what is known about it.
fn packed(shot: &Shot, packing: Packing, iteration: Option<u32>) -> Response {
    let start = std::time::Instant::now();
    let (kind, bytes) = match packing {
        Packing::Png => ("image/png", picture::to_png(&shot.picture)),
        Packing::Jpeg(quality) => ("image/jpeg", picture::to_jpeg(&shot.picture, quality)),
    };
    let [render, pack] = [shot.time, start.elapsed()].map(|time| time.as_secs_f64() * 1e3);
    let mut headers = HeaderMap::new();
    let mut tell = |name: &'static str, word: String| {
        if let Ok(word) = HeaderValue::from_str(&word) {
            headers.insert(name, word);
        }
    };
    tell("content-type", kind.to_owned());
    tell("server-timing", format!("render;dur={render:.1}, pack;dur={pack:.1}"));
    if let Some(view) = &shot.view {
        tell("x-view", view.clone());
    }
    if let Some(psnr) = shot.psnr {
        tell("x-psnr", format!("{psnr:.2}"));
    }
    if let Some(iteration) = iteration {
        tell("x-iteration", iteration.to_string());
    }
    (headers, bytes).into_response()
}

/// A light as a small picture.
async fn preview(State(site): State<Arc<Site>>, Query(words): Named) -> Result<Response, Refusal> {
    let ask = Words(words).light().map_err(bad)?;
    let made = spawn_blocking(move || site.lights.preview(ask)).await;
    let map = made.map_err(|error| Refusal(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()))?;
    let map = map.ok_or_else(|| Refusal(StatusCode::NOT_FOUND, "there is no such light".into()))?;
    let bytes = picture::to_jpeg(&picture::tone_map_latlong(&map), PREVIEW_QUALITY);
    Ok(([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response())
}

/// Takes a light that was dropped onto the page.
async fn add_light(
    State(site): State<Arc<Site>>,
    Query(words): Named,
    body: Result<Bytes, BytesRejection>,
) -> Result<Response, Refusal> {
    let body = body.map_err(|_| {
        let sentence = format!("the light is larger than {} MiB; make it smaller", LIGHT_MAX >> 20);
        Refusal(StatusCode::PAYLOAD_TOO_LARGE, sentence)
    })?;
    if site.facts["shaded"] != true {
        return Err(bad("the scene is plain Gaussian splatting, whose colours hold their light for ever".into()));
    }
    let name = words.get("name").cloned().unwrap_or_default();
    let up = words.get("up").map_or(Ok(EnvUp::Scene), |word| EnvUp::from_str(word, false));
    let up = up.map_err(|_| bad("up is scene, y or z".into()))?;
    let added = spawn_blocking(move || add(&site, &name, up, &body)).await;
    added.map_err(|error| Refusal(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()))?
}

/// Readers take files, which they also bound by: so the bytes become one for a moment.
fn add(site: &Site, name: &str, up: EnvUp, bytes: &[u8]) -> Result<Response, Refusal> {
    let file_name = Path::new(name);
    let ending = output::ending(file_name).unwrap_or_default();
    if !["hdr", "exr"].contains(&ending.as_str()) {
        return Err(bad(format!("{name:?} is no light; drop a lat-long map that ends in .hdr or .exr")));
    }
    let stem = file_name.file_stem().unwrap_or_default().to_string_lossy();
    let written = tempfile::Builder::new().suffix(&format!(".{ending}")).tempfile().and_then(|mut file| {
        file.write_all(bytes)?;
        Ok(file)
    });
    let file = written.map_err(|error| {
        Refusal(StatusCode::INTERNAL_SERVER_ERROR, format!("there is no room for the light: {error}"))
    })?;
    let label = site.lights.add(file.path(), &stem, up, site.talk).map_err(|failure| {
        // The name that was dropped says more than that of the file in between.
        bad(failure.to_string().replace(&format!("{:?}", file.path()), &format!("{name:?}")))
    })?;
    Ok(json_of(&json!({"id": label.id, "name": label.name})))
}

/// How far the training has come.
async fn training(State(site): State<Arc<Site>>) -> Result<Response, Refusal> {
    site.live.as_ref().map(|live| json_of(&live.report())).ok_or_else(no_training)
}

/// Pauses the training, has it go on, or take some steps.
async fn steer(State(site): State<Arc<Site>>, Query(words): Named) -> Result<Response, Refusal> {
    let live = site.live.as_ref().ok_or_else(no_training)?;
    let words = Words(words);
    let steps = words.or("steps", 1).map_err(bad)?;
    match words.0.get("do").map(String::as_str) {
        Some("pause") => live.pause(),
        Some("go") => live.go(),
        Some("step") => live.step(steps),
        _ => return Err(bad("do is pause, go or step".into())),
    }
    Ok(json_of(&live.report()))
}

fn no_training() -> Refusal {
    Refusal(StatusCode::NOT_FOUND, "nothing is being trained; specula train --view shows a training".into())
}
