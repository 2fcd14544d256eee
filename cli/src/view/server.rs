//! What is served: the page, facts about the scene, pictures, lights.

use super::{
    connections::{Connections, Place},
    guard::{Denied, Guard},
    lights::Lights,
    live::Live,
    queue::{Queue, Refused},
    request::{Ask, Packing, Words},
    studio::Shot,
    upload,
};
use crate::{failure::Failure, interrupt};
use axum::{
    Router,
    body::Bytes,
    extract::{Query, Request, State},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};
use core::{net::SocketAddr, time::Duration};
use hyper::{
    body::Incoming,
    server::conn::http1,
    service::{Service, service_fn},
};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use serde_json::{Value, json};
use specula_io::picture;
use std::{collections::HashMap, io, path::PathBuf, sync::Arc};
use tokio::{
    net::{TcpListener, TcpStream},
    sync::{OwnedSemaphorePermit, Semaphore, oneshot},
    task::spawn_blocking,
};

/// How often it is looked whether an end was asked for.
const PATIENCE: Duration = Duration::from_millis(100);
/// Within this time a connection says what it asks for, from its start or its last answer on.
const PATIENCE_FOR_HEADERS: Duration = Duration::from_secs(15);
/// Bytes of the headers of a request, at most.
const HEADERS_MAX: usize = 16 << 10;
/// A pause when the system has no descriptor or memory for another connection.
const PAUSE: Duration = Duration::from_millis(500);
/// KiB of pictures that are being sent, at most.
const SENDING_MAX: usize = 256 << 10;
/// Seconds after which a client that is refused for now asks again.
const RETRY_AFTER: HeaderValue = HeaderValue::from_static("1");
/// Quality of the preview of a light.
const PREVIEW_QUALITY: u8 = 85;
/// The page asks for nothing from outside, and nothing may show it inside of itself.
const POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'";

/// The files of the page: name, kind, text.
const FILES: [(&str, &str, &str); 10] = [
    ("/", "text/html; charset=utf-8", include_str!("page/index.html")),
    ("/style.css", "text/css; charset=utf-8", include_str!("page/style.css")),
    ("/address.js", SCRIPT, include_str!("page/address.js")),
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
    /// The turn of the light that is being read.
    pub(super) uploads: Arc<Semaphore>,
    /// The folder in which lights are while they come in.
    pub(super) arrivals: PathBuf,
    /// Room for pictures that are being sent, in KiB.
    pub(super) sending: Arc<Semaphore>,
}

impl Site {
    /// One light is read at a time.
    pub(super) fn one_upload() -> Arc<Semaphore> {
        Arc::new(Semaphore::new(1))
    }

    /// Room for all pictures that are being sent.
    pub(super) fn room_for_sending() -> Arc<Semaphore> {
        Arc::new(Semaphore::new(SENDING_MAX))
    }
}

/// Why a request is not answered as it was meant.
#[derive(Debug)]
pub(super) struct Refusal(pub(super) StatusCode, pub(super) String);

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let mut response = (self.0, self.1).into_response();
        if self.0 == StatusCode::SERVICE_UNAVAILABLE {
            response.headers_mut().insert(header::RETRY_AFTER, RETRY_AFTER);
        }
        response
    }
}

/// Says of an answer that whoever asked was allowed to.
#[derive(Clone, Copy, Debug)]
struct Granted;

