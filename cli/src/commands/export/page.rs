//! Pages of `specula export`: a scene and its renderer for a browser.

use super::Exporter;
use crate::{
    args::Export,
    failure::Failure,
    lights::NamedLights,
    output, progress,
    scene::{read_env, refuse_plain},
};
use specula_core::{
    rules::Channels,
    scene::{Environment, RadianceActivation},
};
use specula_io::{latlong, picture};
use specula_scene::{
    Scene, SceneRenderer, export::visible, light_file::MapUp, number::group_digits, orientation, text::shown,
};
use specula_viewer::{
    EmbeddedViewer, LightSetup, PackPrecision, PackedLight, PackedScene, ViewedScene, WebPage, WebRenderer,
};
use std::path::{Path, PathBuf};

/// Renderer of pages, from `scripts/build-web`.
const RENDERER: WebRenderer<'_> = WebRenderer {
    script: include_str!("../../../data/renderer/specula_web.js"),
    module: include_bytes!("../../../data/renderer/specula_web_bg.wasm.gz"),
};
/// Longer edge of the still picture, in pixels.
const STILL_EDGE: u32 = 960;
/// JPEG quality of the still picture.
const STILL_QUALITY: u8 = 85;

impl Exporter<'_> {
    /// Writes a page as a file, or as a folder.
    pub(super) fn write_page(&self, path: &Path, is_folder: bool) -> Result<(), Failure> {
        let precision = if self.args.page_exact { PackPrecision::Exact } else { PackPrecision::Quantised };
        let PageLight { scene, maps, exposure, setup } = self.page.as_ref().expect("a page is requested");
        let kept = visible(&scene.gaussians, self.args.min_opacity);
        let (viewed, lights) = (self.viewed(scene.kept(&kept))?, self.page_lights(maps, *exposure)?);
        let count = viewed.scene.gaussians.count;
        let mut packed = PackedScene { viewed, lights, setup: setup.clone(), caption: String::new() };
        let stored = PackedScene::unpack(&packed.pack(precision))?;
        let error = self.page_error(&packed.viewed.scene, &stored.viewed.scene, precision)?;
        packed.caption = self.caption(count, &error);
        let still = self.still(stored)?;
        let page = WebPage::new(RENDERER, &packed, precision, still);
        let files = if is_folder {
            page.folder().map(|(name, contents)| (path.join(name), contents)).into()
        } else {
            vec![(path.to_owned(), page.file().into_bytes())]
        };
        files.iter().try_for_each(|(file, contents)| output::write_bytes(file, contents))?;
        let bytes: usize = files.iter().map(|(_, contents)| contents.len()).sum();
        let (path, count, bytes) = (shown(path), group_digits(count), group_digits(bytes));
        output::say(&format!("{path}: page, {count} Gaussians, {bytes} bytes; {error}"))
    }

    fn viewed(&self, scene: Scene) -> Result<ViewedScene, Failure> {
        Ok(ViewedScene {
            name: output::name_of_model(&self.args.model),
            scene,
            views: self.opened.cameras()?,
            held_out: self.opened.test_views().unwrap_or(0),
            origin: self.opened.origin,
            orientation: self.opened.orientation(self.args.scene_options.scene_up.map(Into::into))?,
            photographs: None,
            background: self.background.0,
        })
    }

    /// Environment maps to choose from.
    fn page_lights(&self, maps: &[(PathBuf, MapUp)], exposure: f32) -> Result<Vec<PackedLight>, Failure> {
        let up = orientation::up(&self.up);
        let resolution = self.scene().resolution_of_others();
        let read = |(file, map_up): &(PathBuf, MapUp)| {
            let map_up = *map_up;
            let map = read_env(file, exposure)?;
            let values = latlong::to_cube(&map, resolution, map_up.orientation(up));
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let cube = Environment { resolution, activation: RadianceActivation::Identity, values };
            Ok(PackedLight { name, up: map_up, cube })
        };
        maps.iter().map(read).collect()
    }

    /// Sentence on the error of the stored numbers.
    fn page_error(&self, scene: &Scene, stored: &Scene, precision: PackPrecision) -> Result<String, Failure> {
        if precision == PackPrecision::Exact {
            return Ok("lossless".to_owned());
        }
        let rounded = "stored numbers are rounded";
        if self.args.no_error {
            return Ok(rounded.to_owned());
        }
        let references = self.references_of(scene.clone())?;
        let work = progress::work("comparing", references.count() as u64);
        let error = references.compare_scene(stored.clone(), None, |done| work.done(done as u64, String::new))?;
        work.finish();
        Ok(format!("{rounded}; {error}"))
    }

    fn caption(&self, count: usize, error: &str) -> String {
        let layout = self.scene().gaussians.layout;
        let kind = match (layout.is_physical, layout.is_shaded()) {
            (true, _) => "physical materials, relightable",
            (false, true) => "a shading function, relightable",
            (false, false) => "plain Gaussian splatting",
        };
        let version = env!("CARGO_PKG_VERSION");
        format!("{} Gaussians, {kind}; {error}. Made by specula {version}.", group_digits(count))
    }

    /// First picture of the page as a JPEG.
    fn still(&self, packed: PackedScene) -> Result<Vec<u8>, Failure> {
        let options = self.options();
        let mut viewer = EmbeddedViewer::new(packed, |scene| SceneRenderer::new(scene, Channels::Layers, &options))?;
        Ok(picture::to_jpeg(&viewer.first_picture(STILL_EDGE)?, STILL_QUALITY))
    }
}

/// Lights of a page, and the scene under its own.
pub(super) struct PageLight {
    scene: Scene,
    /// Environment maps, the first one first.
    maps: Vec<(PathBuf, MapUp)>,
    /// Exposure of the maps in stops, in addition to that of the page.
    exposure: f32,
    setup: LightSetup,
}

impl PageLight {
    /// Lights that the arguments name, for a scene under its own light.
    pub(super) fn new(args: &Export, scene: Scene, lights: NamedLights) -> Result<Self, Failure> {
        let up = args.env_options.env_up.into();
        let named = lights.env.clone().map(|map| (map, lights.up(up)));
        let first = args.env.clone().map(|map| (map, up)).or(named);
        let mut setup = lights.setup(first.as_ref().map(|_| 1), &args.first);
        let mut exposure = args.env_options.exposure;
        if first.is_some() {
            // The page starts with it.
            setup.exposure += exposure;
            exposure = 0.0;
        }
        let maps: Vec<_> = first.into_iter().chain(args.page_env.iter().map(|map| (map.clone(), up))).collect();
        if !maps.is_empty() {
            refuse_plain(&scene)?;
        }
        Ok(Self { scene, maps, exposure, setup })
    }
}
