//! Pictures of the demo: comparisons, layers, lights, relit views, and an animation.

use super::{trainings::Orbit, turntable};
use crate::error::Result;
use specula_core::{camera::Camera, rules::Channels, shade::ShadingForm};
use specula_io::{
    latlong::{self, LatLong, UpAxis},
    picture::{self, RgbImage},
    pixels::Pixels,
};
use specula_scene::{ExecutorChoice, Layer, RenderOptions, Scene, SceneRenderer, environment::radiance};
use specula_train::{
    evaluate::measure_view,
    view::{Normals, View},
};
use std::path::Path;

/// Lights of the data set with ground truth of some test views.
pub const LIGHTS: [&str; 2] = ["forest", "sunset"];

/// Test views of the comparison.
const COMPARED: [&str; 3] = ["r_0", "r_14", "r_24"];
/// Test views with ground truth under other lights.
const RELIT: [&str; 2] = ["r_8", "r_28"];
/// Test views of the layers.
const LAYERED: [&str; 2] = ["r_0", "r_24"];
/// Layers and their captions.
const LAYERS: [(Layer, &str); 5] = [
    (Layer::Rgb, "all layers"),
    (Layer::Diffuse, "diffuse colour"),
    (Layer::Specular, "specular: tinted reflection"),
    (Layer::Roughness, "roughness, black is a mirror"),
    (Layer::Normal, "normals"),
];
/// Mean error that maps to the brightest colour, on a scale from 0 to 1.
const ERROR_MAX: f32 = 0.25;
/// Width and height of pictures of lights.
const LIGHT_SIZE: [usize; 2] = [320, 160];
/// Background of the data set.
const WHITE: [f32; 3] = [1.0; 3];

/// Picture of the page.
#[derive(Debug)]
pub(super) struct Figure {
    /// Path relative to the page.
    pub(super) file: String,
    pub(super) caption: String,
    pub(super) size: [u32; 2],
}

/// Pictures of the page, in rows.
#[derive(Debug)]
pub struct Pictures {
    /// Ground truth, plain and shaded, of each view.
    pub(super) views: Vec<Vec<Figure>>,
    pub(super) errors: Vec<Vec<Figure>>,
    pub(super) layers: Vec<Vec<Figure>>,
    pub(super) lights: Vec<Vec<Figure>>,
    pub(super) relit: Vec<Vec<Figure>>,
    /// Mean PSNR of the relit views in dB, as rendered.
    pub(super) relit_psnr: String,
}

impl Pictures {
    /// Folder of the pictures, next to the page.
    pub const FOLDER: &str = "pictures";
    /// Number of steps of [`Pictures::write`].
    pub const STEPS: u64 = 5;

    /// Renders two trainings of the same data set, `plain` without and `shaded` with a shading
    /// function, and writes all pictures to the folder of the page, which contains the data set in
    /// `data`. `orbit` are the cameras of the animation; `advance` takes the number of steps done.
    ///
    /// # Errors
    ///
    /// Files that cannot be read or written; those of the CPU executor.
    pub fn write(
        folder: &Path,
        test: &[View],
        plain: &Scene,
        shaded: &Scene,
        orbit: &Orbit,
        advance: &dyn Fn(u64),
    ) -> Result<Self> {
        let [mut plain, mut lit] = [renderer(plain, Channels::Training)?, renderer(shaded, Channels::Training)?];
        let [views, errors] = comparison(folder, test, &mut plain, &mut lit)?;
        advance(1);
        let layers = layers(folder, test, shaded)?;
        advance(2);
        let true_light = latlong::read(&folder.join("data/light/workshop.hdr"))?.0;
        let lights = lights(folder, shaded, &true_light)?;
        advance(3);
        let sunset = latlong::read(&folder.join("data/light/sunset.hdr"))?.0;
        turntable::write(&folder.join("turntable.png"), shaded, orbit, &sunset)?;
        advance(4);
        let (relit, relit_psnr) = relit(folder, test, shaded)?;
        advance(5);
        Ok(Self { views, errors, layers, lights, relit, relit_psnr: format!("{relit_psnr:.1}") })
    }
}

fn renderer(scene: &Scene, channels: Channels) -> Result<SceneRenderer> {
    Ok(SceneRenderer::new(scene.clone(), channels, &RenderOptions::full_precision(ExecutorChoice::Cpu))?)
}

fn views_named<'a>(test: &'a [View], names: &'a [&str]) -> impl Iterator<Item = &'a View> {
    names.iter().flat_map(|name| test.iter().filter(move |view| view.name == *name))
}

/// Writes a picture of the page.
fn figure(folder: &Path, name: &str, image: &RgbImage, caption: impl Into<String>) -> Result<Figure> {
    let file = format!("{}/{name}.png", Pictures::FOLDER);
    picture::write(&folder.join(&file), image)?;
    Ok(Figure { file, caption: caption.into(), size: [image.width(), image.height()] })
}

