//! Scenes of the program: opened as its options say, relit from files, rendered and measured.

use crate::{
    args::{OwnLightOption, ProfileName, SceneOptions, ViewOptions},
    dataset::suggestion,
    failure::Failure,
    included::{self, LIGHTS},
    progress,
};
use glam::Vec3;
use specula_core::{
    antialias::LowPass,
    region::Ball,
    scene::{Image, MEAN},
    shade::ShadingForm,
};
use specula_io::{
    Error, Input, budget, dataset, glb,
    latlong::{LatLong, MapOrientation},
    model_folder::{self, Model, ModelInfo},
};
use specula_report::measure::{self, ViewMeasures};
use specula_scene::{
    Layer, OpenedModel, RenderOptions, Scene, SceneError, SceneRenderer, Shading, ShadingModel,
    backdrop::{Backdrop, BackgroundChoice, BackgroundColor},
    camera_set::CameraSet,
    capture::Capture,
    crop::Crop,
    foreground::Foreground,
    light_file::{self, LightOptions},
    number::group_digits,
    picture_folder::light_differences,
    rendering::PictureJob,
    text::shown,
};
use specula_train::view::View;
use std::path::{Path, PathBuf};

/// Opens the folder of a model, or a PLY or glTF file, with the shading model and the low-pass
/// filter that it names, or those of the options.
pub(crate) fn open(
    path: &Path,
    profile: Option<ProfileName>,
    low_pass: Option<LowPass>,
) -> Result<OpenedModel, Failure> {
    let opened = if glb::is_gltf(path) {
        open_glb(path, profile, low_pass)?
    } else {
        let model = open_model(path, low_pass)?;
        let shading_model = shading_model_of(&model, profile)?;
        OpenedModel::under(path, model, shading_model)
    };
    opened.notes.iter().for_each(|note| tracing::warn!("{note}"));
    Ok(opened)
}

/// Opens a scene as its options say, cropped to a region if they name one.
pub(crate) fn open_as(path: &Path, options: &SceneOptions) -> Result<OpenedModel, Failure> {
    let mut opened = open(path, options.profile, options.antialiased.low_pass())?;
    let all = opened.scene.gaussians.count;
    if options.crop == Some(Crop::Object) && opened.folder.is_some() && !has_surroundings(&opened)? {
        tracing::warn!(
            "the model has no surroundings, so --crop object may take a part of the object for what it stands on; omit it"
        );
    }
    if let Some(ball) = options.crop.map_or(Ok(None), |region| opened.crop(region))? {
        let Ball { center, radius } = ball;
        let [x, y, z] = [0, 1, 2].map(|axis| opened.origin[axis] + f64::from(center[axis]));
        let (kept, place) = (opened.scene.gaussians.count, format!("--crop {x:.4},{y:.4},{z:.4},{radius:.4}"));
        if kept == 0 {
            return Err(Failure::Input(format!("{path:?} has no Gaussian in {place}; use another centre or radius")));
        }
        if options.crop == Some(Crop::Object) && opened.crop != options.crop {
            tracing::warn!(
                "no plane that the object stands on was found in its surface, so nothing below it was removed"
            );
        }
        tracing::info!("the crop keeps {} of {} Gaussians; its ball: {place}", group_digits(kept), group_digits(all));
    }
    Ok(opened)
}

/// Notes that a scene keeps its surroundings, or what the object stands on, and what becomes of
/// them.
pub(crate) fn note_support(options: &SceneOptions, opened: &OpenedModel, becomes: &str) -> Result<(), Failure> {
    match options.crop {
        Some(Crop::Object) => {}
        Some(_) => {
            tracing::info!("--crop keeps what the object stands on, which {becomes}; --crop object removes it");
        }
        None if opened.folder.is_some() && has_surroundings(opened)? => {
            tracing::info!("what is around the object {becomes}; --crop object shows only the object");
        }
        None => {}
    }
    Ok(())
}

