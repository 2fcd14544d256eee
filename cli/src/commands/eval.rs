//! `specula eval`: quality of a model on views that it was not fitted to.

pub(crate) mod trial;

use crate::{
    args::{Eval, ProfileName},
    dataset,
    failure::Failure,
    output, progress,
    scene::{self, background_of, note_missing_light, note_oddities, relight, shade},
    truth::{measure_light, measure_materials, up_of},
};
use glam::Vec3;
use specula_core::{camera::Camera, rules::Channels};
use specula_io::{dataset::LoadOptions, materials::Materials, model_folder, picture, within};
use specula_report::{
    evaluation::{self, EvaluatedLight, EvaluatedView, Evaluation, RelitScene},
    lpips::LpipsNetwork,
    measure::{self, LPIPS, PSNR_FITTED, PSNR_LINEAR},
    relighting::GroundTruth,
};
use specula_scene::{
    OpenedModel, Scene, SceneRenderer, Shading,
    backdrop::{BackgroundChoice, BackgroundColor},
    camera_set::{Split, keep_light_still},
    dataset::{named_cameras, options_of},
    light_file::LightOptions,
    picture_folder::differences,
    text::shown,
};
use specula_train::{
    evaluate::{fitted_psnr, linear_psnr},
    view::View,
};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Measures, prints, and writes results and page.
pub(crate) fn run(args: &Eval) -> Result<(), Failure> {
    let mut opened = scene::open(&args.scene, args.profile, args.antialiased.low_pass())?;
    scene::select_light(&mut opened, &args.light)?;
    shade(&mut opened.scene, args.shading.shading())?;
    note_oddities(&opened);
    note_missing_light(&opened.scene, "open the folder of its model");
    let source = source_of(args, &opened)?;
    if args.source_path.is_none() && Split::from(args.split) == Split::Test && opened.test_views() == Some(0) {
        tracing::warn!(
            "the model was trained without --eval, so these are training views; train with --eval to measure new views"
        );
    }
    let (views, truths) = views_of(args, &opened, &source)?;
    let background = background_of(&opened, args.background);
    let method = method_of(args, &opened);
    let results = opened.folder.clone().zip(method.clone());
    let network = args.lpips.as_deref().map(|path| trusted_network(path, &views)).transpose()?;
    let folder = page_folder(args, results.as_ref());
    if let Some(folder) = &folder {
        let root = args.output.as_ref().or(opened.folder.as_ref()).unwrap_or(folder);
        within::refuse_links(root, folder)?;
        output::make_folder(folder)?;
    }

    let split = Split::from(args.split);
    let is_relit = split == Split::Test && opened.scene.gaussians.layout.is_shaded();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let truth = |index: usize| Ok(truths.get(index).cloned().unwrap_or_default());
    let materials = measure_materials(&opened.scene, &(&args.renderer).into(), &cameras, truth)?;
    let albedo_scale = materials.as_ref().and_then(|materials| materials.albedo_scale);
    let up = up_of(opened.info.as_ref(), views.iter().map(|view| &view.camera));
    // A light that replaces the learned one says nothing about the training.
    let light = if opened.is_relit { None } else { measure_light(&opened.scene, &source, up)? };
    let light = light.map(|(pair, quality)| EvaluatedLight {
        picture: folder.as_ref().map(|_| picture::to_png(&pair.picture(&quality))),
        quality,
    });
    if is_relit {
        scene::fuse_near_field(&mut opened, &(&args.renderer).into())?;
    }
    let mut evaluation = Evaluation {
        scene: args.scene.clone(),
        method,
        split: split.name(),
        background: background.0,
        gaussians: opened.scene.gaussians.count,
        lpips_network: network.as_ref().map(|network| network.name.clone()),
        views: Vec::new(),
        relit: match is_relit {
            true => measure_relit(args, &opened, &source, &views, up, albedo_scale)?,
            false => Vec::new(),
        },
        albedo_scale,
        light,
    };

    let is_exposed = args.exposure || opened.exposures()?.is_some();
    let mut renderer = SceneRenderer::new(opened.scene, Channels::Training, &(&args.renderer).into())?;
    let work = progress::work("measuring", views.len() as u64);
    let with_pictures = folder.is_some();
    let progress = |done| work.done(done as u64, String::new);
    evaluation.views = renderer.render_views(&views, progress, |view, image| -> Result<_, Failure> {
        let mut evaluated = EvaluatedView::new(view, image, background.0, with_pictures);
        evaluated.measures.values[PSNR_FITTED] = is_exposed.then(|| fitted_psnr(image, view, background.0));
        evaluated.measures.values[PSNR_LINEAR] = linear_psnr(image, view, background.0);
        Ok(evaluated)
    })?;
    work.finish();
    if let Some(materials) = &materials {
        materials.add_to(evaluation.views.iter_mut().map(|view| &mut view.measures));
    }
    if let Some(network) = &network {
        measure_lpips(network, &mut renderer, &views, background, &mut evaluation.views)?;
    }
    for (view, evaluated) in views.iter().zip(&mut evaluation.views) {
        evaluated.measures = evaluated.measures.clone().of_known(view);
    }
    // Prints measures before writing them: the model's folder may be read-only.
    let kept = match (results, split) {
        (Some((folder, method)), Split::Test) => {
            let quality = measure::quality(&evaluation.measures());
            model_folder::add_quality(&folder, &method, &quality, evaluation.facts())
        }
        _ => Ok(()),
    };
    if let Some(folder) = &folder {
        write_page(folder, &evaluation)?;
    }
    if args.json {
        output::say_json(&evaluation.to_json())?;
    } else {
        output::say(&evaluation.summary())?;
        if let Some(folder) = &folder {
            output::say(&format!("Page: {}", shown(&page_in(folder))))?;
        }
    }
    Ok(kept?)
}

