//! `specula render`: pictures of a scene, layer by layer.

use crate::{
    args::{ProfileName, Render, ViewOptions},
    certified,
    dataset::{self, note_guessed_up},
    failure::Failure,
    output,
    scene::{
        self, backdrop_of, layers_of, note_missing_light, note_oddities, refuse_options_without_light,
        refuse_transparent_layers, relight, render_pictures, shade,
    },
    video::{self, Video},
};
use glam::Vec3;
use specula_core::shade::ShadingForm;
use specula_io::model_folder::ModelInfo;
use specula_report::certificate::CertifiedScene;
use specula_scene::{
    ExecutorChoice, Layer, OpenedModel, RenderOptions, SceneRenderer,
    backdrop::BackgroundChoice,
    camera_set::CameraSet,
    dataset::options_of,
    light_file::{LightOptions, write_light_preview},
    orientation,
    picture_folder::{PictureFolder, differences, light_differences},
    rendering::{OmissionCheck, PictureJob},
};
use specula_train::view::View;
use std::path::Path;

/// Renders the requested pictures.
pub(crate) fn run(args: &Render) -> Result<(), Failure> {
    refuse_contradictions(args)?;
    let video = Video::requested(args.output.as_deref(), &args.views, &args.layers)?;
    let output = video.as_ref().map(Video::pictures).or(args.output.as_deref());
    let layers = video.as_ref().map_or(&args.layers[..], Video::layers);
    let ViewOptions { scene_options, .. } = &args.views;
    let mut opened = scene::open_as(&args.scene, scene_options)?;
    scene::select_light(&mut opened, &args.light)?;
    let mut set = CameraSet::choose(&(&args.views).into(), &opened)?;
    if args.env.is_some() {
        set.keep_light_still();
    }
    let orientation = opened.orientation(scene_options.scene_up.map(Into::into))?;
    let up = orientation::up(&orientation);
    note_turned(args.views.upright, &set, up);
    if let Some(video) = &video {
        video.note_cuts(&set);
    }
    note_oddities(&opened);
    let light_options = LightOptions::from(&args.env_options);
    let mut map = None;
    let options = RenderOptions::from(&scene_options.renderer);
    if let Some(env) = &args.env {
        scene::fuse_near_field(&mut opened, &options)?;
        map = Some(relight(&mut opened.scene, env, light_options, up)?);
    } else {
        note_missing_light(&opened.scene, "add one with --env");
    }
    shade(&mut opened.scene, args.views.shading.shading())?;
    note_guessed_up(&orientation);
    let layers = layers_of(layers, &opened.scene)?;
    let parts = parts_of(args, &opened, &options);
    let folder = PictureFolder::of(&opened, output, set.name, &set, &parts)?;
    output::make_folder(&folder.path)?;
    folder.claim(&set, &layers, args.env.is_some())?;
    if let Some(light) = opened.scene.light.as_ref().filter(|_| layers.contains(&Layer::Light)) {
        write_light_preview(&folder.path.join("light.png"), light, up)?;
    }

    let backdrop = backdrop_of(&args.views, &set, &opened, map.zip(Some(light_options.up.orientation(up))))?;
    let job = PictureJob {
        cameras: &set,
        layers: &layers,
        backdrop: &backdrop,
        folder: &folder,
        has_numbers: args.views.exr,
    };
    let is_as_photographed = args.env.is_none() && !set.is_turned && opened.crop.is_none();
    let true_views = if is_as_photographed { true_views(&opened, &set) } else { Vec::new() };
    job.write_true_pictures(&true_views)?;
    let channels = Layer::channels(&layers);
    let mut check = match args.verify_omissions {
        true => Some(OmissionCheck::new(opened.scene.clone(), channels, &options)?),
        false => None,
    };
    if let Some(error) = args.max_error {
        return render_within(error, args, &opened, &job, video.as_ref());
    }
    let form = opened.scene.shading_model.shading.form;
    let mut renderer = SceneRenderer::new(opened.scene, channels, &options)?;
    render_pictures(&job, &mut renderer, form, |index, image| match &mut check {
        Some(check) => Ok(check.compare(&set.cameras[index].1, image)?),
        None => Ok(()),
    })?;
    video::finish(video.as_ref(), &folder)?;
    check.map_or(Ok(()), |check| {
        output::say(&format!("largest difference: {}", check.largest()))?;
        refuse_omissions(&check)
    })
}

/// Rejects options without effect, and error bounds that cannot be kept.
fn refuse_contradictions(args: &Render) -> Result<(), Failure> {
    scene::refuse_light_beside(args.env.as_deref(), &args.light)?;
    refuse_options_without_light(args.env.as_deref(), (&args.env_options).into())?;
    if args.max_error.is_some() && !Layer::expanded(&args.layers).contains(&Layer::Rgb) {
        return Err(Failure::Input("--max-error applies to colours; add rgb to --layers".into()));
    }
    let is_transparent = args.views.background == Some(BackgroundChoice::Transparent);
    if args.max_error.is_some() && (is_transparent || args.views.exr) {
        return Err(Failure::Input(
            "--max-error applies to colours over a background; omit --background transparent and --exr".into(),
        ));
    }
    refuse_transparent_layers(&args.views, &args.layers)?;
    Ok(())
}