/// Returns whether a model has more than its subject.
fn has_surroundings(opened: &OpenedModel) -> Result<bool, Failure> {
    /// Share of the Gaussians around the subject above which a scene has surroundings.
    const SHARE_MIN: f64 = 0.2;
    let Some(ball) = Foreground::Auto.ball(Some(&opened.orientation(None)?), opened.origin) else { return Ok(false) };
    let gaussians = &opened.scene.gaussians;
    let around = (0..gaussians.count).filter(|index| !ball.contains(gaussians.get::<3>(*index, MEAN))).count();
    Ok(around as f64 > SHARE_MIN * gaussians.count as f64)
}

/// Opens a glTF file, which names its shading.
fn open_glb(path: &Path, profile: Option<ProfileName>, low_pass: Option<LowPass>) -> Result<OpenedModel, Failure> {
    if profile.is_some() {
        return Err(Failure::Input(format!("{path:?} names its shading itself; omit --profile")));
    }
    let mut opened = OpenedModel::of_glb(path)?;
    opened.scene.gaussians.layout.low_pass = low_pass.unwrap_or(opened.scene.gaussians.layout.low_pass);
    Ok(opened)
}

/// Shading model of a profile, if one is requested; else that of the model itself.
fn shading_model_of(model: &Model, profile: Option<ProfileName>) -> Result<ShadingModel, Failure> {
    match profile {
        None => match ShadingModel::refuse_unknown(model) {
            Ok(()) => Ok(ShadingModel::of_model(model)),
            Err(error) => Err(Failure::Input(format!("{error}, or name one of this version with --profile"))),
        },
        Some(_) if model.are_materials => {
            Err(Failure::Input("the file has only physical materials, which no profile trains; omit --profile".into()))
        }
        Some(ProfileName::Official) => Ok(ShadingModel::OFFICIAL),
        Some(ProfileName::Specula) => Ok(ShadingModel::DEFERRED),
        Some(ProfileName::Paper) => Ok(ShadingModel::PAPER),
        Some(ProfileName::Plain) if !model.gaussians.layout.is_shaded() => Ok(ShadingModel::PAPER),
        Some(ProfileName::Plain) => Err(Failure::Input(
            "the scene has shading attributes and cannot be read as plain Gaussian splatting; use --profile specula, \
             paper or official"
                .into(),
        )),
    }
}

/// Rejects a light of the training beside an environment map, which replaces it.
pub(crate) fn refuse_light_beside(
    env: Option<&Path>,
    OwnLightOption { light }: &OwnLightOption,
) -> Result<(), Failure> {
    match (env, light) {
        (Some(_), Some(_)) => Err(Failure::Input("--env replaces the lights of the training; omit --light".into())),
        _ => Ok(()),
    }
}

/// Puts all views of a model under one light of its training, if one is requested, and names it.
pub(crate) fn select_light(opened: &mut OpenedModel, OwnLightOption { light }: &OwnLightOption) -> Result<(), Failure> {
    let Some(light) = light else { return Ok(()) };
    let names: Vec<&str> = opened.info.iter().flat_map(ModelInfo::light_names).collect();
    let named = names.iter().position(|name| name == light).map(|index| index + 1);
    let number = named.or_else(|| light.parse().ok()).ok_or_else(|| {
        let names: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
        let known = if names.is_empty() { "only one light".into() } else { format!("the lights {}", names.join(", ")) };
        Failure::Input(format!("the model has {known}, and no light {light:?}; change or omit --light"))
    })?;
    let count = 1 + opened.scene.other_lights.len();
    opened.select_light(number).map_err(|error| Failure::Input(format!("{error}; change or omit --light")))?;
    if let Some(name) = opened.light_name(number) {
        tracing::info!("light {number} of {count}, {name:?}");
    }
    Ok(())
}

/// Puts a model under one light of its training, the first by default, and names it, if there are
/// several.
pub(crate) fn settle_light(opened: &mut OpenedModel, requested: &OwnLightOption) -> Result<(), Failure> {
    let count = 1 + opened.scene.other_lights.len();
    if count == 1 || requested.light.is_some() {
        return select_light(opened, requested);
    }
    opened.select_light(1)?;
    let name = opened.light_name(1).unwrap_or_default();
    tracing::info!("light 1 of {count}, {name:?}; --light selects another by its name or number");
    Ok(())
}

