//! A scene on an executor, under any light that is asked for: where pictures for the page are made.

use super::{
    album::Album,
    lights::{Cube, Lights, OWN},
    request::{Ask, From, LightAsk, Pose, Show},
};
use crate::{
    args::MachineOptions,
    background::{Background, Behind},
    failure::Failure,
};
use core::time::Duration;
use specula_core::{
    camera::Camera,
    metrics::psnr,
    plan::Needs,
    rules::{Channels, RenderRules, channel},
    scene::{Image, Layout},
};
use specula_io::picture::{self, RgbImage};
use specula_scene::{
    Layer, Scene, SceneRenderer, ShadingModel,
    environment::{fitting, levels_of},
};
use specula_train::evaluate::{mean_squared_error, over_background};
use std::{sync::Arc, time::Instant};

/// Lights that are kept filtered: a few clients may each have their own.
const PLACES: usize = 6;
/// Errors from this on are shown in the brightest colour.
const ERROR_SHOWN_MAX: f32 = 0.25;

/// A picture that was made.
#[derive(Debug)]
pub(super) struct Shot {
    pub(super) picture: RgbImage,
    /// The view that it shows, if it is one of those that the scene knows.
    pub(super) view: Option<String>,
    /// How close it is to the photograph, where they were compared.
    pub(super) psnr: Option<f64>,
    /// The place that is seen at the point that was asked for.
    pub(super) point: Option<[f32; 3]>,
    pub(super) time: Duration,
}

/// A light that was filtered into a place of the machine, and the rules of pictures under it.
#[derive(Debug)]
struct Filtered {
    ask: LightAsk,
    place: usize,
    rules: [RenderRules; 3],
}

/// What pictures are made of, from the cheapest on.
const KINDS: [Channels; 3] = [Channels::Color, Channels::Training, Channels::Layers];

/// A scene that is looked at.
#[derive(Debug)]
pub(super) struct Studio {
    renderer: SceneRenderer,
    options: MachineOptions,
    layout: Layout,
    shading_model: ShadingModel,
    needs: Needs,
    lights: Arc<Lights>,
    /// That which was used last is last.
    filtered: Vec<Filtered>,
    album: Album,
    background: Background,
    near: f32,
}

impl Studio {
    /// Loads a scene where it was asked to be rendered. Its light is among the lights already.
    pub(super) fn new(
        scene: Scene,
        lights: Arc<Lights>,
        album: Album,
        background: Background,
        near: f32,
        options: MachineOptions,
    ) -> Result<Self, Failure> {
        let scene = scene.rounded(options.storage());
        let (layout, shading_model, needs) = (scene.gaussians.layout, scene.shading_model, Needs::of(&scene.gaussians));
        let renderer = SceneRenderer::without_light(scene, Channels::Layers, &(&options).into())?;
        let filtered = Vec::new();
        Ok(Self { renderer, options, layout, shading_model, needs, lights, filtered, album, background, near })
    }

    /// Shows another scene of the same training from now on.
    pub(super) fn put(&mut self, scene: Scene) -> Result<(), Failure> {
        let scene = scene.rounded(self.options.storage());
        self.needs = Needs::of(&scene.gaussians);
        self.renderer.set_gaussians(&scene.gaussians)?;
        self.lights.set_own(scene.light);
        self.filtered.clear();
        Ok(())
    }

    /// Filters the scene's own light, which takes longest the first time: before somebody waits for it.
    pub(super) fn warm_up(&mut self) {
        // What is wrong with it is told to who asks for a picture.
        let _ = self.filtered(LightAsk { id: OWN, turn: 0.0, stops: 0.0 });
    }

    /// Makes a picture.
    pub(super) fn shoot(&mut self, ask: &Ask) -> Result<Shot, Failure> {
        let start = Instant::now();
        let (camera, view) = self.camera(ask)?;
        let layer = self.layer(ask.show)?;
        let image = self.image(&camera, layer, ask.light)?;
        let name = view.map(|index| self.album.name(index).to_owned());
        let (picture, psnr) = match (ask.show, view) {
            (Show::Error, Some(index)) => self.compare(&image, index, &camera)?,
            (Show::Layer(Layer::Rgb), _) if ask.has_backdrop => (self.over_light(&image, &camera, ask.light)?, None),
            _ => (layer.picture(&image, self.shading_model.shading.form, self.background.0), None),
        };
        let point = match ask.show {
            Show::Point(at) => place_at(&image, &camera, at),
            _ => None,
        };
        Ok(Shot { picture, view: name, psnr, point, time: start.elapsed() })
    }

    /// The colours of a view over the light, as it is asked for; over the background where the scene has none.
    fn over_light(&self, image: &Image<Vec<f32>>, camera: &Camera, ask: LightAsk) -> Result<RgbImage, Failure> {
        let light = self.lights.get(ask).ok_or_else(|| no_light(ask.id))?.filter(|_| self.layout.is_shaded());
        Ok(light.map_or(Behind::Color(self.background), Behind::Light).picture(image, camera))
    }

    /// From where, and which view that is.
    fn camera(&self, ask: &Ask) -> Result<(Camera, Option<usize>), Failure> {
        let index = match (ask.from, ask.show) {
            (From::View(index), _) => Some(index),
            (From::Pose(pose), Show::Error) => Some(self.album.nearest(&pose).ok_or_else(no_photographs)?),
            _ => None,
        };
        let camera = match (index, ask.from) {
            (Some(index), _) => fitted(self.album.camera(index).ok_or_else(|| no_view(index))?, ask.size),
            (None, From::Pose(pose)) => looking(&pose, ask.size),
            (None, From::View(index)) => return Err(no_view(index)),
        };
        Ok((Camera { near: self.near, ..camera }, index))
    }

