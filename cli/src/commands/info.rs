//! `specula info`: the contents of a model, a PLY file or a data set.

use crate::{args::Info, dataset, failure::Failure, output, scene};
use specula_io::{Error, dataset::LoadOptions, points_ply};
use specula_report::contents::Contents;
use specula_scene::OpenedModel;
use std::path::Path;

/// Prints the contents.
pub(crate) fn run(args: &Info) -> Result<(), Failure> {
    let contents = if specula_io::dataset::is_dataset(&args.path) {
        Contents::of_dataset(&args.path, &dataset::load(&args.path, &LoadOptions::default())?)
    } else {
        match scene::open(&args.path, None, None) {
            Ok(opened) => of_model(&args.path, &opened)?,
            Err(Failure::File(Error::MissingProperty { path, property, layout })) => {
                let points = points_ply::read(&path);
                let points = points.map_err(|_| Error::MissingProperty { path: path.clone(), property, layout })?;
                Contents::of_points(&path, &points)
            }
            Err(failure) => return Err(failure),
        }
    };
    if args.json { output::say_json(&contents.to_json()) } else { output::say(&contents.text()) }
}

fn of_model(path: &Path, opened: &OpenedModel) -> Result<Contents, Failure> {
    let mut contents = Contents::of_model(path, opened)?;
    if opened.scene.light.is_none() {
        contents.remark("light", "; name one with --env where it is needed");
    }
    Ok(contents)
}
