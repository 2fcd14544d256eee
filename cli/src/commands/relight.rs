//! `specula relight`: a scene under another light, measured against ground truth.

use crate::{
    args::{ProfileName, Relight, ViewOptions},
    commands::render::note_turned,
    dataset::note_guessed_up,
    failure::Failure,
    lights::LightPlan,
    output, progress,
    scene::{
        self, backdrop_of, layers_of, refuse_options_without_light, refuse_transparent_layers, render_pictures, shade,
    },
    video::{self, Video},
};
use glam::Vec3;
use specula_core::scene::Image;
use specula_io::picture::{self, DynamicImage};
use specula_report::relighting::{GroundTruth, RelightingQuality};
use specula_scene::{
    Layer, Lighting, OpenedModel, RenderOptions, SceneRenderer,
    backdrop::{Backdrop, BackgroundChoice, BackgroundColor},
    camera_set::CameraSet,
    light_file::write_light_preview,
    orientation,
    picture_folder::{PictureFolder, differences},
    rendering::{PictureJob, frame_ms},
};

/// Share of a scene's pixels that may be white without a warning.
const WHITE_MAX: f64 = 0.2;

/// Renders the scene under the new light.
pub(crate) fn run(args: &Relight) -> Result<(), Failure> {
    let is_over_color = args.views.background.is_none_or(|background| background.color().is_some());
    if args.truth.is_some() && !is_over_color {
        return Err(Failure::Input(
            "--truth compares pictures over a colour; omit --background env or transparent".into(),
        ));
    }
    if args.lights.turn_light.is_some() && (args.layers != [Layer::Rgb] || args.views.exr) {
        return Err(Failure::Input("--turn-light renders only colours; omit --layers and --exr".into()));
    }
    refuse_transparent_layers(&args.views, &args.layers)?;
    let video = Video::requested(args.output.as_deref(), &args.views, &args.layers)?;
    let output = video.as_ref().map(Video::pictures).or(args.output.as_deref());
    let layers = video.as_ref().map_or(&args.layers[..], Video::layers);
    let ViewOptions { scene_options, .. } = &args.views;
    let mut opened = scene::open_as(&args.scene, scene_options)?;
    let plan = LightPlan::new(&args.lights, (&args.env_options).into())?;
    let views = &over_ground(args, plan.has_ground(), &opened)?;
    refuse_options_without_light(plan.env(), (&args.env_options).into())?;
    let mut set = CameraSet::choose(&(&args.views).into(), &opened)?;
    set.keep_light_still();
    let orientation = opened.orientation(scene_options.scene_up.map(Into::into))?;
    let up = orientation::up(&orientation);
    note_turned(args.views.upright, &set, up);
    if let Some(count) = args.lights.turn_light {
        set = of_one_camera(set, count);
    }
    if let Some(video) = &video {
        video.note_cuts(&set);
    }
    let truths = args.truth.as_deref().map(|folder| GroundTruth::read(folder, &set.cameras)).transpose()?;
    let options = RenderOptions::from(&scene_options.renderer);
    let shading = args.views.shading.shading();
    plan.refuse_view_dependent(shading)?;
    let lighting = plan.shine(&mut opened, up, &options)?;
    shade(&mut opened.scene, shading)?;
    note_guessed_up(&orientation);
    let mut parts = differences(&opened, &options, views.background, scene_options.profile.map(ProfileName::name));
    parts.extend(shading.map(|shading| shading.name().to_owned()));
    parts.extend(plan.differences());
    let group = format!("relight/{}", plan.name());
    let folder = PictureFolder::of(&opened, output, &group, &set, &parts)?;
    output::make_folder(&folder.path)?;
    folder.claim(&set, &Layer::EACH, true)?;
    if let Some(light) = &opened.scene.light {
        write_light_preview(&folder.path.join("light.png"), light, up)?;
    }

    if args.lights.turn_light.is_some() {
        render_turning(views, opened, lighting, up, &set, &options, &folder)?;
        return video::finish(video.as_ref(), &folder);
    }
    let backdrop = backdrop_under(views, &set, &opened, &lighting, up)?;
    let layers = layers_of(layers, &opened.scene)?;
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
    let (mut white, mut shown) = (0, 0);
    render_pictures(&job, &mut renderer, form, |index, image| {
        let pixels = covered(image);
        white += pixels.clone().filter(|is_white| *is_white).count();
        shown += pixels.count();
        pairs.extend(truths.as_ref().and_then(|truths| truths.pair(index, image)));
        Ok(())
    })?;
    if white as f64 > WHITE_MAX * shown as f64 {
        let percent = 100 * white / shown;
        tracing::warn!(
            "{percent} % of the scene is white, as the light is bright; darken it, such as with --exposure -1"
        );
    }
    if truths.is_none() || video.is_some() {
        video::finish(video.as_ref(), &folder)?;
    }
    if truths.is_none() {
        return Ok(());
    }
    let measured = RelightingQuality::of(&pairs, backdrop.color().0);
    if args.json {
        return output::say_json(&measured.to_json(pairs.len()));
    }
    output::say(&format!("relighting {measured}  ({} views)", pairs.len()))
}

