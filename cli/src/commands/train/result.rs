//! Results of a training: saved and measured during the run and at its end.

use crate::{
    args::{Reflections, Train},
    certified,
    failure::Failure,
    interrupt, memory, output, progress,
    scene::measure_held_out,
    truth::{measure_light, measure_materials, up_of},
};
use core::{iter, time::Duration};
use serde_json::Map;
use specula_core::{camera::Camera, cutoffs::BlendOrder, rules::Channels};
use specula_io::{
    exposure,
    materials::Materials,
    model_folder::{self, ModelInfo},
};
use specula_report::{
    certificate::CertifiedScene, evaluation::albedo_summary, light::LightQuality, materials::MaterialQuality, measure,
};
use specula_scene::{
    RenderOptions, Scene, SceneError, SceneRenderer,
    backdrop::BackgroundColor,
    capture::Capture,
    environment::{concentration_text, lights_of_lamps},
    number::group_digits,
    training::{Outcome, Training},
};
use std::thread;

/// Training and test views of a result.
#[derive(Debug)]
pub(super) struct Views<'a> {
    pub(super) data: &'a Capture,
    pub(super) cameras: Vec<Camera>,
    pub(super) background: BackgroundColor,
}

/// Saves and measures during the run, at the iterations that the options name.
pub(super) fn pause(args: &Train, training: &mut Training, info: &ModelInfo, views: &Views<'_>) -> Result<(), Failure> {
    let iteration = training.iteration();
    let scene = training.scene()?;
    if args.save_iterations.contains(&iteration) {
        save(args, training, &scene, info, views)?;
        tracing::info!("saved iteration {iteration}");
    }
    if args.test_iterations.contains(&iteration) {
        let count = scene.gaussians.count;
        let options = RenderOptions::full_precision(training.choice().clone());
        let is_exposed = training.exposures().is_some();
        let measured = progress::silently(|| {
            let mut renderer = SceneRenderer::new(scene, Channels::Training, &options)?;
            measure_held_out(&mut renderer, views.data, views.background, is_exposed)
        })?;
        measure::save(&args.model_path, iteration, training.seconds(), count, &measured, Map::new())?;
        tracing::info!("iteration {iteration}: {}", measure::summary(&measure::means(&measured)));
    }
    Ok(())
}

/// Writes the scene, and the exposures of the pictures if they are learned.
fn save(args: &Train, training: &Training, scene: &Scene, info: &ModelInfo, views: &Views<'_>) -> Result<(), Failure> {
    if let Some(exposures) = training.exposures() {
        let names: Vec<String> = views.data.train.iter().map(|photograph| photograph.name.clone()).collect();
        exposure::write(&args.model_path, &names, exposures)?;
    }
    Ok(scene.save(&args.model_path, training.iteration(), info)?)
}

/// Writes the result, and tries again while the disk is full and `wait` returns true.
fn write_when_there_is_space(
    mut write: impl FnMut() -> Result<(), Failure>,
    mut wait: impl FnMut() -> bool,
) -> Result<(), Failure> {
    let mut is_told = false;
    loop {
        match write() {
            Err(Failure::File(error)) if error.is_full_disk() => {
                if !is_told {
                    tracing::warn!("{error}; free some space to save the trained scene, or discard it with Ctrl-C");
                }
                is_told = true;
                if !wait() {
                    return Err(error.into());
                }
            }
            written => return written,
        }
    }
}

/// Waits before the next attempt to write; returns false on a signal to give up.
fn wait_for_space(was_interrupted: bool) -> bool {
    const PAUSE: Duration = Duration::from_secs(5);
    thread::sleep(PAUSE);
    was_interrupted || !interrupt::is_requested()
}

