//! `specula capture`: a data set of a video or of photographs.

use crate::{
    args::{Capture, CaptureOptions},
    dataset,
    failure::Failure,
    interrupt, output,
    progress::{self, Work},
};
use core::cell::RefCell;
use serde_json::json;
use specula_capture::{Error, Evidence, Finding, Look, Monitor, Options, Outcome, command_text};
use specula_io::{dataset::LoadOptions, model_folder, reconstruction::Reconstruction};
use specula_scene::{
    dataset::{Dataset, has_files, picture_names},
    text::shown,
};
use specula_train::view::View;
use std::{
    collections::HashSet,
    path::{Path, PathBuf},
};

/// Captures, diagnoses, and names the next command.
pub(crate) fn run(args: &Capture) -> Result<(), Failure> {
    let outcome = capture(&args.inputs, &args.output, &args.options)?;
    let data = dataset::load(&args.output, &LoadOptions::default())?;
    let findings = findings(&args.output, &data)?;
    output::write_json(&args.output.join("capture/findings.json"), &json!(findings))?;
    let Outcome { pictures, registered, .. } = outcome;
    output::say(&format!("{}: {registered} of {pictures} pictures have a camera", shown(&args.output)))?;
    findings.iter().try_for_each(|finding| output::say(&sentence(finding)))?;
    let has_drift = findings.iter().any(|finding| finding.kind == Finding::EXPOSURE);
    tracing::info!("next: {}", next_command(&args.output, &data, has_drift));
    Ok(())
}

/// Training of the data set, with materials, and exposures where they differ.
fn next_command(folder: &Path, data: &Dataset, has_drift: bool) -> String {
    let model = Path::new("out").join(output::stem(folder));
    let [folder, model] = [folder, &model].map(Path::to_string_lossy);
    let words = ["specula", "train", &folder, "-m", &model, "--preset", "photos", "--eval"];
    let exposure = has_drift.then_some("--exposure");
    command_text(words.into_iter().chain(material_options(data).iter().copied()).chain(exposure))
}

/// Options of a training with materials: those of objects that masks or alpha cut out of all
/// pictures are the default; others are fitted with the surroundings in the background.
pub(crate) fn material_options(data: &Dataset) -> &'static [&'static str] {
    if data.train.iter().all(View::has_alpha) { &[] } else { &["--relightable", "--foreground", "auto"] }
}

/// Makes a data set, or continues to.
pub(crate) fn capture(inputs: &[PathBuf], folder: &Path, options: &CaptureOptions) -> Result<Outcome, Failure> {
    if let Some(input) = inputs.iter().find(|input| is_scene(input)) {
        return Err(Failure::Input(format!(
            "{input:?} is a scene, not photographs; look at it with specula view {}",
            shown(input)
        )));
    }
    specula_capture::check(inputs)?;
    let place = PathBuf::from(output::absolute(folder));
    if let Some(input) = inputs.iter().find(|input| input.is_dir() && place.starts_with(output::absolute(input))) {
        return Err(Failure::Input(format!(
            "{folder:?} is in {input:?}, whose pictures are the input; use a folder outside with -o"
        )));
    }
    refuse_other_contents(folder)?;
    for input in inputs.iter().filter(|input| has_files(input)) {
        let line = command_text(["specula", "train", &input.to_string_lossy(), "-m", "out/model"]);
        tracing::warn!("{input:?} has cameras, which are not used; to keep them: {line}");
    }
    output::make_folder(folder)?;
    let _lock = output::lock(folder)?;
    interrupt::watch()?;
    let CaptureOptions { frames, masks, mask_with, lens, best, colmap } = options.clone();
    let below = |input: &PathBuf| {
        let folders = std::fs::read_dir(input).into_iter().flatten().flatten().map(|entry| entry.path());
        let folders = folders.filter(|path| path.is_dir() && !path.ends_with("masks"));
        core::iter::once(input.clone()).chain(folders).map(|folder| folder.join("masks")).collect::<Vec<_>>()
    };
    let unused = inputs.iter().flat_map(below).find(|folder| folder.is_dir());
    if let (Some(unused), None, None) = (unused, &masks, &mask_with) {
        tracing::warn!("{unused:?} is not used; name it with --masks to cut out the object");
    }
    let options = Options {
        inputs: inputs.to_vec(),
        output: folder.to_owned(),
        frames: frames.map(|frames| frames as usize),
        masks,
        mask_with,
        lens,
        is_best: best,
        colmap,
    };
    Ok(specula_capture::capture(&options, &Shown::default())?)
}