fn page_in(folder: &Path) -> PathBuf {
    folder.join("index.html")
}

fn write_page(folder: &Path, evaluation: &Evaluation) -> Result<(), Failure> {
    let page = evaluation::page(evaluation)?;
    for (path, bytes) in &page.pictures {
        output::write_within(folder, path, bytes)?;
    }
    output::write_text(&page_in(folder), &page.html)
}

/// Network that was tested in a process with limits, on pictures of the size of the largest view.
fn trusted_network(path: &Path, views: &[View]) -> Result<LpipsNetwork, Failure> {
    let sizes = views.iter().map(|view| [view.camera.width, view.camera.height]);
    let largest = sizes.max_by_key(|[width, height]| u64::from(*width) * u64::from(*height)).unwrap_or_default();
    trial::try_network(path, largest)?;
    Ok(LpipsNetwork::read(path)?)
}

/// Adds LPIPS to the measures of each view. All threads work on one view, so that only its features
/// are in memory.
fn measure_lpips(
    network: &LpipsNetwork,
    renderer: &mut SceneRenderer,
    views: &[View],
    background: BackgroundColor,
    evaluated: &mut [EvaluatedView],
) -> Result<(), Failure> {
    let work = progress::work("LPIPS", views.len() as u64);
    for (index, (view, evaluated)) in views.iter().zip(evaluated).enumerate() {
        let distance = network.distance(view, &renderer.render(&view.camera)?, background.0).map_err(|error| {
            Failure::Input(format!(
                "{error}; omit --lpips, or use -r 1 if the pictures are too small for the network's last layer"
            ))
        })?;
        evaluated.measures.values[LPIPS] = Some(distance);
        work.done(index as u64 + 1, String::new);
    }
    work.finish();
    Ok(())
}