/// Saves and measures the result, and prints its measures.
pub(super) fn finish(
    args: &Train,
    training: &mut Training,
    mut info: ModelInfo,
    outcome: Outcome,
    views: &Views<'_>,
) -> Result<(), Failure> {
    let Outcome { iteration, seconds, is_interrupted, .. } = outcome;
    let scene = training.scene()?;
    let count = scene.gaussians.count;
    if !scene.is_finite() {
        return Err(Failure::Input(format!(
            "the training diverged by iteration {iteration}, to numbers that are not finite, and is not saved; check \
             the camera poses with specula info, and remove outliers"
        )));
    }
    info.rest.insert("gaussians".into(), count.into());
    if count == 0 {
        tracing::warn!(
            "the training kept no Gaussian, so its pictures show only the background; check masks and camera poses \
             with specula info, or start from more points with --random-points"
        );
    }
    info.rest.insert("seconds".into(), ((seconds * 1000.0).round() / 1000.0).into());
    let is_requested = interrupt::is_requested();
    write_when_there_is_space(|| save(args, training, &scene, &info, views), || wait_for_space(is_requested))?;
    let path = model_folder::gaussians_at(&args.model_path, iteration);
    if is_interrupted {
        let model = shell_word(&args.model_path.to_string_lossy());
        let resumption = format!("; specula train -m {model} --resume continues");
        return Err(Failure::Interrupted(format!(
            "interrupted after iteration {iteration}, which is saved in {path:?}{}",
            if training.has_checkpoint() { &resumption } else { "" }
        )));
    }
    tracing::info!("saved {path:?}");
    warn_of_lamps(&scene, &info);
    if args.start.reflections == Some(Reflections::Near) && scene.near_field.is_none() {
        tracing::info!("no reflected ray hits the scene: all reflected light is distant");
    }
    let certified = certify_trained(args, &scene, views)?;
    if let Some(certified) = &certified {
        save_certificate(args, &mut info, certified.certificate().to_owned())?;
    }

    let is_object = views.data.holds_objects();
    let facts = format!("{} Gaussians, {iteration} iterations, {seconds:.0} s{}", group_digits(count), peak_memory());
    if !args.eval {
        output::say(&facts)?;
        progress::note_next(next_commands(args, &scene, is_object));
        return Ok(());
    }
    let next = next_commands(args, &scene, is_object);
    let options = RenderOptions::full_precision(training.choice().clone());
    let materials = materials_of(&scene, &options, views.data)?;
    let light = measured_light(args, &scene, &info, views);
    let mut renderer = match &certified {
        Some(certified) => certified.renderer(&scene, Channels::Training),
        None => SceneRenderer::new(scene, Channels::Training, &options)?,
    };
    let is_exposed = training.exposures().is_some();
    let mut measured = measure_held_out(&mut renderer, views.data, views.background, is_exposed)?;
    if let Some(certified) = &certified {
        let report = certified::report(certified);
        output::say(&report)?;
        save_certificate(args, &mut info, format!("{}; {report}", certified.certificate()))?;
    }
    materials.iter().for_each(|materials| materials.add_to(&mut measured));
    let light_facts = light.as_ref().map_or_else(Map::new, LightQuality::facts);
    measure::save(&args.model_path, iteration, seconds, count, &measured, light_facts)?;
    let means = measure::summary(&measure::means(&measured));
    let first = format!("{means}  ({} test views; {facts})", views.data.test.len());
    let albedo = materials.and_then(|materials| materials.albedo_scale).map(albedo_summary);
    let lines = iter::once(first).chain(albedo).chain(light.as_ref().map(LightQuality::summary));
    output::say(&lines.collect::<Vec<_>>().join("\n"))?;
    progress::note_next(next);
    Ok(())
}

/// Warns of lights whose pictures make materials worse.
fn warn_of_lamps(scene: &Scene, info: &ModelInfo) {
    let names = info.light_names();
    for (light, share) in lights_of_lamps(scene.light.iter().chain(&scene.other_lights)) {
        let Some(name) = names.get(light) else { continue };
        tracing::warn!(
            "light {name:?} has {}: small lamps, whose shadows look like darker material; train without its pictures \
             (light - in the table of --lights-by) and compare",
            concentration_text(share)
        );
    }
}

/// Agreement of the learned light with that of the data set. A true light that cannot be read is
/// only a warning.
fn measured_light(args: &Train, scene: &Scene, info: &ModelInfo, views: &Views<'_>) -> Option<LightQuality> {
    let up = up_of(Some(info), views.cameras.iter());
    match measure_light(scene, args.source()?, up) {
        Ok(compared) => compared.map(|(_, quality)| quality),
        Err(error) => {
            tracing::warn!("cannot compare the light with the true one: {error}");
            None
        }
    }
}

