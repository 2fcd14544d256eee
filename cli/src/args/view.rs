//! Arguments of `specula view`.

use super::{
    parse::{address, token},
    scene::{EnvUp, Showing},
};
use crate::background::Background;
use clap::Args;
use core::net::SocketAddr;
use std::path::PathBuf;

/// Default address of the page.
pub(crate) const ADDRESS: &str = "127.0.0.1:7008";

/// Look around in a scene, in a browser.
///
/// Serves a page at an address that goes to stdout, until Ctrl-C. Pictures are rendered here and sent as they are asked
/// for: open it on a phone or over a slow link, and they become smaller while one moves. Drag to turn, scroll or pinch
/// to come closer, press ? for all keys. Layers are chosen with 1 to 0; a lat-long map of light (.hdr, .exr) can be dropped
/// onto the page, and dragged to be turned; the camera can be sent along a path, whose frames come as a ZIP file.
///
/// Only this machine can open the page, unless --listen names an address that others reach. Then whoever opens it needs
/// a token, which is part of the address that is printed. Nothing is encrypted: over a network that is not trusted, use
/// ssh -L 7008:localhost:7008 instead.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula view out/chair
  specula view out/spheres --env sunset.hdr forest.hdr
  specula view scene.ply --background white
  specula view out/chair --listen 0.0.0.0:7008      for a phone in the same network
  specula train data/chair -m out/chair --view      a scene while it is trained")]
pub(crate) struct View {
    /// Folder of a model, or a PLY file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// Address of the page; port 0 takes any that is free.
    #[arg(long, value_name = "[HOST:]PORT", default_value = ADDRESS, value_parser = address)]
    pub(crate) listen: SocketAddr,
    /// Password of the page; by default a random one where other machines can reach it, else none.
    #[arg(long, value_name = "WORD", value_parser = token)]
    pub(crate) token: Option<String>,
    /// Lights to choose from, beside the scene's: lat-long maps, .hdr or .exr.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub(crate) env: Vec<PathBuf>,
    /// Direction of these files' upper edges: the scene's up, or an axis of the world.
    #[arg(long, value_enum, default_value_t = EnvUp::Scene)]
    pub(crate) env_up: EnvUp,
    /// Behind the scene; the training's background by default, else black.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<Background>,
    #[command(flatten)]
    pub(crate) showing: Showing,
}