/// Whether a path is a model, or a file of Gaussians.
fn is_scene(path: &Path) -> bool {
    const ENDINGS: [&str; 5] = ["ply", "splat", "spz", "glb", "gltf"];
    match path.is_dir() {
        true => model_folder::latest_iteration(path).is_ok(),
        false => output::ending(path).is_some_and(|ending| ENDINGS.contains(&ending.as_str())),
    }
}

/// Refuses a folder of a model, or of a data set that is no capture.
pub(crate) fn refuse_other_contents(folder: &Path) -> Result<(), Failure> {
    let contents = if model_folder::holds_training(folder) {
        "a model"
    } else if has_files(folder) && !folder.join("capture.json").is_file() {
        "another data set"
    } else {
        return Ok(());
    };
    Err(Failure::Input(format!("{folder:?} already contains {contents}; use another folder with -o")))
}

/// Findings about a data set.
///
/// # Errors
///
/// A reconstruction that cannot be read.
pub(crate) fn findings(folder: &Path, data: &Dataset) -> Result<Vec<Finding>, Failure> {
    let reconstruction = Reconstruction::of_dataset(folder)?;
    let views: Vec<&View> = data.train.iter().chain(&data.test).collect();
    let look = |view: &&View| Look::of_rgba(&view.name, &view.rgba, view.camera.width as usize);
    let looks: Vec<Look> = views.iter().map(look).collect();
    let positions: Vec<[f64; 3]> = views.iter().map(|view| view.camera.position.to_array().map(f64::from)).collect();
    let orientation = data.orientation.as_ref().map(|found| (found.up, found.centre));
    let pictures = picture_names(&folder.join("images"));
    let registered = reconstruction.iter().flat_map(|found| &found.pictures);
    let registered: HashSet<&str> = registered.map(|picture| picture.name.as_str()).collect();
    let lost: Vec<String> = pictures.iter().filter(|name| !registered.contains(name.as_str())).cloned().collect();
    let evidence = Evidence {
        pictures: pictures.len().max(views.len()),
        lost: &lost,
        reconstruction: reconstruction.as_ref(),
        looks: &looks,
        orientation,
        positions: &positions,
    };
    Ok(specula_capture::findings(&evidence))
}

/// Finding as a sentence.
pub(crate) fn sentence(Finding { cause, remedy, .. }: &Finding) -> String {
    format!("{cause}; {remedy}")
}

/// Progress of a capture as that of the program.
#[derive(Debug, Default)]
struct Shown(RefCell<Option<Work>>);

impl Monitor for Shown {
    fn begin(&self, title: &'static str, steps: u64) {
        *self.0.borrow_mut() = Some(progress::work(title, steps));
    }

    fn done(&self, steps: u64) {
        if let Some(work) = &*self.0.borrow() {
            work.done(steps, String::new);
        }
    }

    fn end(&self) {
        self.0.take().into_iter().for_each(Work::finish);
    }

    fn is_interrupted(&self) -> bool {
        interrupt::is_requested()
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match error {
            Error::File(error) => error.into(),
            Error::Interrupted => Self::Interrupted(error.to_string()),
            Error::Input(_) | Error::Program { .. } | Error::NoCameras(_) => Self::Input(error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_of_surroundings_are_asked_for_and_those_of_objects_are_the_default() {
        let objects = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/demo");
        let mut data = progress::silently(|| dataset::load(&objects, &LoadOptions::default())).unwrap();
        let folder = Path::new("my data");
        assert_eq!(
            next_command(folder, &data, false),
            "specula train 'my data' -m 'out/my data' --preset photos --eval"
        );
        data.train[0].rgba.iter_mut().skip(3).step_by(4).for_each(|alpha| *alpha = u8::MAX);
        let next = next_command(folder, &data, false);
        assert!(next.ends_with("--preset photos --eval --relightable --foreground auto"), "{next}");
        assert!(next_command(folder, &data, true).ends_with("--foreground auto --exposure"));
    }
}
