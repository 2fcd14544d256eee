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
use specula_capture::{Error, Evidence, Finding, Look, Monitor, Options, Outcome};
use specula_io::{dataset::LoadOptions, reconstruction::Reconstruction};
use specula_scene::{
    dataset::{Dataset, count_pictures},
    text::shown,
};
use specula_train::view::View;
use std::path::{Path, PathBuf};

/// Captures, diagnoses, and names the next command.
pub(crate) fn run(args: &Capture) -> Result<(), Failure> {
    let outcome = capture(&args.inputs, &args.output, &args.options)?;
    let data = dataset::load(&args.output, &LoadOptions::default())?;
    let findings = findings(&args.output, &data)?;
    output::write_json(&args.output.join("capture/findings.json"), &json!(findings))?;
    let Outcome { pictures, registered } = outcome;
    output::say(&format!("{}: {registered} of {pictures} pictures have a camera", shown(&args.output)))?;
    findings.iter().try_for_each(|finding| output::say(&sentence(finding)))?;
    tracing::info!("next: specula train {} -m MODEL --preset photos --eval", shown(&args.output));
    Ok(())
}

/// Makes a data set, or continues to.
pub(crate) fn capture(inputs: &[PathBuf], folder: &Path, options: &CaptureOptions) -> Result<Outcome, Failure> {
    specula_capture::check(inputs)?;
    output::make_folder(folder)?;
    let _lock = output::lock(folder)?;
    interrupt::watch()?;
    let CaptureOptions { frames, masks, mask_with, lens, best, colmap } = options.clone();
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
    let pictures = count_pictures(&folder.join("images")).max(views.len());
    let evidence = Evidence {
        pictures,
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