/// Warns about a model: another light, Gaussians that are not finite.
pub(crate) fn note_oddities(opened: &OpenedModel) {
    if opened.is_relit {
        tracing::warn!(
            "brdf_mlp.hdr is not the light that was saved with the model; the scene is shown under brdf_mlp.hdr"
        );
    }
    if opened.scene.gaussians.count == 0 {
        tracing::warn!("the scene has no Gaussians, so only its background is shown");
    }
    if let Some(reasons) = opened.scene.nonfinite_reasons() {
        tracing::warn!("Gaussians with numbers that are not finite are skipped: {reasons}");
    }
}

/// Notes a shaded scene without a light, and the remedy.
pub(crate) fn note_missing_light(scene: &Scene, remedy: &str) {
    if scene.gaussians.layout.is_shaded() && scene.light.is_none() {
        tracing::warn!("the scene has no light, so nothing specular is shown; {remedy}");
    }
}

/// Requested background, else that of the training, else black.
pub(crate) fn background_of(opened: &OpenedModel, requested: Option<BackgroundColor>) -> BackgroundColor {
    requested.unwrap_or(BackgroundColor(opened.background()))
}

/// Background of pictures: a colour, the light of a file, the scene's own, or none.
pub(crate) fn backdrop_of(
    options: &ViewOptions,
    set: &CameraSet,
    opened: &OpenedModel,
    map: Option<(LatLong, MapOrientation)>,
) -> Result<Backdrop, Failure> {
    let scene_light = || opened.scene.light.clone().filter(|_| opened.scene.gaussians.layout.is_shaded());
    match (options.background, map) {
        (Some(BackgroundChoice::Environment), Some((map, orientation))) => {
            Ok(Backdrop::from_map(&map, orientation, set.cameras.iter().map(|(_, camera)| camera)))
        }
        (Some(BackgroundChoice::Environment), None) if !opened.scene.other_lights.is_empty() => Err(Failure::Input(
            "--background env shows one light, and the model has several; choose one with --light N".into(),
        )),
        (Some(BackgroundChoice::Environment), None) => scene_light().map(Backdrop::Environment).ok_or_else(|| {
            Failure::Input("the scene has no light for --background env; use --background black, white or R,G,B".into())
        }),
        (Some(BackgroundChoice::Transparent), _) => Ok(Backdrop::Transparent),
        (requested, _) => Ok(Backdrop::Color(background_of(opened, requested.and_then(BackgroundChoice::color)))),
    }
}

/// Rejects options of a light without a light, which would have no effect.
pub(crate) fn refuse_options_without_light(light: Option<&Path>, options: LightOptions) -> Result<(), Failure> {
    if light.is_some() || light_differences(options).is_empty() {
        return Ok(());
    }
    Err(Failure::Input("--exposure and --env-up apply to the light of --env; add --env".into()))
}

/// Rejects a transparent background without colours, the only layer with a background.
pub(crate) fn refuse_transparent_layers(views: &ViewOptions, layers: &[Layer]) -> Result<(), Failure> {
    if views.background != Some(BackgroundChoice::Transparent) || Layer::expanded(layers).contains(&Layer::Rgb) {
        return Ok(());
    }
    Err(Failure::Input("--background transparent applies to colours; add rgb to --layers".into()))
}

/// Opens a model. The error for another folder suggests what to open instead, if known.
fn open_model(path: &Path, low_pass: Option<LowPass>) -> Result<Model, Failure> {
    let mut model = model_folder::open(path).map_err(|error| match (&error, models_in(path).as_slice()) {
        (Error::NoModel { .. }, [first, others @ ..]) => {
            let (models, also) = match others {
                [] => ("one", String::new()),
                _ => ("several", others.iter().map(|other| format!(" or {other:?}")).collect()),
            };
            Failure::Input(format!("{path:?} is not a model, but contains {models}; open {first:?}{also}"))
        }
        (Error::NoModel { .. }, []) if dataset::is_dataset(path) => {
            let name = shown(path);
            Failure::Input(format!("{path:?} is a data set; train it first: specula train {name} -m out/model"))
        }
        _ => suggestion(path, &error).unwrap_or_else(|| error.into()),
    })?;
    if let Some(low_pass) = low_pass {
        if model.gaussians.layout.is_smoothed {
            return Err(Failure::Input(format!(
                "{path:?} has the filters of Mip-Splatting and is shown with them; omit --antialiased"
            )));
        }
        model.gaussians.layout.low_pass = low_pass;
    }
    Ok(model)
}

