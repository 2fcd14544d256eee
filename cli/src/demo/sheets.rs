//! Pictures of the demo: comparisons, lights, relightings, a turntable.

use super::data::LIGHTS;
use crate::{
    args::{EnvOptions, EnvUp, MachineOptions},
    background::{Background, truth},
    failure::Failure,
    look::Tour,
    orientation,
    progress::{self, Work},
    scene::{Renderer, relight},
};
use glam::Vec3;
use specula_core::{camera::Camera, rules::Channels, scene::Environment, shade::ShadingForm};
use specula_io::{
    cameras::NamedCamera,
    latlong::{self, LatLong, UpAxis},
    picture::{self, RgbImage},
    pixels::Pixels,
};
use specula_scene::{ExecutorChoice, Layer, Scene};
use specula_train::view::{Normals, View};
use std::path::Path;

/// Test views that are shown.
const COMPARED: [&str; 4] = ["r_0", "r_14", "r_24", "r_34"];
/// Test views whose truth under other lights is known.
const RELIT: [&str; 2] = ["r_8", "r_28"];
/// Test views that are taken apart, and the layers that are shown of them.
const TAKEN_APART: [&str; 2] = ["r_0", "r_24"];
const LAYERS: [(Layer, &str); 5] = [
    (Layer::Rgb, "all together"),
    (Layer::Diffuse, "diffuse colour"),
    (Layer::Specular, "specular: tinted reflection"),
    (Layer::Roughness, "roughness, mirrors are black"),
    (Layer::Normal, "normals"),
];
/// The folder of the page's pictures.
const PICTURES: &str = "pictures";
/// Mean error of a pixel, of 0 to 1, that is shown in the brightest colour.
const ERROR_SHOWN: f32 = 0.25;
/// Pixels of the lights.
const LIGHT_SIZE: [usize; 2] = [320, 160];
/// Frames of the turntable, their size and duration.
const FRAMES: u32 = 36;
const FRAME_SIZE: [u32; 2] = [240, 240];
const FRAME_MS: u16 = 70;

/// A picture of the page, and the words below it.
#[derive(Debug)]
pub(super) struct Figure {
    /// Within the demo's folder.
    pub(super) file: String,
    pub(super) caption: String,
    pub(super) size: [u32; 2],
}

/// Pictures of the page, row by row.
#[derive(Debug)]
pub(super) struct Sheets {
    pub(super) comparison: Vec<Vec<Figure>>,
    pub(super) layers: Vec<Vec<Figure>>,
    pub(super) lights: Vec<Vec<Figure>>,
    pub(super) relit: Vec<Vec<Figure>>,
}

/// Writes all pictures.
pub(super) fn write(
    folder: &Path,
    test: &[View],
    mut plain: Renderer,
    mut ours: Renderer,
    scene: Scene,
) -> Result<Sheets, Failure> {
    let work = progress::work("pictures", 5);
    let step = |done: u64, work: &Work| work.done(done, String::new);
    let comparison = comparison(folder, test, &mut plain, &mut ours)?;
    step(1, &work);
    let layers = layers(folder, test, &scene)?;
    step(2, &work);
    let true_light = latlong::read(&folder.join("data/light/workshop.hdr"))?.0;
    let lights = lights(folder, &scene, &true_light)?;
    step(3, &work);
    picture::write_animation(&folder.join("turntable.png"), &turntable(test, &mut ours, &scene)?, FRAME_MS)?;
    step(4, &work);
    let relit = relit(folder, test, scene)?;
    step(5, &work);
    work.finish();
    Ok(Sheets { comparison, layers, lights, relit })
}

fn named<'a>(test: &'a [View], name: &'a str) -> impl Iterator<Item = &'a View> {
    test.iter().filter(move |view| view.name == name)
}

/// Writes a picture for the page.
fn figure(folder: &Path, name: &str, image: &RgbImage, caption: impl Into<String>) -> Result<Figure, Failure> {
    let file = format!("{PICTURES}/{name}.png");
    picture::write(&folder.join(&file), image)?;
    Ok(Figure { file, caption: caption.into(), size: [image.width(), image.height()] })
}

/// Truth, both trainings, normals and errors.
fn comparison(
    folder: &Path,
    test: &[View],
    plain: &mut Renderer,
    ours: &mut Renderer,
) -> Result<Vec<Vec<Figure>>, Failure> {
    let mut rows = Vec::new();
    for view in COMPARED.into_iter().flat_map(|name| named(test, name)) {
        let truth = truth(view, Background::WHITE);
        let theirs = shown(plain, &view.camera, Layer::Rgb)?;
        let own = shown(ours, &view.camera, Layer::Rgb)?;
        let [their_error, own_error] = [&theirs, &own].map(|image| picture::error_map(image, &truth, ERROR_SHOWN));
        let normals = shown(ours, &view.camera, Layer::Normal)?;
        let true_normals = view.normals.as_ref().map(|normals| normal_map(&view.camera, normals));
        let panels = [
            (Some(truth), "truth", "truth"),
            (Some(theirs), "3dgs", "3dgs"),
            (Some(own), "specula", "specula"),
            (Some(their_error), "error-3dgs", "error of 3dgs"),
            (Some(own_error), "error-specula", "error of specula"),
            (Some(normals), "normals", "specula's normals"),
            (true_normals, "true-normals", "true normals"),
        ];
        let written = |(image, file, words): (Option<RgbImage>, &str, &str)| {
            image.map(|image| figure(folder, &format!("{}-{file}", view.name), &image, words))
        };
        rows.push(panels.into_iter().filter_map(written).collect::<Result<_, _>>()?);
    }
    Ok(rows)
}

