//! `specula relight`: a scene under another light, and how close that comes to the truth.

use crate::{
    args::{ProfileName, Relight, ViewOptions},
    failure::Failure,
    output,
    scene::{self, backdrop_of, relight, render_pictures},
};
use specula_report::relighting::{GroundTruth, RelightingQuality};
use specula_scene::{
    Layer, RenderOptions, SceneRenderer,
    backdrop::BackgroundChoice,
    camera_set::CameraSet,
    light_file::{LightOptions, write_light_preview},
    orientation,
    picture_folder::{PictureFolder, differences, light_differences},
    rendering::PictureJob,
};

/// Renders the scene under the new light.
pub(crate) fn run(args: &Relight) -> Result<(), Failure> {
    if args.truth.is_some() && args.views.background == Some(BackgroundChoice::Environment) {
        return Err(Failure::Input(
            "true pictures are compared over a colour; use --truth without --background env".into(),
        ));
    }
    let ViewOptions { background, scene_options, .. } = &args.views;
    let mut opened = scene::open(&args.scene, scene_options.profile, scene_options.antialiased.low_pass())?;
    let set = CameraSet::choose(&(&args.views).into(), &opened)?;
    let truths = args.truth.as_deref().map(|folder| GroundTruth::read(folder, &set.cameras)).transpose()?;
    let up = orientation::up(&opened.orientation(scene_options.scene_up.map(Into::into))?);
    let light_options = LightOptions::from(&args.env_options);
    let map = relight(&mut opened.scene, &args.env, light_options, up)?;
    let options = RenderOptions::from(&scene_options.renderer);
    let mut parts = differences(&opened, &options, *background, scene_options.profile.map(ProfileName::name));
    parts.extend(light_differences(light_options));
    let group = format!("relight/{}", output::stem(&args.env));
    let folder = PictureFolder::of(&opened, args.output.as_deref(), &group, &set, &parts)?;
    output::make_folder(&folder.path)?;
    folder.claim(&set, true)?;
    if let Some(light) = &opened.scene.light {
        write_light_preview(&folder.path.join("light.png"), light, up)?;
    }

    let backdrop = backdrop_of(&args.views, &set, &opened, Some((map, light_options.up.orientation(up))))?;
    let layers = [Layer::Rgb];
    let job = PictureJob { cameras: &set, layers: &layers, backdrop: &backdrop, folder: &folder };
    let form = opened.scene.shading_model.shading.form;
    let mut renderer = SceneRenderer::new(opened.scene, Layer::channels(&layers), &options)?;
    let mut pairs = Vec::new();
    render_pictures(&job, &mut renderer, form, |index, image| {
        pairs.extend(truths.as_ref().and_then(|truths| truths.pair(index, image)));
        Ok(())
    })?;
    if truths.is_none() {
        return output::say(&folder.path.display().to_string());
    }
    let measured = RelightingQuality::of(&pairs, backdrop.color().0);
    if args.json {
        return output::say_json(&measured.to_json(pairs.len()));
    }
    output::say(&format!("relighting {measured}  ({} views)", pairs.len()))
}