/// Models in a folder, by name; if there are none, those in its folders.
pub(crate) fn models_in(folder: &Path) -> Vec<PathBuf> {
    let entries = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let models = |folder: &Path| entries(folder).filter(|path| model_folder::latest_iteration(path).is_ok());
    let mut found: Vec<PathBuf> = models(folder).collect();
    if found.is_empty() {
        found =
            entries(folder).filter(|path| path.is_dir()).flat_map(|path| models(&path).collect::<Vec<_>>()).collect();
    }
    found.sort();
    found
}

/// Near field of materials that come without one, with progress.
pub(crate) fn fuse_near_field(opened: &mut OpenedModel, options: &RenderOptions) -> Result<(), Failure> {
    let announce = |_| tracing::info!("fusing the surface on which the materials shadow and reflect each other");
    fusing(announce, |progress| opened.fuse_near_field(options, progress))
}

/// Runs a fusion with progress; `announce` receives the number of pictures before the first one.
pub(crate) fn fusing<T>(
    announce: impl Fn(usize),
    fuse: impl FnOnce(&mut dyn FnMut(usize, usize)) -> Result<T, SceneError>,
) -> Result<T, Failure> {
    let mut work = None;
    let fused = fuse(&mut |done, all| {
        let work = work.get_or_insert_with(|| {
            announce(all);
            progress::work("fusing", all as u64)
        });
        work.done(done as u64, String::new);
    })?;
    if let Some(work) = work {
        work.finish();
    }
    Ok(fused)
}

/// Replaces the light of a scene by that of a file. `up` is the scene's up direction.
pub(crate) fn relight(scene: &mut Scene, path: &Path, options: LightOptions, up: Vec3) -> Result<LatLong, Failure> {
    refuse_plain(scene)?;
    let map = read_env(path, options.exposure)?;
    scene.relight(&map, options.up.orientation(up));
    Ok(map)
}

/// Selects the colours of a scene: those of the option, by default those valid under its light.
pub(crate) fn shade(scene: &mut Scene, shading: Option<Shading>) -> Result<(), Failure> {
    let Some(shading) = shading else { return Ok(()) };
    if shading == Shading::Physical && !scene.gaussians.layout.is_physical {
        return Err(Failure::Input(format!(
            "{}; train on its photographs with --relightable",
            SceneError::NoMaterials
        )));
    }
    scene.shading_model = scene.shading_model.shaded(shading);
    Ok(())
}

/// Rejects relighting of plain Gaussian splatting.
pub(crate) fn refuse_plain(scene: &Scene) -> Result<(), Failure> {
    if scene.gaussians.layout.is_shaded() {
        return Ok(());
    }
    Err(Failure::Input(
        "the scene is plain Gaussian splatting, which bakes the lighting into its colours; only a training on its \
         photographs finds materials (specula train)"
            .into(),
    ))
}

/// Renders and writes the pictures of a job; calls `inspect` with each rendered view.
pub(crate) fn render_pictures(
    job: &PictureJob<'_>,
    renderer: &mut SceneRenderer,
    form: ShadingForm,
    inspect: impl FnMut(usize, &Image<Vec<f32>>) -> Result<(), Failure> + Send,
) -> Result<(), Failure> {
    let work = progress::work("rendering", job.cameras.cameras.len() as u64);
    job.run(renderer, form, |done| work.done(done as u64, String::new), inspect)?;
    work.finish();
    Ok(())
}

/// Measures every view ([`measure::measure_views`]), with progress.
pub(crate) fn measure_views(
    renderer: &mut SceneRenderer,
    views: &[View],
    background: BackgroundColor,
    is_exposed: bool,
) -> Result<Vec<ViewMeasures>, Failure> {
    let work = progress::work("measuring", views.len() as u64);
    let progress = |done| work.done(done as u64, String::new);
    let measured = measure::measure_views(renderer, views, background.0, is_exposed, progress)?;
    work.finish();
    Ok(measured)
}