impl From<Failure> for Refusal {
    fn from(failure: Failure) -> Self {
        let status = match failure {
            Failure::File(_) | Failure::Input(_) => StatusCode::BAD_REQUEST,
            _ => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self(status, failure.to_string())
    }
}

pub(super) fn bad(sentence: String) -> Refusal {
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
    let connections = Arc::new(Connections::new());
    let server = tokio::spawn(accept(listener, connections.clone(), router(site)));
    while !interrupt::is_requested() && !server.is_finished() {
        connections.close_stale();
        tokio::time::sleep(PATIENCE).await;
    }
    if !server.is_finished() {
        server.abort();
        return Ok(());
    }
    server.await.map_err(|error| Failure::Internal(format!("the server ended: {error}")))
}

/// Takes connections for ever.
async fn accept(listener: TcpListener, connections: Arc<Connections>, router: Router) {
    loop {
        let (stream, peer) = match listener.accept().await {
            Ok(connection) => connection,
            Err(error) if is_of_connection(&error) => continue,
            Err(_) => {
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let Some(place) = connections.place(peer.ip()).await else { continue };
        let place = Arc::new(place);
        place.belongs_to(tokio::spawn(converse(stream, place.clone(), router.clone())).abort_handle());
    }
}

/// Whether an error is of a connection that went away, and not of the system.
fn is_of_connection(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}

/// Answers the requests of a connection. Its place is free only when its descriptor is: that is dropped first.
async fn converse(stream: TcpStream, place: Arc<Place>, router: Router) {
    let answers = TowerToHyperService::new(router);
    let service = service_fn(|request: hyper::Request<Incoming>| {
        place.begin();
        let answer = answers.call(request);
        let place = &place;
        async move {
            let answer = answer.await;
            place.end(answer.as_ref().is_ok_and(|answer| answer.extensions().get::<Granted>().is_some()));
            answer
        }
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(PATIENCE_FOR_HEADERS).max_buf_size(HEADERS_MAX);
    // A connection that breaks has nobody who could be told.
    let _ = http.serve_connection(TokioIo::new(stream), service).await;
}

fn router(site: Arc<Site>) -> Router {
    let mut router = Router::new()
        .route("/scene", get(scene))
        .route("/frame", get(frame))
        .route("/point", get(point))
        .route("/light", get(preview).post(upload::add_light))
        .route("/training", get(training).post(steer));
    for (name, kind, text) in FILES {
        router = router.route(name, get(move || async move { ([(header::CONTENT_TYPE, kind)], text) }));
    }
    router.layer(middleware::from_fn_with_state(site.clone(), guarded)).with_state(site)
}

/// Checks who asks, and says what the page may do.
async fn guarded(State(site): State<Arc<Site>>, request: Request, next: Next) -> Response {
    let is_page = FILES.iter().any(|(name, ..)| *name == request.uri().path());
    let mut response = match site.guard.check(request.headers(), is_page) {
        Ok(()) => granted(next.run(request).await, is_page),
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

fn granted(mut response: Response, is_page: bool) -> Response {
    if !is_page {
        response.extensions_mut().insert(Granted);
    }
    response
}

type Named = Query<HashMap<String, String>>;

async fn scene(State(site): State<Arc<Site>>) -> Response {
    let mut facts = site.facts.clone();
    facts["lights"] =
        site.lights.labels().into_iter().map(|label| json!({"id": label.id, "name": label.name})).collect();
    facts["live"] = site.live.is_some().into();
    facts["reading"] = (site.uploads.available_permits() == 0).into();
    json_of(&facts)
}

pub(super) fn json_of(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

async fn frame(State(site): State<Arc<Site>>, Query(words): Named) -> Result<Response, Refusal> {
    let words = Words(words);
    let (ask, packing, client) = (words.ask(), words.packing(), words.client());
    let (ask, packing, client) = (ask.map_err(bad)?, packing.map_err(bad)?, client.map_err(bad)?);
    let shot = shot(&site, client, ask).await?;
    let iteration = site.live.as_ref().map(|live| live.iteration_shown());
    let packed = spawn_blocking(move || packed(&shot, packing, iteration)).await;
    let (headers, bytes) = packed.map_err(|error| Refusal(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()))?;
    Ok((headers, sent(bytes, &site.sending)?).into_response())
}

/// The place that is seen at a point of a picture.
async fn point(State(site): State<Arc<Site>>, Query(words): Named) -> Result<Response, Refusal> {
    let words = Words(words);
    let (ask, client) = (words.point().map_err(bad)?, words.client().map_err(bad)?);
    Ok(json_of(&json!({"point": shot(&site, client, ask).await?.point})))
}

/// Waits until a picture is made.
async fn shot(site: &Site, client: u64, ask: Ask) -> Result<Shot, Refusal> {
    let (reply, answer) = oneshot::channel();
    site.queue.push(client, Job { ask, reply }).map_err(refused)?;
    // Who is overtaken by a later request of the same client has asked for nothing any more.
    let overtaken = || Refusal(StatusCode::CONFLICT, "the same client has asked for another picture since".into());
    Ok(answer.await.map_err(|_| overtaken())??)
}

/// A picture on its way, which takes room until the last byte of it was sent.
struct Sent {
    bytes: Vec<u8>,
    _room: OwnedSemaphorePermit,
}

impl AsRef<[u8]> for Sent {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// The bytes of a picture, where there is room for them beside all others that are being sent.
fn sent(bytes: Vec<u8>, room: &Arc<Semaphore>) -> Result<Bytes, Refusal> {
    let size = u32::try_from(bytes.len().div_ceil(1 << 10)).unwrap_or(u32::MAX);
    let room = room.clone().try_acquire_many_owned(size).map_err(|_| {
        let sentence = "too many pictures are on their way; ask again in a moment";
        Refusal(StatusCode::SERVICE_UNAVAILABLE, sentence.into())
    })?;
    Ok(Bytes::from_owner(Sent { bytes, _room: room }))
}

fn refused(refused: Refused) -> Refusal {
    let words = match refused {
        Refused::Full => "too many pictures are waiting; ask again in a moment",
        Refused::Closed => "nothing is rendered any more; start specula again",
    };
    Refusal(StatusCode::SERVICE_UNAVAILABLE, words.into())
}

/// A picture as it is sent, with what is known about it.
fn packed(shot: &Shot, packing: Packing, iteration: Option<u32>) -> (HeaderMap, Vec<u8>) {
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
    (headers, bytes)
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
