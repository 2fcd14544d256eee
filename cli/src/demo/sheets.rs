//! Pictures of the demo: comparisons, lights, relightings, a turntable.

use super::data::LIGHTS;
use crate::{
    args::{EnvOptions, EnvUp, MachineOptions},
    background::Background,
    bearings,
    failure::Failure,
    look::Tour,
    machine::ExecutorChoice,
    pictures::Layer,
    progress::{Talk, Work},
    render::truth,
    scene::{Renderer, relight},
};
use glam::Vec3;
use specula_core::{camera::Camera, plan::Channels, scene::Environment, shade::ShadingForm};
use specula_io::{
    cameras::NamedCamera,
    latlong::{self, LatLong, UpAxis},
    picture::{self, Panel, RgbImage},
    pixels::Pixels,
};
use specula_scene::Scene;
use specula_train::view::{Normals, View};
use std::path::Path;

/// Test views that are shown.
const COMPARED: [&str; 4] = ["r_0", "r_14", "r_24", "r_34"];
/// Test views whose truth under other lights is known.
const RELIT: [&str; 2] = ["r_8", "r_28"];
/// Pictures of 160 pixels are shown twice as large.
const ENLARGED: u32 = 2;
/// Mean error of a pixel, of 0 to 1, that is shown in the brightest colour.
const ERROR_SHOWN: f32 = 0.25;
/// Pixels of the lights.
const LIGHT_SIZE: [usize; 2] = [640, 320];
/// Frames of the turntable, their size and duration.
const FRAMES: u32 = 36;
const FRAME_SIZE: [u32; 2] = [240, 240];
const FRAME_MS: u16 = 70;

/// Writes all pictures.
pub(super) fn write(
    folder: &Path,
    test: &[View],
    mut plain: Renderer,
    mut ours: Renderer,
    scene: Scene,
    talk: Talk,
) -> Result<(), Failure> {
    let work = talk.work("pictures", 4);
    let step = |done: u64, work: &Work| work.done(done, String::new);
    picture::write(&folder.join("comparison.png"), &comparison(test, &mut plain, &mut ours)?)?;
    step(1, &work);
    let true_light = latlong::read(&folder.join("data/light/workshop.hdr"))?.0;
    picture::write(&folder.join("light.png"), &lights(&scene, &true_light))?;
    step(2, &work);
    picture::write_animation(&folder.join("turntable.png"), &turntable(test, &mut ours, &scene)?, FRAME_MS)?;
    step(3, &work);
    picture::write(&folder.join("relit.png"), &relit(folder, test, scene, talk)?)?;
    step(4, &work);
    work.finish();
    Ok(())
}

fn named<'a>(test: &'a [View], name: &'a str) -> impl Iterator<Item = &'a View> {
    test.iter().filter(move |view| view.name == name)
}

/// Truth, both trainings, normals and errors.
fn comparison(test: &[View], plain: &mut Renderer, ours: &mut Renderer) -> Result<RgbImage, Failure> {
    let mut rows = Vec::new();
    for view in COMPARED.into_iter().flat_map(|name| named(test, name)) {
        let truth = truth(view, Background::WHITE);
        let theirs = shown(plain, &view.camera, Layer::Rgb)?;
        let own = shown(ours, &view.camera, Layer::Rgb)?;
        let [their_error, own_error] = [&theirs, &own].map(|image| picture::error_map(image, &truth, ERROR_SHOWN));
        let normals = shown(ours, &view.camera, Layer::Normal)?;
        let true_normals = view.normals.as_ref().map(|normals| normal_map(&view.camera, normals));
        let panels = [
            (Some(truth), "truth"),
            (Some(theirs), "3dgs"),
            (Some(own), "specula"),
            (Some(their_error), "error of 3dgs"),
            (Some(own_error), "error of specula"),
            (Some(normals), "specula's normals"),
            (true_normals, "true normals"),
        ];
        let is_first = rows.is_empty();
        let panel = |(image, words): (Option<RgbImage>, &str)| {
            image.map(|image| Panel::new(enlarged(&image), if is_first { words } else { "" }))
        };
        rows.push(panels.into_iter().filter_map(panel).collect());
    }
    Ok(picture::montage(&rows))
}