/// Pixels of a picture that the scene covers by more than a half: whether each is white.
fn covered(image: &Image<Vec<f32>>) -> impl Iterator<Item = bool> + Clone {
    let passed = image.plane(image.channels - 1);
    let coverage = move |pixel: usize| 1.0 - passed[pixel];
    (0..image.pixel_count())
        .filter(move |pixel| coverage(*pixel) > 0.5)
        .map(move |pixel| image.rgb(pixel).iter().all(|color| *color >= coverage(pixel)))
}

/// Options of the pictures. Ground is white where it would be as black as the shadows on it.
fn over_ground(args: &Relight, has_ground: bool, opened: &OpenedModel) -> Result<ViewOptions, Failure> {
    if has_ground {
        scene::note_support(&args.views.scene_options, opened, "covers the ground in part")?;
    }
    if !has_ground || args.views.background.is_some() || opened.background() != [0.0; 3] {
        return Ok(args.views.clone());
    }
    tracing::info!(
        "the ground is white, because the model's background is black and shows no shadow; --background changes it"
    );
    let background = Some(BackgroundChoice::Color(BackgroundColor([1.0; 3])));
    Ok(ViewOptions { background, ..args.views.clone() })
}

/// First camera of a set, once for each picture of a turning light.
fn of_one_camera(set: CameraSet, count: u32) -> CameraSet {
    let camera = set.cameras[0].1;
    let cameras = (0..count).map(|index| (format!("{index:05}"), camera)).collect();
    CameraSet { name: "turn-light", cameras, split: None, is_turntable: true, ..set }
}

/// Background of pictures under a light.
fn backdrop_under(
    options: &ViewOptions,
    set: &CameraSet,
    opened: &OpenedModel,
    lighting: &Lighting,
    up: Vec3,
) -> Result<Backdrop, Failure> {
    let map = lighting.map.clone().map(|map| (map, lighting.map_orientation(up)));
    Ok(lighting.grounded(backdrop_of(options, set, opened, map)?, &opened.scene))
}

/// Renders pictures under a light that turns about the scene's up direction, and an animation.
fn render_turning(
    views: &ViewOptions,
    mut opened: OpenedModel,
    mut lighting: Lighting,
    up: Vec3,
    set: &CameraSet,
    options: &RenderOptions,
    folder: &PictureFolder,
) -> Result<(), Failure> {
    let mut renderer = SceneRenderer::new(opened.scene.clone(), Layer::channels(&[Layer::Rgb]), options)?;
    let work = progress::work("rendering", set.cameras.len() as u64);
    let mut frames: Vec<DynamicImage> = Vec::with_capacity(set.cameras.len());
    let start = lighting.turn;
    for (index, (_, camera)) in set.cameras.iter().enumerate() {
        if index > 0 {
            lighting.turn = start + 360.0 * index as f32 / set.cameras.len() as f32;
            lighting.update(&mut opened.scene, &mut renderer, up, options)?;
        }
        let backdrop = backdrop_under(views, set, &opened, &lighting, up)?;
        let frame = backdrop.picture(&renderer.render(camera)?, camera);
        picture::write(&folder.picture(Layer::Rgb, index), &frame)?;
        frames.push(frame);
        work.done(index as u64 + 1, String::new);
    }
    work.finish();
    Ok(picture::write_animation(&folder.animation(), &frames, frame_ms(frames.len()))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_white_where_the_scene_covers_them_and_every_colour_is_at_its_most() {
        // Four pixels, plane by plane: white, half covered and white, red, and empty.
        let values = [[1.0, 0.6, 1.0, 0.0], [1.2, 0.6, 0.1, 0.0], [1.0, 0.6, 0.1, 0.0], [0.0, 0.4, 0.0, 1.0]].concat();
        let image = Image { width: 4, height: 1, channels: 4, values };
        assert_eq!(covered(&image).collect::<Vec<_>>(), [true, true, false]);
    }
}
