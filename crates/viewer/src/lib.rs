//! Viewer of scenes in a browser: an HTTP server that renders pictures on request, and its page.
//!
//! A thread owns the scene on its executor and renders one picture after another; the server sends
//! them to any number of clients. A request describes its picture in full, so clients do not
//! disturb each other, and a client requests the next picture after it has received the last one,
//! so the rate adapts to the link. The page is a few modules of plain JavaScript that load nothing
//! from elsewhere.
//!
//! On the loopback interface, requests need one of its host names and the page's own origin; on
//! other addresses they need an access token. Connections, headers, bodies, times and memory are
//! bounded.
//!
//! ```no_run
//! use specula_scene::OpenedModel;
//! use specula_viewer::{ViewedScene, Viewer, ViewerOptions};
//! use std::path::Path;
//!
//! let model = OpenedModel::open(Path::new("out/vase"))?;
//! let scene = ViewedScene::of_model("vase", model)?;
//! let viewer = Viewer::bind(&ViewerOptions::default(), scene, None)?;
//! println!("{}", viewer.urls().join("\n"));
//! viewer.serve(|| false)?;
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```
//!
//! A training is watched through a [`LiveTraining`], which both sides share.
//!
//! Without the feature `server`, which is on by default, an [`EmbeddedViewer`] answers the same
//! requests within a program, and a [`WebPage`] is the page with a scene and a renderer in one
//! file.

#![cfg_attr(
    not(feature = "server"),
    expect(dead_code, reason = "only a server uses all parameters of requests and statuses of errors")
)]

#[cfg(feature = "server")]
mod connections;
mod embedded;
mod error;
#[cfg(feature = "server")]
mod guard;
mod http;
mod lights;
#[cfg(feature = "server")]
mod live;
mod new_light;
mod packed;
mod page;
#[cfg(feature = "server")]
mod queue;
#[cfg(feature = "server")]
mod render_thread;
mod request;
#[cfg(feature = "server")]
mod routes;
#[cfg(feature = "server")]
mod server;
mod setup;
#[cfg(feature = "server")]
mod state;
#[cfg(feature = "server")]
mod upload;
#[cfg(feature = "server")]
mod url;
mod viewed;
#[cfg(feature = "server")]
mod viewer;
mod views;
mod worker;

pub use embedded::{EmbeddedViewer, PlannedFrame, ShownFrame};
pub use error::ViewerError;
#[cfg(feature = "server")]
pub use live::{LiveTraining, Request};
pub use packed::{PackPrecision, PackedLight, PackedScene};
pub use page::{TEXT_READER, WebPage, WebRenderer, text_of};
pub use setup::{LightSetup, SetupEnvironment};
pub use specula_scene::light_file::MapUp;
pub use viewed::ViewedScene;
#[cfg(feature = "server")]
pub use viewer::{AddedLight, Viewer, ViewerOptions, ViewerThread};
pub use views::PhotographSource;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