/// Ground truth and both trainings of each view; then their errors and normals.
fn comparison(
    folder: &Path,
    test: &[View],
    plain: &mut SceneRenderer,
    shaded: &mut SceneRenderer,
) -> Result<[Vec<Vec<Figure>>; 2]> {
    let (mut views, mut errors) = (Vec::new(), Vec::new());
    for view in views_named(test, &COMPARED) {
        let truth = photograph(view, &view.over(WHITE));
        let [in_plain, in_shaded] =
            [rendered(plain, &view.camera, Layer::Rgb)?, rendered(shaded, &view.camera, Layer::Rgb)?];
        let [plain_error, shaded_error] =
            [&in_plain, &in_shaded].map(|image| picture::error_map(image, &truth, ERROR_MAX));
        let normals = rendered(shaded, &view.camera, Layer::Normal)?;
        let true_normals = view.normals.as_ref().map(|normals| normal_map(&view.camera, normals));
        let written = |(image, file, caption): (Option<RgbImage>, &str, &str)| {
            image.map(|image| figure(folder, &format!("{}-{file}", view.name), &image, caption))
        };
        let pictures = [
            (Some(truth), "truth", "ground truth"),
            (Some(in_plain), "3dgs", "3dgs"),
            (Some(in_shaded), "specula", "specula"),
        ];
        views.push(pictures.into_iter().filter_map(written).collect::<Result<_>>()?);
        let differences = [
            (Some(plain_error), "error-3dgs", "error of 3dgs"),
            (Some(shaded_error), "error-specula", "error of specula"),
            (Some(normals), "normals", "specula's normals"),
            (true_normals, "true-normals", "true normals"),
        ];
        errors.push(differences.into_iter().filter_map(written).collect::<Result<_>>()?);
    }
    Ok([views, errors])
}

/// Layers of the shaded scene.
fn layers(folder: &Path, test: &[View], scene: &Scene) -> Result<Vec<Vec<Figure>>> {
    let mut renderer = renderer(scene, Channels::Layers)?;
    let row = |view: &View| -> Result<Vec<Figure>> {
        let image = renderer.render(&view.camera)?;
        let written = |(layer, caption): (Layer, &str)| {
            let picture = layer.picture(&image, ShadingForm::Paper, WHITE);
            figure(folder, &format!("{}-layer-{}", view.name, layer.name()), &picture, caption)
        };
        LAYERS.into_iter().map(written).collect()
    };
    views_named(test, &LAYERED).map(row).collect()
}

fn rendered(renderer: &mut SceneRenderer, camera: &Camera, layer: Layer) -> Result<RgbImage> {
    Ok(layer.picture(&renderer.render(camera)?, ShadingForm::Paper, WHITE))
}

fn photograph(view: &View, planes: &[f32]) -> RgbImage {
    picture::rgb(view.camera.width as usize, view.camera.height as usize, planes)
}

fn normal_map(camera: &Camera, normals: &Normals) -> RgbImage {
    let planes: Vec<f32> = (0..3).flat_map(|axis| normals.values.iter().map(move |normal| normal[axis])).collect();
    let alpha: Vec<f32> = normals.mask.iter().map(|has| f32::from(u8::from(*has))).collect();
    picture::normals(camera.width as usize, camera.height as usize, &planes, &alpha)
}

/// Recovered light, scaled to the mean of the true one: its factor is ambiguous with that of the
/// tints.
fn lights(folder: &Path, scene: &Scene, truth: &LatLong) -> Result<Vec<Vec<Figure>>> {
    let mean = |map: &LatLong| map.rgb.iter().sum::<f32>() / map.rgb.len() as f32;
    let truth = preview(&latlong::to_cube(truth, 128, UpAxis::Z), 128);
    let mut row = Vec::new();
    if let Some(light) = &scene.light {
        let mut recovered = preview(&radiance(light), light.resolution);
        let factor = mean(&truth) / mean(&recovered).max(f32::MIN_POSITIVE);
        recovered.rgb.iter_mut().for_each(|radiance| *radiance *= factor);
        row.push(figure(folder, "light-recovered", &picture::tone_map_latlong(&recovered), "recovered light")?);
    }
    row.push(figure(folder, "light-true", &picture::tone_map_latlong(&truth), "true light")?);
    Ok(vec![row])
}

fn preview(cube: &[f32], resolution: usize) -> LatLong {
    let [width, height] = LIGHT_SIZE;
    latlong::from_cube(cube, resolution, width, height, UpAxis::Z)
}

/// Two views under each light next to ground truth, and their mean PSNR.
fn relit(folder: &Path, test: &[View], scene: &Scene) -> Result<(Vec<Vec<Figure>>, f64)> {
    let (mut rows, mut psnrs) = (Vec::new(), Vec::new());
    for light in LIGHTS {
        let mut scene = scene.clone();
        scene.relight(&latlong::read(&folder.join(format!("data/light/{light}.hdr")))?.0, UpAxis::Z);
        let mut renderer = renderer(&scene, Channels::Color)?;
        for view in views_named(test, &RELIT) {
            let pixels = Pixels::read(&folder.join(format!("data/relit/{light}/{}.png", view.name)))?;
            let true_view = View { rgba: pixels.rgba, ..view.clone() };
            let image = renderer.render(&view.camera)?;
            let psnr = measure_view(&image, &true_view, WHITE).psnr;
            psnrs.push(psnr);
            let name = format!("{}-{light}", view.name);
            let before = photograph(view, &view.over(WHITE));
            let relit = Layer::Rgb.picture(&image, ShadingForm::Paper, WHITE);
            let truth = photograph(&true_view, &true_view.over(WHITE));
            rows.push(vec![
                figure(folder, &format!("{name}-before"), &before, "under the light of the pictures")?,
                figure(folder, &name, &relit, format!("specula, {light}: {psnr:.1} dB"))?,
                figure(folder, &format!("{name}-true"), &truth, format!("ground truth, {light}"))?,
            ]);
        }
    }
    let mean = psnrs.iter().sum::<f64>() / psnrs.len().max(1) as f64;
    Ok((rows, mean))
}