/// Notes the effect of --upright, which pictures may not show.
pub(super) fn note_turned(is_upright: bool, set: &CameraSet, up: Vec3) {
    if is_upright && !set.is_turned {
        tracing::info!("every picture is upright already; --upright rotated none");
    }
    let turned = set.cameras.iter().filter(|(_, camera)| camera.turns_upright(up) != 0).count();
    if !is_upright && 2 * turned > set.cameras.len() {
        tracing::info!(
            "{turned} of {} pictures are not upright, as photographed; --upright turns them",
            set.cameras.len()
        );
    }
}

/// Parts of the folder's name, one for each difference from `specula render MODEL`.
fn parts_of(args: &Render, opened: &OpenedModel, options: &RenderOptions) -> Vec<String> {
    let ViewOptions { background, scene_options, .. } = &args.views;
    let mut parts = differences(opened, options, *background, scene_options.profile.map(ProfileName::name));
    parts.extend(args.views.shading.shading().map(|shading| shading.name().to_owned()));
    parts.extend(args.env.as_deref().map(|env| format!("env-{}", output::stem(env))));
    parts.extend(light_differences((&args.env_options).into()));
    parts.extend(args.max_error.map(|error| format!("error-{error}")));
    parts
}

/// Renders the requested pictures within an error.
fn render_within(
    error: f64,
    args: &Render,
    opened: &OpenedModel,
    job: &PictureJob<'_>,
    video: Option<&Video>,
) -> Result<(), Failure> {
    if let ExecutorChoice::Gpu(_) = args.views.scene_options.renderer.executor {
        return Err(Failure::Input("--max-error runs on the CPU only; use --executor cpu".into()));
    }
    if opened.scene.shading_model.shading.form == ShadingForm::Physical {
        return Err(Failure::Input("--max-error does not support physical materials; use --shading view".into()));
    }
    if !opened.scene.other_lights.is_empty() {
        return Err(Failure::Input("--max-error supports one light; choose one with --light N".into()));
    }
    let cameras = job.cameras.cameras.iter().map(|(_, camera)| *camera).collect();
    if job.layers.len() > 1 {
        tracing::info!("only colours are verified; other layers use the same settings");
    }
    let background = job.backdrop.color().0;
    let order = args.views.scene_options.renderer.order;
    let certified = CertifiedScene::new(&opened.scene, cameras, background, order, error, !args.no_verify)?;
    let mut renderer = certified.renderer(&opened.scene, Layer::channels(job.layers));
    render_pictures(job, &mut renderer, opened.scene.shading_model.shading.form, |_, _| Ok(()))?;
    video::finish(video, job.folder)?;
    output::say(certified.certificate())?;
    output::say(&certified::report(&certified))
}

/// Reports a plan whose omissions change pictures, a bug.
fn refuse_omissions(check: &OmissionCheck) -> Result<(), Failure> {
    match check.largest() {
        0.0 => Ok(()),
        largest => Err(Failure::Internal(format!("the plan's omissions change pictures by up to {largest}"))),
    }
}

/// Photographs of a set's views, if the data set of the training still exists.
fn true_views(opened: &OpenedModel, set: &CameraSet) -> Vec<View> {
    let (Some(info), Some(split)) = (&opened.info, set.split) else { return Vec::new() };
    views_of(info, split.has_test(), split.has_train()).unwrap_or_else(|failure| {
        tracing::warn!("no ground truth: {failure}");
        Vec::new()
    })
}

fn views_of(info: &ModelInfo, test: bool, train: bool) -> Result<Vec<View>, Failure> {
    let data = dataset::load(Path::new(&info.source_path), &options_of(info))?;
    let tests = data.test.into_iter().filter(|_| test);
    Ok(tests.chain(data.train.into_iter().filter(|_| train)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{
        camera::Camera,
        rules::Channels,
        scene::{Gaussians, Layout, QUAT, len_of_values},
    };
    use specula_scene::{Scene, ShadingModel};

    /// Grey Gaussian in front of the camera.
    fn scene() -> Scene {
        let layout = Layout::radiance(0);
        let mut gaussians = Gaussians { count: 1, layout, values: vec![0.0; len_of_values(1, layout)] };
        gaussians.set(0, QUAT, [1.0, 0.0, 0.0, 0.0]);
        Scene::unlit(gaussians, ShadingModel::PAPER)
    }

    #[test]
    fn omissions_that_change_a_picture_are_reported_as_a_bug() {
        let camera = Camera::look_at(Vec3::X * 5.0, Vec3::ZERO, Vec3::Z, 0.7, 16, 16);
        let options = RenderOptions::full_precision(ExecutorChoice::Cpu);
        let mut renderer = SceneRenderer::new(scene(), Channels::Color, &options).expect("the CPU renders");
        let mut image = renderer.render(&camera).expect("the CPU renders");
        let mut check = OmissionCheck::new(scene(), Channels::Color, &options).expect("the CPU renders");
        check.compare(&camera, &image).expect("the CPU renders");
        assert!(refuse_omissions(&check).is_ok(), "no omission changes the picture");

        let number = &mut image.plane_mut(1)[70];
        let added = (*number + 0.25) - *number;
        *number += added;
        check.compare(&camera, &image).expect("the CPU renders");
        let failure = refuse_omissions(&check).unwrap_err();
        assert_eq!(failure.exit_code(), 1);
        assert!(failure.to_string().contains(&format!("by up to {added};")), "{failure}");
    }
}
