//! Error responses and JSON responses.

use crate::ViewerError;
use axum::{
    extract::rejection::QueryRejection,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use core::{error::Error, fmt::Display};
use serde_json::Value;
use specula_cpu::CpuError;
use specula_scene::SceneError;

/// Delay in seconds before clients repeat a request to a busy server.
const RETRY_AFTER: HeaderValue = HeaderValue::from_static("1");

/// Response to a failed request: a status and a message in one sentence.
#[derive(Debug)]
pub(crate) struct HttpError {
    status: StatusCode,
    pub(crate) message: String,
}

impl HttpError {
    pub(crate) fn new(status: StatusCode, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    /// 400 Bad Request.
    pub(crate) fn bad_request(message: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, message)
    }

    /// 500 Internal Server Error.
    pub(crate) fn internal(error: impl Display) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, error.to_string())
    }

    /// 503 Service Unavailable, with the delay before clients try again.
    pub(crate) fn busy(message: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, message)
    }
}

impl IntoResponse for HttpError {
    fn into_response(self) -> Response {
        let mut response = (self.status, self.message).into_response();
        if self.status == StatusCode::SERVICE_UNAVAILABLE {
            response.headers_mut().insert(header::RETRY_AFTER, RETRY_AFTER);
        }
        response
    }
}

impl From<ViewerError> for HttpError {
    fn from(error: ViewerError) -> Self {
        match &error {
            ViewerError::Request(_)
            | ViewerError::Scene(
                SceneError::File(_) | SceneError::Cpu(CpuError::LightResolution { .. } | CpuError::TooManySplats),
            ) => Self::bad_request(error.to_string()),
            _ => Self::internal(error),
        }
    }
}

impl From<QueryRejection> for HttpError {
    fn from(rejection: QueryRejection) -> Self {
        // The error of serde names the parameter; the rejection prefixes it with a general message.
        let message = rejection.source().map_or_else(|| rejection.body_text(), ToString::to_string);
        Self::bad_request(message)
    }
}

/// JSON response.
pub(crate) fn json_response(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}