/// Measures every test view ([`measure::measure_views`]), with progress. Decodes a few pictures at
/// a time.
pub(crate) fn measure_held_out(
    renderer: &mut SceneRenderer,
    data: &Capture,
    background: BackgroundColor,
    is_exposed: bool,
) -> Result<Vec<ViewMeasures>, Failure> {
    let work = progress::work("measuring", data.test.len() as u64);
    let mut measured = Vec::with_capacity(data.test.len());
    let mut held_out = data.held_out();
    while let Some(views) = held_out.next_some()? {
        let views: Vec<View> = views.into_iter().map(|(view, _)| view).collect();
        let before = measured.len();
        let progress = |done| work.done((before + done) as u64, String::new);
        measured.extend(measure::measure_views(renderer, &views, background.0, is_exposed, progress)?);
    }
    work.finish();
    Ok(measured)
}

/// Lat-long map from a file, times two to the power of the exposure. Values that are not a radiance
/// are replaced and logged.
pub(crate) fn read_env(path: &Path, exposure: f32) -> Result<LatLong, Failure> {
    let read = light_file::read(light_input(path)?);
    let (mut map, warnings) = read.map_err(|error| match error {
        SceneError::File(Error::Image { cause, .. }) => not_a_light(path, &format!(" ({cause})")),
        error => error.into(),
    })?;
    warnings.iter().for_each(|warning| tracing::info!("{warning}"));
    map.rgb.iter_mut().for_each(|radiance| *radiance *= exposure.exp2());
    budget::radiance(path, &map.rgb)?;
    Ok(map)
}

fn not_a_light(path: &Path, what: &str) -> Failure {
    let names = LIGHTS.join(", ");
    Failure::Input(format!("{path:?} is not an environment map{what}; name a .hdr or .exr file, or {names}"))
}

/// Map of a file, or else one that the program contains.
pub(crate) fn light_input(path: &Path) -> Result<Input<'_>, Failure> {
    if path.is_dir() {
        return Err(not_a_light(path, ", but a folder"));
    }
    if path.exists() || path.extension().is_some() {
        let without_ending = path.with_extension("");
        let included = without_ending.to_str().filter(|name| !path.exists() && included::light(name).is_some());
        return included.map_or(Ok(Input::file(path)), |name| {
            Err(Failure::Input(format!("there is no file {path:?}; the light in the program is named {name}")))
        });
    }
    let name = path.to_str().unwrap_or_default();
    included::light(name).map(|bytes| Input::memory(name, bytes)).ok_or_else(|| {
        Failure::Input(format!(
            "there is no file {path:?}, and the program contains no light of this name; name a .hdr or .exr file, or {}",
            LIGHTS.join(", ")
        ))
    })
}

/// Requested layers that the scene has.
///
/// # Errors
///
/// The scene has none of the layers; names the missing ones.
pub(crate) fn layers_of(requested: &[Layer], scene: &Scene) -> Result<Vec<Layer>, Failure> {
    let (layout, form) = (scene.gaussians.layout, scene.shading_model.shading.form);
    let (layers, missing): (Vec<Layer>, Vec<Layer>) =
        Layer::expanded(requested).into_iter().partition(|layer| layer.exists(layout, form));
    let is_named = |layer: &&Layer| requested.contains(layer) || !layer.is_of_materials() || layout.is_physical;
    let names: Vec<&str> = missing.iter().filter(is_named).map(|layer| layer.name()).collect();
    if !names.is_empty() {
        let names = names.join(", ");
        let reason = match (layout.is_shaded(), layout.is_physical, form) {
            (false, _, _) => format!("the scene is plain Gaussian splatting, which has no {names}"),
            (true, true, ShadingForm::Physical) => format!("physical materials have no {names}"),
            (true, true, _) => format!("{names}: use --shading physical"),
            (true, false, _) => format!("the scene was trained without --relightable and has no {names}"),
        };
        if layers.is_empty() {
            return Err(Failure::Input(reason));
        }
        tracing::warn!("{reason}");
    }
    Ok(layers)
}
