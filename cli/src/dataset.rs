//! Data sets, loaded with progress and notes.

use crate::{failure::Failure, output, progress};
use specula_io::{
    Error,
    dataset::LoadOptions,
    orientation::{Orientation, UpSource},
};
use specula_scene::{
    SceneError,
    capture::{Capture, Reading},
    dataset::{Dataset, Misplaced},
    number::counted,
    orientation,
    text::shown,
};
use specula_train::exchange::Exchange;
use std::path::Path;

/// Loads a data set and prints notes about it.
///
/// # Errors
/// Those of [`Dataset::load`], with the folder of a nearby data set as a suggestion.
pub(crate) fn load(folder: &Path, options: &LoadOptions) -> Result<Dataset, Failure> {
    let work = progress::work("loading", 0);
    let data = Dataset::load(folder, options, |done, all| {
        work.set_steps(all as u64);
        work.done(done as u64, String::new);
    });
    work.finish();
    let data = data.map_err(|error| suggestion(folder, &error).unwrap_or_else(|| error.into()))?;
    note(&data.summary(), &data.notes, data.orientation.as_ref(), data.width_max());
    Ok(data)
}

/// Reads the description of a data set for a training, and prints notes about it.
///
/// # Errors
/// Those of [`Capture::read`], with the folder of a nearby data set as a suggestion.
pub(crate) fn read(reading: &Reading<'_>, exchange: Option<&mut dyn Exchange>) -> Result<Capture, Failure> {
    let work = progress::work("loading", 0);
    let data = Capture::read(reading, exchange, |done, all| {
        work.set_steps(all as u64);
        work.done(done as u64, String::new);
    });
    work.finish();
    let data = data.map_err(|error| match &error {
        SceneError::File(cause) => suggestion(reading.folder, cause).unwrap_or_else(|| error.into()),
        _ => error.into(),
    })?;
    note(&data.summary(), &data.notes, data.orientation.as_ref(), data.width_max());
    Ok(data)
}

fn note(summary: &str, notes: &[String], orientation: Option<&Orientation>, width_max: u32) {
    tracing::info!("{summary}");
    notes.iter().for_each(|note| tracing::info!("{note}"));
    orientation.into_iter().for_each(note_orientation);
    note_width(width_max);
}

/// Prints the up direction of a data set, and the option that corrects it if it is uncertain.
pub(crate) fn note_orientation(found: &Orientation) {
    tracing::info!("{}{}", orientation::description(found), correction(found));
}

/// Prints the up direction if it is a guess, and the option that corrects it.
pub(crate) fn note_guessed_up(found: &Orientation) {
    if found.up_source == UpSource::Nothing {
        note_orientation(found);
    }
}

fn correction(Orientation { up, up_source, error_degrees, cameras, .. }: &Orientation) -> &'static str {
    match (up_source, error_degrees) {
        (UpSource::Nothing, _) if *cameras == 0 && *up == [0.0, 0.0, 1.0] => {
            "; if it is wrong, set --scene-up, often to -y; a room shows only from inside: specula view, then f to fly"
        }
        (UpSource::Nothing, _) if *cameras == 0 => {
            "; if it is wrong, set --scene-up, often to z; a room shows only from inside: specula view, then f to fly"
        }
        (UpSource::Hand | UpSource::File, _) | (UpSource::Upright | UpSource::Height, Some(_)) => "",
        (UpSource::Level, Some(_)) => "; if it is the opposite, set --scene-up X,Y,Z",
        (UpSource::Mean | UpSource::Nothing, _) | (_, None) => "; if it is wrong, set --scene-up X,Y,Z",
    }
}

/// Prints advice for pictures that are wider than usual.
fn note_width(width_max: u32) {
    const WIDE: u32 = 1600;
    let factor = [2, 4, 8].into_iter().find(|factor| width_max / factor <= WIDE).unwrap_or(8);
    if width_max > WIDE {
        tracing::info!(
            "pictures are up to {width_max} pixels wide; with -r {factor} training takes far less time and memory"
        );
    }
}

/// Error for a folder that is neither a data set nor a model, but near one or without cameras.
pub(crate) fn suggestion(folder: &Path, error: &Error) -> Option<Failure> {
    let (has_cameras, is_model_wanted) = match error {
        Error::NoFolder { .. } | Error::NoTransforms { .. } => (false, false),
        Error::NoImages { .. } => (true, false),
        Error::NoModel { .. } => (false, true),
        _ => return None,
    };
    Some(Failure::Input(match Misplaced::find(folder)? {
        Misplaced::CamerasOf { .. } | Misplaced::Pictures { .. } | Misplaced::Video(_) if has_cameras => return None,
        Misplaced::Picture | Misplaced::File | Misplaced::Model if is_model_wanted => return None,
        Misplaced::PartOf(whole) => {
            format!("{folder:?} is part of a data set; did you mean the folder above, {whole:?}?")
        }
        Misplaced::Model => {
            format!("{folder:?} is a model, not a data set; to continue its training, use -m {folder:?} --resume")
        }
        Misplaced::ParentOf(meant) => {
            let names: Vec<String> = meant.iter().map(|data| format!("{data:?}")).collect();
            format!("{folder:?} is not a data set; did you mean {}, which it contains?", names.join(" or "))
        }
        Misplaced::CamerasOf { program, remedy } => {
            format!("{folder:?} has cameras of {program}, which are not supported; {remedy}")
        }
        Misplaced::Pictures { count, .. } if is_model_wanted => format!(
            "{folder:?} has {}, but is not a model; specula make {name} -o out/{} makes one, specula capture {name} -o data a \
             data set",
            counted(count, "picture"),
            output::stem(folder),
            name = shown(folder)
        ),
        Misplaced::Pictures { count, folder: pictures, unread: Some(ending) } => format!(
            "{pictures:?} has {} in .{ending}, which specula does not read, and {folder:?} has no cameras; convert \
             them to JPEG, such as with magick mogrify -format jpg {}, and estimate their cameras with specula capture",
            counted(count, "picture"),
            shown(&pictures.join(format!("*.{ending}")))
        ),
        Misplaced::Pictures { count, folder: pictures, unread: None } => format!(
            "{pictures:?} has {}, but {folder:?} has no cameras (transforms_train.json, transforms.json \
             or sparse/0); specula make {name} -o out/{stem} estimates them and makes a scene, specula capture {name} -o \
             data/{stem} only a data set",
            counted(count, "picture"),
            name = shown(folder),
            stem = output::stem(folder)
        ),
        Misplaced::Picture => {
            format!("{folder:?} is a picture; give the folder of its data set, with the cameras of all pictures")
        }
        Misplaced::File => {
            format!("{folder:?} is a file, not the folder of a data set; a scene opens with specula view or info")
        }
        Misplaced::Video(path) => format!(
            "{path:?} is a video; select frames and estimate their cameras: specula capture {} -o data",
            shown(&path)
        ),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demos_cameras_have_exactly_z_above() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/demo");
        let data = load(&folder, &LoadOptions::default()).unwrap();
        let found = data.orientation.unwrap();
        assert_eq!((found.up, found.rolled), ([0.0, 0.0, 1.0], 0), "{found:?}");
        assert!(found.error_degrees.is_some_and(|error| error < 0.5), "{found:?}");
        assert_eq!(correction(&found), "");
        let unsure = Orientation { up_source: UpSource::Mean, error_degrees: None, ..found };
        assert!(correction(&unsure).contains("--scene-up"));
    }
}
