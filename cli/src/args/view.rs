//! Arguments of `specula view`.

use super::{
    lights::FirstLights,
    parse::{address, token},
    scene::{EnvUp, OwnLightOption, SceneOptions},
};
use clap::Args;
use core::net::SocketAddr;
use specula_scene::backdrop::BackgroundColor;
use std::path::PathBuf;

/// Default address of the page.
pub(crate) const ADDRESS: &str = "127.0.0.1:7008";

/// Explore a scene in a browser.
///
/// Serves a page until Ctrl-C and prints its address. Pictures are rendered on this machine and
/// sent on demand; on phones and slow connections they become smaller while the camera moves. Drag
/// to rotate, scroll or pinch to zoom, press ? for all keys. Keys 1 to 0 select layers. An
/// environment map (.hdr, .exr) can be dropped onto the page and rotated by dragging. Camera paths
/// can be recorded and rendered to a ZIP file of frames. Suns and lamps light models of
/// --relightable; they are added and dragged on the page. The page starts under the light of the
/// scene, or under the first map of --env with the suns and lamps of --sun, --lamp and --lights.
///
/// The page is only reachable from this machine, unless --listen names another address. It then
/// requires a token, which is part of the printed address. Connections are not encrypted: in
/// untrusted networks, use ssh -L 7008:localhost:7008 instead.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  specula view out/chair
  specula view out/spheres --env sunset forest
  specula view scene.ply --background white
  specula view out/spheres --sun 30,45 --lamp 1,0,2,5   # materials under a sun and a lamp
  specula view out/chair --listen 0.0.0.0:7008    # from a phone in the same network
  specula train data/chair -m out/chair --view    # a scene during its training")]
pub(crate) struct View {
    /// Model folder, .ply, .glb, .spz or .splat file.
    #[arg(value_name = "SCENE")]
    pub(crate) scene: PathBuf,
    /// Address to listen on; port 0 selects a free one.
    #[arg(long, alias = "port", value_name = "[HOST:]PORT", default_value = ADDRESS, value_parser = address)]
    pub(crate) listen: SocketAddr,
    /// Access token; generated when listening beyond loopback.
    #[arg(long, value_name = "WORD", value_parser = token)]
    pub(crate) token: Option<String>,
    /// Environment maps to choose from, in addition to the light of the scene: lat-long files, .hdr
    /// or .exr; or sunset, forest or workshop, which the program contains.
    #[arg(long, value_name = "FILE|NAME", num_args = 1..)]
    pub(crate) env: Vec<PathBuf>,
    /// Up direction of these files: that of the scene, or an axis of the world.
    #[arg(long, value_enum, default_value_t = EnvUp::Scene)]
    pub(crate) env_up: EnvUp,
    /// The page starts under the first map of --env, else that of --lights, with these suns and
    /// lamps; suns and lamps without a map are the only light, as with relight.
    #[command(flatten)]
    pub(crate) first: FirstLights,
    /// Background; by default that of the training, else black.
    #[arg(long, value_name = "black|white|R,G,B")]
    pub(crate) background: Option<BackgroundColor>,
    #[command(flatten)]
    pub(crate) light: OwnLightOption,
    #[command(flatten)]
    pub(crate) scene_options: SceneOptions,
}
