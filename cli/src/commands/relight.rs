//! `specula relight`: a scene under another light, and how close that comes to the truth.

use crate::{
    args::{Look, Relight},
    camera_set::CameraSet,
    commands::render::{Job, behind},
    failure::Failure,
    output,
    picture_folder::{PictureFolder, differences, light_differences},
    scene::{self, relight},
};
use glam::Vec3;
use specula_core::scene::Environment;
use specula_io::{
    latlong::{self, MapOrientation},
    picture,
};
use specula_report::relighting::{GroundTruth, RelightingQuality};
use specula_scene::{Layer, backdrop::BackgroundChoice, orientation};
use std::path::Path;

/// Pixels of a preview of light.
const PREVIEW: [usize; 2] = [512, 256];

/// Renders the scene under the new light.
pub(crate) fn run(args: &Relight) -> Result<(), Failure> {
    if args.truth.is_some() && args.look.background == Some(BackgroundChoice::Environment) {
        return Err(Failure::Input(
            "true pictures are compared over a colour; use --truth without --background env".into(),
        ));
    }
    let mut opened = scene::open(&args.scene, args.look.scene_options.profile)?;
    let set = CameraSet::choose(&args.look, &opened)?;
    let truths = args.truth.as_deref().map(|folder| GroundTruth::read(folder, &set.cameras)).transpose()?;
    let up = orientation::up(&opened.orientation(args.look.scene_options.scene_up.map(Into::into))?);
    let map = relight(&mut opened.scene, &args.env, &args.env_options, up)?;
    let Look { background, scene_options, .. } = &args.look;
    let mut words = differences(&opened, &scene_options.machine, *background, scene_options.profile);
    words.extend(light_differences(&args.env_options));
    let folder = PictureFolder::of(
        &opened,
        args.output.as_deref(),
        &format!("relight/{}", output::stem(&args.env)),
        &set,
        &words,
    )?;
    output::make_folder(&folder.path)?;
    folder.claim(&set, true)?;
    write_light(&folder.path.join("light.png"), opened.scene.light.as_ref(), up)?;

    let behind = behind(&args.look, &set, &opened, Some((map, args.env_options.env_up.stand(up))))?;
    let job = Job { look: &args.look, cameras: &set, layers: &[Layer::Rgb], folder: &folder, behind: &behind };
    let mut pairs = Vec::new();
    job.run(opened, |index, image| {
        pairs.extend(truths.as_ref().and_then(|truths| truths.pair(index, image)));
        Ok(())
    })?;
    if truths.is_none() {
        return output::say(&folder.path.display().to_string());
    }
    let measured = RelightingQuality::of(&pairs, behind.color().0);
    if args.json {
        return output::say_json(&measured.to_json(pairs.len()));
    }
    output::say(&format!("relighting {measured}  ({} views)", pairs.len()))
}

/// Writes a lat-long preview of a light, if there is one, with the scene's up at its upper edge.
pub(crate) fn write_light(path: &Path, light: Option<&Environment<Vec<f32>>>, up: Vec3) -> Result<(), Failure> {
    let stand = MapOrientation::with_up(up.as_dvec3().to_array());
    light.map_or(Ok(()), |light| write_preview(path, &light.values, light.resolution, stand))
}

/// Writes a preview of a cube map: lat-long.
pub(crate) fn write_preview(
    path: &Path,
    values: &[f32],
    resolution: usize,
    stand: MapOrientation,
) -> Result<(), Failure> {
    let [width, height] = PREVIEW;
    let map = latlong::from_cube(values, resolution, width, height, stand);
    Ok(picture::write(path, &picture::tone_map_latlong(&map))?)
}