fn shown(renderer: &mut Renderer, camera: &Camera, layer: Layer) -> Result<RgbImage, Failure> {
    let image = renderer.view(camera)?;
    Ok(layer.picture(&image, ShadingForm::Paper, Background::WHITE))
}

fn normal_map(camera: &Camera, normals: &Normals) -> RgbImage {
    let planes: Vec<f32> = (0..3).flat_map(|axis| normals.values.iter().map(move |normal| normal[axis])).collect();
    let alpha: Vec<f32> = normals.mask.iter().map(|has| f32::from(u8::from(*has))).collect();
    picture::normals(camera.width as usize, camera.height as usize, &planes, &alpha)
}

/// Each pixel as a square of pixels.
fn enlarged(image: &RgbImage) -> RgbImage {
    RgbImage::from_fn(image.width() * ENLARGED, image.height() * ENLARGED, |x, y| {
        *image.get_pixel(x / ENLARGED, y / ENLARGED)
    })
}

/// The light that was recovered, as bright as the true one in the mean: a factor could as well be in the tints.
fn lights(scene: &Scene, truth: &LatLong) -> RgbImage {
    let mean = |map: &LatLong| map.rgb.iter().sum::<f32>() / map.rgb.len() as f32;
    let truth = preview(&latlong::to_cube(truth, 128, UpAxis::Z), 128);
    let mut panels = Vec::new();
    if let Some(Environment { resolution, activation, values }) = &scene.light {
        let radiance = specula_scene::environment::radiance(*activation, values);
        let mut own = preview(&radiance, *resolution);
        let factor = mean(&truth) / mean(&own).max(f32::MIN_POSITIVE);
        own.rgb.iter_mut().for_each(|radiance| *radiance *= factor);
        panels.push(Panel::new(picture::tone_map_latlong(&own), "recovered light"));
    }
    panels.push(Panel::new(picture::tone_map_latlong(&truth), "true light"));
    picture::montage(&[panels])
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
    let found = bearings::found(None, known.iter().map(|(_, camera)| camera));
    let bearings = found.unwrap_or_else(|| bearings::of_cloud(&scene.gaussians));
    let tour = Tour::around(&bearings, &known, FRAMES, None);
    tour.cameras.iter().map(|(_, camera)| shown(ours, camera, Layer::Rgb)).collect()
}

/// For each light: the light, and two views under it beside their truth.
fn relit(folder: &Path, test: &[View], scene: Scene, talk: Talk) -> Result<RgbImage, Failure> {
    let mut rows = Vec::new();
    for light in LIGHTS {
        let mut scene = scene.clone();
        let options = EnvOptions { env_up: EnvUp::Z, exposure: 0.0 };
        relight(&mut scene, &folder.join(format!("data/light/{light}.hdr")), &options, Vec3::Z, talk)?;
        let cube = scene.light.as_ref().expect("a light was just put in");
        let map = preview(&cube.values, cube.resolution);
        let mut row = vec![Panel::new(picture::tone_map_latlong(&map), light)];
        let mut renderer = Renderer::new(scene, Channels::Color, &MachineOptions::in_full(&ExecutorChoice::Cpu), talk)?;
        for view in RELIT.into_iter().flat_map(|name| named(test, name)) {
            let own = shown(&mut renderer, &view.camera, Layer::Rgb)?;
            row.push(Panel::new(enlarged(&own), "specula, relit"));
            let truth = Pixels::read(&folder.join(format!("data/relit/{light}/{}.png", view.name)))?;
            let truth = View { rgba: truth.rgba, ..view.clone() };
            row.push(Panel::new(enlarged(&crate::render::truth(&truth, Background::WHITE)), "truth"));
        }
        rows.push(row);
    }
    Ok(picture::montage(&rows))
}