/// The layers of a shaded scene.
fn layers(folder: &Path, test: &[View], scene: &Scene) -> Result<Vec<Vec<Figure>>, Failure> {
    let options = MachineOptions::in_full(&ExecutorChoice::Cpu);
    let mut renderer = Renderer::new(scene.clone(), Channels::Layers, &options)?;
    let mut rows = Vec::new();
    for view in TAKEN_APART.into_iter().flat_map(|name| named(test, name)) {
        let image = renderer.view(&view.camera)?;
        let written = |(layer, words): (Layer, &str)| {
            let picture = layer.picture(&image, ShadingForm::Paper, Background::WHITE.0);
            figure(folder, &format!("{}-layer-{}", view.name, layer.name()), &picture, words)
        };
        rows.push(LAYERS.into_iter().map(written).collect::<Result<_, _>>()?);
    }
    Ok(rows)
}

fn shown(renderer: &mut Renderer, camera: &Camera, layer: Layer) -> Result<RgbImage, Failure> {
    let image = renderer.view(camera)?;
    Ok(layer.picture(&image, ShadingForm::Paper, Background::WHITE.0))
}

fn normal_map(camera: &Camera, normals: &Normals) -> RgbImage {
    let planes: Vec<f32> = (0..3).flat_map(|axis| normals.values.iter().map(move |normal| normal[axis])).collect();
    let alpha: Vec<f32> = normals.mask.iter().map(|has| f32::from(u8::from(*has))).collect();
    picture::normals(camera.width as usize, camera.height as usize, &planes, &alpha)
}

/// The light that was recovered, as bright as the true one in the mean: a factor could as well be in the tints.
fn lights(folder: &Path, scene: &Scene, truth: &LatLong) -> Result<Vec<Vec<Figure>>, Failure> {
    let mean = |map: &LatLong| map.rgb.iter().sum::<f32>() / map.rgb.len() as f32;
    let truth = preview(&latlong::to_cube(truth, 128, UpAxis::Z), 128);
    let mut row = Vec::new();
    if let Some(Environment { resolution, activation, values }) = &scene.light {
        let radiance = specula_scene::environment::radiance(*activation, values);
        let mut own = preview(&radiance, *resolution);
        let factor = mean(&truth) / mean(&own).max(f32::MIN_POSITIVE);
        own.rgb.iter_mut().for_each(|radiance| *radiance *= factor);
        row.push(figure(folder, "light-recovered", &picture::tone_map_latlong(&own), "recovered light")?);
    }
    row.push(figure(folder, "light-true", &picture::tone_map_latlong(&truth), "true light")?);
    Ok(vec![row])
}

fn preview(cube: &[f32], resolution: usize) -> LatLong {
    let [width, height] = LIGHT_SIZE;
    latlong::from_cube(cube, resolution, width, height, UpAxis::Z)
}

/// A circle around the scene.
fn turntable(test: &[View], ours: &mut Renderer, scene: &Scene) -> Result<Vec<RgbImage>, Failure> {
    let [width, height] = FRAME_SIZE;
    let known: Vec<NamedCamera> =
        test.iter().map(|view| (view.name.clone(), view.camera.resized(width, height))).collect();
    let found = orientation::found(None, known.iter().map(|(_, camera)| camera));
    let orientation = found.unwrap_or_else(|| orientation::of_cloud(&scene.gaussians));
    let tour = Tour::around(&orientation, &known, FRAMES, None);
    tour.cameras.iter().map(|(_, camera)| shown(ours, camera, Layer::Rgb)).collect()
}

/// For each light: the light, and two views under it beside their truth.
fn relit(folder: &Path, test: &[View], scene: Scene) -> Result<Vec<Vec<Figure>>, Failure> {
    let mut rows = Vec::new();
    for light in LIGHTS {
        let mut scene = scene.clone();
        let options = EnvOptions { env_up: EnvUp::Z, exposure: 0.0 };
        relight(&mut scene, &folder.join(format!("data/light/{light}.hdr")), &options, Vec3::Z)?;
        let cube = scene.light.as_ref().expect("a light was just put in");
        let map = picture::tone_map_latlong(&preview(&cube.values, cube.resolution));
        let mut row = vec![figure(folder, &format!("light-{light}"), &map, light)?];
        let mut renderer = Renderer::new(scene, Channels::Color, &MachineOptions::in_full(&ExecutorChoice::Cpu))?;
        for view in RELIT.into_iter().flat_map(|name| named(test, name)) {
            let name = format!("{}-{light}", view.name);
            let own = shown(&mut renderer, &view.camera, Layer::Rgb)?;
            row.push(figure(folder, &name, &own, "specula, relit")?);
            let true_pixels = Pixels::read(&folder.join(format!("data/relit/{light}/{}.png", view.name)))?;
            let true_view = View { rgba: true_pixels.rgba, ..view.clone() };
            row.push(figure(folder, &format!("{name}-true"), &truth(&true_view, Background::WHITE), "truth")?);
        }
        rows.push(row);
    }
    Ok(rows)
}
