//! Pages of `specula export`: a scene and its renderer for a browser.

use super::Exporter;
use crate::{failure::Failure, output, progress, scene::read_env};
use specula_core::{
    rules::Channels,
    scene::{Environment, RadianceActivation},
};
use specula_io::{latlong, picture};
use specula_scene::{
    RenderOptions, Scene, SceneRenderer, export::visible, light_file::MapUp, number::group_digits, orbit::StartView,
    orientation, text::shown,
};
use specula_viewer::{PackPrecision, PackedLight, PackedScene, ViewedScene, WebPage, WebRenderer};
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
        let scene = self.page_scene();
        let count = scene.gaussians.count;
        let mut packed =
            PackedScene { viewed: self.viewed(scene)?, lights: self.page_lights()?, caption: String::new() };
        let error = self.page_error(&packed, precision)?;
        packed.caption = self.caption(count, &error);
        let still = self.still(&packed.viewed)?;
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

    /// Scene without invisible Gaussians.
    fn page_scene(&self) -> Scene {
        let scene = self.scene();
        let kept = visible(&scene.gaussians, self.args.min_opacity);
        scene.kept(&kept)
    }

    fn viewed(&self, scene: Scene) -> Result<ViewedScene, Failure> {
        Ok(ViewedScene {
            name: output::stem(Path::new(&output::absolute(&self.args.model))),
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
    fn page_lights(&self) -> Result<Vec<PackedLight>, Failure> {
        let up = orientation::up(&self.opened.orientation(self.args.scene_options.scene_up.map(Into::into))?);
        let resolution = self.scene().resolution_of_others();
        let map_up: MapUp = self.args.env_options.env_up.into();
        let read = |file: &PathBuf| {
            let map = read_env(file, self.args.env_options.exposure)?;
            let values = latlong::to_cube(&map, resolution, map_up.orientation(up));
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let cube = Environment { resolution, activation: RadianceActivation::Identity, values };
            Ok(PackedLight { name, up: map_up, cube })
        };
        self.args.page_env.iter().map(read).collect()
    }

    /// Sentence on the error of the packed numbers.
    fn page_error(&self, packed: &PackedScene, precision: PackPrecision) -> Result<String, Failure> {
        if precision == PackPrecision::Exact {
            return Ok("lossless".to_owned());
        }
        let rounded = "numbers are rounded";
        if self.args.no_error {
            return Ok(rounded.to_owned());
        }
        let references = self.references()?;
        let stored = PackedScene::unpack(&packed.pack(precision))?.viewed.scene;
        let work = progress::work("comparing", references.count() as u64);
        let error = references.compare_scene(stored, None, |done| work.done(done as u64, String::new))?;
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

    /// Picture of the first view as a JPEG.
    fn still(&self, viewed: &ViewedScene) -> Result<Vec<u8>, Failure> {
        let StartView { known, first, start, .. } = StartView::new(&viewed.orientation, viewed.views.clone());
        let camera = first.and_then(|first| known.get(first)).map_or(start, |(_, camera)| *camera);
        let camera = camera.limited(STILL_EDGE);
        let options: RenderOptions = self.options();
        let mut renderer = SceneRenderer::new(viewed.scene.clone(), Channels::Color, &options)?;
        Ok(picture::to_jpeg(&renderer.picture(&camera, viewed.background)?, STILL_QUALITY))
    }
}
