//! Routes: the page, the scene's description, pictures, lights, and control of a training.

use crate::{
    guard::Denied,
    http::{HttpError, json_response},
    live::LiveTraining,
    page::FILES,
    request::{Action, ClientParameter, Encoding, FrameRequest, SteeringParameters, query},
    state::ServerState,
    upload,
    viewed::described,
    worker::Frame,
};
use axum::{
    Router,
    extract::{Request, State},
    http::{HeaderMap, HeaderValue, StatusCode, Uri, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};
use core::time::Duration;
use serde_json::json;
use specula_io::picture;
use std::{sync::Arc, time::Instant};
use tokio::task::spawn_blocking;

/// Content security policy: the page loads nothing from other origins and cannot be framed.
const POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'";

/// Extension of responses to authorised requests.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Authorised;

/// Service of all routes, behind the guard.
pub(crate) fn router(state: Arc<ServerState>) -> Router {
    let mut router = Router::new()
        .route("/scene", get(scene))
        .route("/frame", get(frame))
        .route("/point", get(point))
        .route("/light", get(preview).post(upload::add_light))
        .route("/training", get(training).post(steer));
    for (path, content_type, text) in FILES {
        router = router.route(path, get(move || async move { ([(header::CONTENT_TYPE, content_type)], text) }));
    }
    router.layer(middleware::from_fn_with_state(state.clone(), guarded)).with_state(state)
}

/// Checks the headers of a request before reading its body, and sets those of the response.
async fn guarded(State(state): State<Arc<ServerState>>, request: Request, next: Next) -> Response {
    let is_page = FILES.iter().any(|(path, ..)| *path == request.uri().path());
    let mut response = match state.guard.check(request.headers(), is_page) {
        Ok(()) => authorised(next.run(request).await, is_page),
        Err(denied @ Denied::Token) => HttpError::new(StatusCode::UNAUTHORIZED, denied.message()).into_response(),
        Err(denied) => HttpError::new(StatusCode::FORBIDDEN, denied.message()).into_response(),
    };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    response
}

/// Marks a response as authorised, except for files of the page, which need no token.
fn authorised(mut response: Response, is_page: bool) -> Response {
    if !is_page {
        response.extensions_mut().insert(Authorised);
    }
    response
}

/// Description of the scene, its lights, and whether a light is being read.
async fn scene(State(state): State<Arc<ServerState>>) -> Response {
    let mut description = described(&state.description, &state.lights, &state.setup());
    description["live"] = state.live.is_some().into();
    description["reading"] = state.is_reading().into();
    json_response(&description)
}

/// Picture of the scene.
async fn frame(State(state): State<Arc<ServerState>>, uri: Uri) -> Result<Response, HttpError> {
    let (request, encoding) = (FrameRequest::of_frame(&uri)?, Encoding::of(&uri)?);
    let ClientParameter { client } = query(&uri)?;
    let (frame, time) = state.render(client, request).await?;
    let iteration = state.live.as_ref().map(|live| live.iteration_shown());
    let encoded = spawn_blocking(move || encoded(&frame, time, encoding, iteration)).await;
    let (headers, bytes) = encoded.map_err(HttpError::internal)?;
    Ok((headers, state.sent(bytes)?).into_response())
}

/// Point of the scene at a position of a picture.
async fn point(State(state): State<Arc<ServerState>>, uri: Uri) -> Result<Response, HttpError> {
    let request = FrameRequest::of_point(&uri)?;
    let ClientParameter { client } = query(&uri)?;
    Ok(json_response(&json!({"point": state.render(client, request).await?.0.point})))
}

/// Encodes a picture, with its times and contents in the headers.
fn encoded(frame: &Frame, time: Duration, encoding: Encoding, iteration: Option<u32>) -> (HeaderMap, Vec<u8>) {
    let start = Instant::now();
    let (content_type, bytes) = match encoding {
        Encoding::Png => ("image/png", picture::to_png(&frame.picture)),
        Encoding::Jpeg(quality) => ("image/jpeg", picture::to_jpeg(&frame.picture, quality)),
    };
    let [render, pack] = [time, start.elapsed()].map(|time| time.as_secs_f64() * 1e3);
    let mut headers = HeaderMap::new();
    let mut insert = |name: &'static str, value: String| {
        if let Ok(value) = HeaderValue::from_str(&value) {
            headers.insert(name, value);
        }
    };
    insert("content-type", content_type.to_owned());
    insert("server-timing", format!("render;dur={render:.1}, pack;dur={pack:.1}"));
    if let Some(view) = &frame.view {
        insert("x-view", view.clone());
    }
    if let Some(psnr) = frame.psnr {
        insert("x-psnr", format!("{psnr:.2}"));
    }
    if let Some(iteration) = iteration {
        insert("x-iteration", iteration.to_string());
    }
    (headers, bytes)
}

/// Preview of a light.
async fn preview(State(state): State<Arc<ServerState>>, uri: Uri) -> Result<Response, HttpError> {
    let setting = query(&uri)?;
    let bytes = spawn_blocking(move || state.lights.preview(setting)).await.map_err(HttpError::internal)?;
    let bytes = bytes.ok_or_else(|| HttpError::new(StatusCode::NOT_FOUND, "no light with this number"))?;
    Ok(([(header::CONTENT_TYPE, "image/jpeg")], bytes).into_response())
}

/// Progress of the training.
async fn training(State(state): State<Arc<ServerState>>) -> Result<Response, HttpError> {
    Ok(json_response(&live_training(&state)?.report()))
}

/// Pauses, resumes or steps the training.
async fn steer(State(state): State<Arc<ServerState>>, uri: Uri) -> Result<Response, HttpError> {
    let live = live_training(&state)?;
    let SteeringParameters { action, steps } = query(&uri)?;
    match action {
        Action::Pause => live.pause(),
        Action::Go => live.resume(),
        Action::Step => live.step(steps),
    }
    Ok(json_response(&live.report()))
}

fn live_training(state: &ServerState) -> Result<&LiveTraining, HttpError> {
    state.live.as_deref().ok_or_else(|| HttpError::new(StatusCode::NOT_FOUND, "there is no training to watch"))
}
