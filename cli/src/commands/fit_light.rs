//! `specula fit-light`: the light of photographs of a trained object.

use crate::{
    args::FitLight,
    dataset,
    failure::Failure,
    interrupt, output, progress,
    scene::{self, background_of, measure_views, note_oddities},
};
use serde_json::json;
use specula_core::rules::Channels;
use specula_io::{
    dataset::{LightSource, LoadOptions},
    latlong,
};
use specula_report::measure::{self, PSNR, SSIM, ViewMeasures};
use specula_scene::{
    RenderOptions, SceneError, SceneRenderer,
    dataset::options_of,
    light_file::{self, MapUp},
    light_fit::LightFit,
    number::counted,
    orbit::evenly_spaced,
    orientation,
    text::shown,
};
use specula_train::view::View;

/// Photographs of the fit that the scene is compared with, at most.
const SHOWN_MAX: usize = 12;
/// PSNR in dB below which the photographs show something else.
const PSNR_MIN: f64 = 16.0;

/// Fits and writes the light; measures the photographs that it was not fitted to.
pub(crate) fn run(args: &FitLight) -> Result<(), Failure> {
    refuse_other_formats(args)?;
    let mut opened = scene::open(&args.scene, None, None)?;
    note_oddities(&opened);
    if !opened.scene.gaussians.layout.is_physical {
        return Err(Failure::Input(format!(
            "{}, which are needed to find the light of other photographs; train on its photographs with --relightable",
            SceneError::NoMaterials
        )));
    }
    let defaults = opened.info.as_ref().map(options_of).unwrap_or_default();
    let lights = match (&args.lights_by, &args.light) {
        (Some(path), only) => LightSource::Table { path: path.clone(), only: only.clone() },
        _ => LightSource::Unknown,
    };
    let options = LoadOptions {
        downscale: args.resolution.unwrap_or(defaults.downscale),
        with_test: false,
        origin: Some(opened.origin),
        lights,
        without: Vec::new(),
        ..defaults
    };
    let data = dataset::load(&args.dataset, &options)?;
    let (fitted, others) = divided(data.train, args.fit.unwrap_or(usize::MAX));
    if args.fit.is_some() && others.is_empty() {
        return Err(Failure::Input(format!(
            "--fit {} leaves none of {} to measure; use a smaller number, or omit it",
            fitted.len(),
            counted(fitted.len(), "photograph")
        )));
    }
    if !fitted.iter().all(View::has_alpha) {
        tracing::warn!(
            "the photographs are not cut out by alpha or masks, so the light has to explain their surroundings, too; \
             masks give a better one (docs/datasets.md)"
        );
    }
    output::make_folder(output::folder_of(&args.output))?;
    interrupt::watch()?;
    let background = background_of(&opened, args.background);
    let fit = LightFit {
        pictures: &fitted,
        background: background.0,
        iterations: args.iterations,
        executor: args.executor.clone(),
    };
    let options = RenderOptions::full_precision(args.executor.clone());
    scene::fuse_near_field(&mut opened, &options)?;
    let work = progress::work("fitting", args.iterations.into());
    let light = opened.scene.fit_light(&fit, |step, psnr| {
        work.done(step.into(), || psnr.map_or(String::new(), |psnr| format!("{psnr:.2} dB on these photographs")));
        !interrupt::is_requested()
    })?;
    work.finish();
    let light = light.ok_or_else(|| Failure::Interrupted("interrupted; nothing was written".into()))?;
    let up = orientation::up(&opened.orientation(None)?);
    let map = light_file::map_of(&light, up);
    latlong::write(&args.output, &map)?;
    opened.scene.relight(&map, MapUp::Scene.orientation(up));
    let mut renderer = SceneRenderer::new(opened.scene, Channels::Training, &options)?;
    let count = fitted.len();
    let (some, _) = divided(fitted, SHOWN_MAX);
    let psnr = measure::means(&measure_views(&mut renderer, &some, background, false)?)[PSNR].unwrap_or(f64::NAN);
    if !args.json {
        let (file, fitted) = (shown(&args.output), counted(count, "photograph"));
        let [width, height] = [map.width, map.height];
        output::say(&format!("{file}: light of {fitted}, {width} × {height}; under it the scene has {psnr:.2} dB"))?;
    }
    if psnr < PSNR_MIN {
        tracing::warn!(
            "the scene does not look like the photographs ({psnr:.1} dB; 20 is fair): they show another object, or their \
             cameras are in another world than the model's"
        );
    }
    if !others.is_empty() {
        report(args, &measure_views(&mut renderer, &others, background, false)?)?;
    }
    progress::note_next([format!("specula relight {} --env {}", shown(&args.scene), shown(&args.output))]);
    Ok(())
}

fn refuse_other_formats(args: &FitLight) -> Result<(), Failure> {
    match latlong::RADIANCE_ENDINGS.iter().any(|ending| args.output.extension().is_some_and(|found| found == *ending)) {
        true => Ok(()),
        false => Err(Failure::Input(format!(
            "a light is a file of radiance, not {:?}; end its name in .exr or .hdr",
            args.output
        ))),
    }
}

/// Evenly spaced views, at most `count`, and all others.
fn divided(views: Vec<View>, count: usize) -> (Vec<View>, Vec<View>) {
    let chosen = evenly_spaced(&(0..views.len()).collect::<Vec<_>>(), count);
    let (fitted, others): (Vec<_>, Vec<_>) =
        views.into_iter().enumerate().partition(|(index, _)| chosen.contains(index));
    let views = |numbered: Vec<(usize, View)>| numbered.into_iter().map(|(_, view)| view).collect();
    (views(fitted), views(others))
}

/// Prints the measures of the other photographs.
fn report(args: &FitLight, measured: &[ViewMeasures]) -> Result<(), Failure> {
    let means = measure::means(measured);
    if args.json {
        let view =
            |view: &ViewMeasures| json!({"name": view.name, "PSNR": view.values[PSNR], "SSIM": view.values[SSIM]});
        let views: Vec<_> = measured.iter().map(view).collect();
        return output::say_json(&json!({"PSNR": means[PSNR], "SSIM": means[SSIM], "views": views}));
    }
    let [psnr, ssim] = [PSNR, SSIM].map(|index| means[index].unwrap_or(f64::NAN));
    output::say(&format!(
        "{} that it was not fitted to: PSNR {psnr:.2} dB, SSIM {ssim:.4}",
        counted(measured.len(), "photograph")
    ))
}