    fn layer(&self, show: Show) -> Result<Layer, Failure> {
        match show {
            Show::Error if !self.album.has_photographs() => Err(no_photographs()),
            Show::Error => Ok(Layer::Rgb),
            Show::Point(_) => Ok(Layer::Depth),
            Show::Layer(layer) if layer.is_of_shading() && !self.layout.is_shaded() => {
                Err(Failure::Input(format!("the scene is plain Gaussian splatting, which has no {}", layer.name())))
            }
            Show::Layer(layer) => Ok(layer),
        }
    }

    fn image(&mut self, camera: &Camera, layer: Layer, ask: LightAsk) -> Result<Image<Vec<f32>>, Failure> {
        let channels = Layer::channels(&[layer]);
        let kind = KINDS.iter().position(|kind| *kind == channels).expect("layers are of these kinds");
        let Filtered { place, rules, .. } = self.filtered(ask)?;
        let (place, rules) = (*place, rules[kind]);
        Ok(self.renderer.render_lit(place, camera, &rules)?)
    }

    /// The light as it is asked for, filtered unless it is already.
    fn filtered(&mut self, ask: LightAsk) -> Result<&Filtered, Failure> {
        let filtered = match self.filtered.iter().position(|filtered| filtered.ask == ask) {
            Some(index) => self.filtered.remove(index),
            None => self.filter(ask)?,
        };
        self.filtered.push(filtered);
        Ok(self.filtered.last().expect("one was just put there"))
    }

    fn filter(&mut self, ask: LightAsk) -> Result<Filtered, Failure> {
        let cube = self.lights.get(ask).ok_or_else(|| no_light(ask.id))?.filter(|_| self.layout.is_shaded());
        let rules = self.rules(cube.as_ref());
        let place = self.free_place();
        let [.., of_layers] = &rules;
        if let Some(cube) = cube.filter(|_| of_layers.is_lit) {
            self.renderer.set_light(place, &fitting(&cube, self.shading_model.scheme), of_layers)?;
        }
        Ok(Filtered { ask, place, rules })
    }

    /// A place that no light is in any more.
    fn free_place(&mut self) -> usize {
        if self.filtered.len() == PLACES {
            return self.filtered.remove(0).place;
        }
        let is_free = |place: &usize| self.filtered.iter().all(|filtered| filtered.place != *place);
        (0..PLACES).find(is_free).expect("fewer lights than places")
    }

    /// How pictures of each kind are rendered under a light.
    fn rules(&self, cube: Option<&Cube>) -> [RenderRules; 3] {
        let needs = self.needs.under(cube);
        let levels = cube.map(|cube| levels_of(cube, self.shading_model.scheme));
        KINDS.map(|kind| self.shading_model.plan(self.layout, &needs, levels.as_ref(), kind).rules)
    }

    /// The differences from the photograph of a view.
    fn compare(
        &mut self,
        image: &Image<Vec<f32>>,
        index: usize,
        camera: &Camera,
    ) -> Result<(RgbImage, Option<f64>), Failure> {
        let background = self.background.0;
        let truth = self.album.photograph(index, camera)?.over(background);
        let ours = over_background(image, background);
        let [ours_shown, truth_shown] = [&ours, &truth].map(|planes| picture::rgb(image.width, image.height, planes));
        let picture = picture::error_map(&ours_shown, &truth_shown, ERROR_SHOWN_MAX);
        Ok((picture, Some(psnr(mean_squared_error(&ours, &truth)))))
    }
}

/// A camera as large as fits into a size, of its own proportions.
fn fitted(camera: Camera, [width, height]: [u32; 2]) -> Camera {
    let scale = f64::min(f64::from(width) / f64::from(camera.width), f64::from(height) / f64::from(camera.height));
    let [width, height] = [camera.width, camera.height].map(|edge| (f64::from(edge) * scale).round().max(1.0) as u32);
    camera.resized(width, height)
}

/// The place in the world that is seen at a point of a picture; none where there is little.
fn place_at(image: &Image<Vec<f32>>, camera: &Camera, at: [f32; 2]) -> Option<[f32; 3]> {
    const COVERED: f32 = 0.5;
    let size = [camera.width, camera.height].map(|edge| edge as f32);
    let [column, row] = [0, 1].map(|k| ((at[k] * size[k]) as usize).min(size[k] as usize - 1));
    let pixel = row * camera.width as usize + column;
    let coverage = 1.0 - image.plane(image.channels - 1)[pixel];
    let depth = image.plane(channel::DEPTH)[pixel] / coverage;
    let ray = camera.ray_in_camera(column as f32 + 0.5, row as f32 + 0.5);
    let place = camera.position + camera.camera_from_world.transpose() * (ray * depth);
    (coverage > COVERED && place.is_finite()).then(|| place.to_array())
}

fn looking(pose: &Pose, [width, height]: [u32; 2]) -> Camera {
    Camera::look_at(pose.eye, pose.eye + pose.look, pose.up, pose.angle, width, height)
}

fn no_view(index: usize) -> Failure {
    Failure::Input(format!("the scene has no view {index}"))
}

fn no_light(id: u32) -> Failure {
    Failure::Input(format!("light {id} has made room for later ones; drop it again"))
}

fn no_photographs() -> Failure {
    Failure::Input("there are no photographs to compare with: the scene knows no data set".into())
}