/// Commands for a trained model.
fn next_commands(args: &Train, scene: &Scene, is_object: bool) -> Vec<String> {
    let model = shell_word(&args.model_path.to_string_lossy());
    let options = match (scene.gaussians.layout.is_physical, scene.light.is_some()) {
        (true, _) if is_object => Some(" --sun 30,45 --ground"),
        (true, _) => Some(" --crop object --ground"),
        (false, true) => Some(""),
        (false, false) => None,
    };
    let mut commands = vec![format!("specula view {model}"), format!("specula render {model} --turntable 36")];
    commands.extend(options.map(|options| format!("specula relight {model} --env sunset{options}")));
    commands
}

/// Text as a word of a shell.
pub(super) fn shell_word(text: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_./\\:=,".contains(letter);
    if text.chars().all(is_plain) { text.to_owned() } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

/// Render settings within `--max-error`; a bound that cannot be met is only a warning.
fn certify_trained(args: &Train, scene: &Scene, views: &Views<'_>) -> Result<Option<CertifiedScene>, Failure> {
    let Some(error) = args.max_error else { return Ok(None) };
    match CertifiedScene::new(scene, views.cameras.clone(), views.background.0, BlendOrder::Mean, error, true) {
        Ok(certified) => {
            output::say(certified.certificate())?;
            Ok(Some(certified))
        }
        Err(error) => {
            tracing::warn!("{}", Failure::from(error));
            Ok(None)
        }
    }
}

/// Writes the certificate to the model folder.
fn save_certificate(args: &Train, info: &mut ModelInfo, certificate: String) -> Result<(), Failure> {
    info.rest.insert("certificate".into(), certificate.into());
    Ok(model_folder::save_info(&args.model_path, info)?)
}

/// Peak memory of the program, if known.
fn peak_memory() -> String {
    memory::peak().map_or(String::new(), |bytes| format!(", {:.2} GiB at most", bytes as f64 / f64::from(1 << 30)))
}

/// Measures the materials of a scene on the test views, if there are any.
fn materials_of(scene: &Scene, options: &RenderOptions, data: &Capture) -> Result<Option<MaterialQuality>, Failure> {
    if !data.has_materials() {
        return Ok(None);
    }
    let cameras: Vec<Camera> = data.test.iter().map(|photograph| photograph.camera).collect();
    let mut held_out = data.held_out();
    let mut decoded = Vec::new().into_iter();
    let truth = |_| -> Result<Materials, SceneError> {
        if decoded.len() == 0 {
            decoded = held_out.next_some()?.unwrap_or_default().into_iter();
        }
        Ok(decoded.next().map_or_else(Materials::default, |(_, materials)| materials))
    };
    measure_materials(scene, options, &cameras, truth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_io::Error;
    use std::io::ErrorKind;

    fn fails_with(kind: ErrorKind) -> Failure {
        Error::Write { path: "model".into(), cause: kind.into() }.into()
    }

    #[test]
    fn saving_to_a_full_disk_is_repeated_until_it_succeeds_or_is_cancelled() {
        let mut results =
            [Err(fails_with(ErrorKind::StorageFull)), Err(fails_with(ErrorKind::QuotaExceeded)), Ok(())].into_iter();
        assert!(write_when_there_is_space(|| results.next().expect("three writes"), || true).is_ok());
        assert_eq!(results.len(), 0);

        let mut waits = [true, false].into_iter();
        let failed =
            write_when_there_is_space(|| Err(fails_with(ErrorKind::StorageFull)), || waits.next().expect("two waits"));
        assert!(matches!(failed, Err(Failure::File(_))), "{failed:?}");
        assert_eq!(waits.len(), 0);
    }

    #[test]
    fn other_failures_of_saving_end_the_training() {
        let failed = write_when_there_is_space(
            || Err(fails_with(ErrorKind::PermissionDenied)),
            || panic!("nothing to wait for"),
        );
        assert!(matches!(failed, Err(Failure::File(_))), "{failed:?}");
    }
}