/// Measures a scene under every light of its data set with ground truth of these views. `up` is the
/// scene's up direction; with albedo factors, the scene with scaled albedo is measured too.
fn measure_relit(
    args: &Eval,
    opened: &OpenedModel,
    source: &Path,
    views: &[View],
    up: Vec3,
    albedo_scale: Option<[f32; 3]>,
) -> Result<Vec<RelitScene>, Failure> {
    let mut cameras = named_cameras(views);
    keep_light_still(&mut cameras);
    let background = background_of(opened, args.background);
    let renderer_under = |light: &Path, mut scene: Scene| -> Result<SceneRenderer, Failure> {
        relight(&mut scene, light, LightOptions::default(), up)?;
        shade(&mut scene, args.shading.shading())?;
        Ok(SceneRenderer::new(scene, Channels::Color, &(&args.renderer).into())?)
    };
    // Albedo factors apply to physical materials, not to view-dependent colours.
    let albedo_scale = albedo_scale.filter(|_| args.shading.shading() != Some(Shading::View));
    let measured = |(light, folder): (PathBuf, PathBuf)| {
        let truth = GroundTruth::read(&folder, &cameras)?;
        let mut renderer = renderer_under(&light, opened.scene.clone())?;
        let scaled = albedo_scale.map(|scale| {
            let mut scene = opened.scene.clone();
            scene.scale_albedo(scale);
            renderer_under(&light, scene)
        });
        let mut scaled = scaled.transpose()?;
        let work = progress::work("relighting", views.len() as u64);
        let progress = |done| work.done(done as u64, String::new);
        let name = output::stem(&light);
        let relit =
            RelitScene::measure(name, &mut renderer, scaled.as_mut(), &cameras, &truth, background.0, progress)?;
        work.finish();
        Ok(relit)
    };
    evaluation::lights(source).into_iter().map(measured).collect()
}

/// Key of the results: `ours_N`, followed by every difference from `specula eval MODEL`.
fn method_of(args: &Eval, opened: &OpenedModel) -> Option<String> {
    let mut parts = vec![model_folder::method_of(opened.iteration?)];
    let default = opened.info.as_ref().map_or(1, |info| info.downscale.max(1));
    parts
        .extend(args.resolution.filter(|resolution| *resolution != default).map(|resolution| format!("r{resolution}")));
    parts.extend(differences(
        opened,
        &(&args.renderer).into(),
        args.background.map(BackgroundChoice::Color),
        args.profile.map(ProfileName::name),
    ));
    parts.extend(args.shading.shading().map(|shading| shading.name().to_owned()));
    parts.extend(args.source_path.as_deref().filter(|source| is_other_source(source, opened)).map(|source| {
        let name = fs::canonicalize(source).unwrap_or_else(|_| source.to_owned());
        format!("of-{}", name.file_name().unwrap_or_default().to_string_lossy())
    }));
    Some(parts.join("_"))
}

/// Whether a data set differs from that of the training. A data set that was moved is the same.
fn is_other_source(source: &Path, opened: &OpenedModel) -> bool {
    let trained_on = opened.info.as_ref().and_then(|info| fs::canonicalize(&info.source_path).ok());
    trained_on.is_some_and(|trained_on| fs::canonicalize(source).is_ok_and(|source| source != trained_on))
}

/// Folder of the page: the requested one, else that of the pictures of `specula render`.
fn page_folder(args: &Eval, results: Option<&(PathBuf, String)>) -> Option<PathBuf> {
    let default = || results.map(|(folder, method)| folder.join(Split::from(args.split).name()).join(method));
    args.output.clone().or_else(default)
}

fn source_of(args: &Eval, opened: &OpenedModel) -> Result<PathBuf, Failure> {
    let info = opened.info.as_ref();
    let recorded = info.map(|info| PathBuf::from(&info.source_path)).filter(|path| !path.as_os_str().is_empty());
    args.source_path.clone().or(recorded).ok_or_else(|| {
        Failure::Input(format!("{:?} does not name the data set it was trained on; give it with -s", args.scene))
    })
}

/// Views to measure, and the ground-truth materials of the first ones.
fn views_of(args: &Eval, opened: &OpenedModel, source: &Path) -> Result<(Vec<View>, Vec<Materials>), Failure> {
    let info = opened.info.as_ref();
    let options = LoadOptions { with_test: true, ..info.map(options_of).unwrap_or_default() };
    let downscale = args.resolution.unwrap_or(options.downscale);
    let mut data = dataset::load(source, &LoadOptions { downscale, ..options })?;
    if !is_other_source(source, opened) {
        opened.give_lights(&mut data.test, &mut data.train)?;
    }
    let (views, truths): (Vec<View>, Vec<Materials>) = match Split::from(args.split) {
        Split::Test => (data.test, data.test_materials),
        Split::Train => (data.train, Vec::new()),
        Split::All => (data.test.into_iter().chain(data.train).collect(), data.test_materials),
    };
    if views.is_empty() {
        return Err(Failure::Input(format!(
            "no {} views in {source:?}; use --split train",
            Split::from(args.split).name()
        )));
    }
    Ok((views, truths))
}
