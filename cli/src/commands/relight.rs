//! `specula relight`: a scene under another light, and how close that comes to the truth.

use crate::{
    args::{ProfileName, Relight, ViewOptions},
    dataset::note_guessed_up,
    failure::Failure,
    lights::{LightPlan, Shone},
    output, progress,
    scene::{
        self, backdrop_of, layers_of, refuse_options_without_light, refuse_transparent_layers, render_pictures, shade,
    },
};
use glam::Vec3;
use specula_io::{
    latlong::LatLong,
    picture::{self, DynamicImage},
};
use specula_report::relighting::{GroundTruth, RelightingQuality};
use specula_scene::{
    Layer, OpenedModel, RenderOptions, SceneRenderer, Surface,
    camera_set::CameraSet,
    light_file::write_light_preview,
    orientation,
    picture_folder::{PictureFolder, differences},
    rendering::{FRAME_MS, PictureJob},
    text::shown,
};

/// Renders the scene under the new light.
pub(crate) fn run(args: &Relight) -> Result<(), Failure> {
    let is_over_color = args.views.background.is_none_or(|background| background.color().is_some());
    if args.truth.is_some() && !is_over_color {
        return Err(Failure::Input(
            "true pictures are compared over a colour; use --truth without --background env or transparent".into(),
        ));
    }
    if args.lights.turn_light.is_some() && (args.layers != [Layer::Rgb] || args.views.exr) {
        return Err(Failure::Input("--turn-light shows colours alone; use it without --layers and --exr".into()));
    }
    refuse_transparent_layers(&args.views, &args.layers)?;
    scene::refuse_video(args.output.as_deref())?;
    let ViewOptions { background, scene_options, .. } = &args.views;
    let mut opened = scene::open(&args.scene, scene_options.profile, scene_options.antialiased.low_pass())?;
    let plan = LightPlan::new(&args.lights, (&args.env_options).into())?;
    refuse_options_without_light(plan.env(), (&args.env_options).into())?;
    let mut set = CameraSet::choose(&(&args.views).into(), &opened)?;
    if let Some(count) = args.lights.turn_light {
        set = of_one_camera(set, count);
    }
    let truths = args.truth.as_deref().map(|folder| GroundTruth::read(folder, &set.cameras)).transpose()?;
    let orientation = opened.orientation(scene_options.scene_up.map(Into::into))?;
    let up = orientation::up(&orientation);
    let options = RenderOptions::from(&scene_options.renderer);
    let shading = args.views.shading.shading();
    plan.refuse_view_dependent(shading)?;
    let Shone { map, occluder } = plan.shine(&mut opened, up, &options)?;
    shade(&mut opened.scene, shading)?;
    note_guessed_up(&orientation);
    let mut parts = differences(&opened, &options, *background, scene_options.profile.map(ProfileName::name));
    parts.extend(shading.map(|shading| shading.name().to_owned()));
    parts.extend(plan.differences());
    let group = format!("relight/{}", plan.name());
    let folder = PictureFolder::of(&opened, args.output.as_deref(), &group, &set, &parts)?;
    output::make_folder(&folder.path)?;
    folder.claim(&set, &Layer::EACH, true)?;
    if let Some(light) = &opened.scene.light {
        write_light_preview(&folder.path.join("light.png"), light, up)?;
    }

    if args.lights.turn_light.is_some() {
        let turning = TurningLight { plan: &plan, map: map.as_ref(), occluder: occluder.as_deref(), up, args };
        turning.render(opened, &set, &options, &folder)?;
        return output::say(&shown(&folder.path));
    }
    let backdrop = backdrop_of(&args.views, &set, &opened, map.zip(Some(plan.orientation(up, 0.0))))?;
    let backdrop = plan.grounded(backdrop, &opened.scene, occluder.as_deref(), up);
    let layers = layers_of(&args.layers, &opened.scene)?;
    let job = PictureJob {
        cameras: &set,
        layers: &layers,
        backdrop: &backdrop,
        folder: &folder,
        has_numbers: args.views.exr,
    };
    let form = opened.scene.shading_model.shading.form;
    let mut renderer = SceneRenderer::new(opened.scene, Layer::channels(&layers), &options)?;
    let mut pairs = Vec::new();
    render_pictures(&job, &mut renderer, form, |index, image| {
        pairs.extend(truths.as_ref().and_then(|truths| truths.pair(index, image)));
        Ok(())
    })?;
    if truths.is_none() {
        return output::say(&shown(&folder.path));
    }
    let measured = RelightingQuality::of(&pairs, backdrop.color().0);
    if args.json {
        return output::say_json(&measured.to_json(pairs.len()));
    }
    output::say(&format!("relighting {measured}  ({} views)", pairs.len()))
}

/// The first camera of a set, once for each picture of a light that turns.
fn of_one_camera(set: CameraSet, count: u32) -> CameraSet {
    let camera = set.cameras[0].1;
    let cameras = (0..count).map(|index| (format!("{index:05}"), camera)).collect();
    CameraSet { name: "turn-light", cameras, split: None, is_turntable: true, ..set }
}

/// Light that turns about the scene's up direction from picture to picture.
struct TurningLight<'a> {
    plan: &'a LightPlan,
    map: Option<&'a LatLong>,
    occluder: Option<&'a Surface>,
    up: Vec3,
    args: &'a Relight,
}

impl TurningLight<'_> {
    /// Renders one picture after the other, and an animation.
    fn render(
        &self,
        mut opened: OpenedModel,
        set: &CameraSet,
        options: &RenderOptions,
        folder: &PictureFolder,
    ) -> Result<(), Failure> {
        let Self { plan, map, occluder, up, args } = *self;
        let mut renderer = SceneRenderer::new(opened.scene.clone(), Layer::channels(&[Layer::Rgb]), options)?;
        let rules = *renderer.rules();
        let work = progress::work("rendering", set.cameras.len() as u64);
        let mut frames: Vec<DynamicImage> = Vec::with_capacity(set.cameras.len());
        for (index, (_, camera)) in set.cameras.iter().enumerate() {
            let further = 360.0 * index as f32 / set.cameras.len() as f32;
            if let Some(lamps) = &mut opened.scene.lamps {
                lamps.lamps = plan.lamps(up, further);
                renderer.set_lamps(&lamps.lamps)?;
            }
            plan.relight(&mut opened.scene, map, up, further);
            // The light that reaches materials past other surfaces is that of the light.
            options.storage.round(&mut opened.scene.gaussians);
            renderer.set_surface(&opened.scene.gaussians, opened.scene.near_field())?;
            if let Some(light) = opened.scene.light_for(&rules) {
                renderer.set_light(SceneRenderer::SCENE_LIGHT, &light, &rules)?;
            }
            let behind = map.cloned().zip(Some(plan.orientation(up, further)));
            let backdrop = backdrop_of(&args.views, set, &opened, behind)?;
            let backdrop = plan.grounded(backdrop, &opened.scene, occluder, up);
            let frame = backdrop.picture(&renderer.render(camera)?, camera);
            picture::write(&folder.picture(Layer::Rgb, index), &frame)?;
            frames.push(frame);
            work.done(index as u64 + 1, String::new);
        }
        work.finish();
        Ok(picture::write_animation(&folder.animation(), &frames, FRAME_MS)?)
    }
}
