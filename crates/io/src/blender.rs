//! Scenes of NeRF Synthetic and Shiny Blender: a list of training views and one of test views.

use crate::{
    error::{Error, Result},
    listing::{Listing, LoadOptions},
    masks,
    materials::MaterialFiles,
    named::{Files, plain_path},
    nerfstudio,
    photographs::{Folders, found, note_idle_rule, some_of},
    shot::{NormalFiles, Shot},
    transforms::{Frame, Transforms},
};
use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

/// List of training views, which identifies the format.
pub(crate) const TRAIN: &str = "transforms_train.json";
/// List of test views.
const TEST: &str = "transforms_test.json";

/// Lists a scene. All images are searched before any is decoded, so that missing ones are reported
/// at once.
pub(crate) fn list(files: &Files, options: &LoadOptions) -> Result<Listing> {
    let train = Transforms::read(&files.root.join(TRAIN))?;
    if train.rest.ply_file_path.is_some() && !files.root.join(TEST).is_file() {
        // The list may be nerfstudio's under another name.
        return nerfstudio::list_of(train, files, options);
    }
    let mut notes = train.notes();
    let images = options.other_images().unwrap_or(Path::new("")).to_owned();
    let folders = Folders { files, images };
    let test = read_test(&files.root, &mut notes)?;
    let trained = placed(&train, files, options, &mut notes);
    let mut shots = find(&train, &trained, &folders, options, &mut notes)?;
    let train_count = shots.len();
    if let Some(test) = &test {
        let held_out = apart(placed(test, files, options, &mut notes), &trained, &mut notes);
        shots.extend(find_test(test, &held_out, &folders, options, &mut notes)?);
    }
    let masks = masks::assign(files, &folders.images, &mut shots, &mut notes);
    note_idle_rule(options, &mut notes);
    let used = [TRAIN, TEST].map(|list| files.root.join(list)).into_iter().chain(masks).collect();
    let held_out = if shots.len() > train_count { format!("named by {TEST}") } else { "none".into() };
    let source = train.description();
    let mut listing = Listing { source, held_out, notes, used, ..Listing::default() };
    listing.points = nerfstudio::named_points(&train, files, options, &mut listing)?;
    let mut shots = shots.into_iter().map(|(_, shot)| shot);
    listing.train = shots.by_ref().take(train_count).collect();
    listing.test = shots.collect();
    Ok(listing)
}

/// Reads the list of test views, if there is one with views.
fn read_test(folder: &Path, notes: &mut Vec<String>) -> Result<Option<Transforms>> {
    let path = folder.join(TEST);
    if !path.is_file() {
        notes.push(format!("no {path:?}, so there are no test views"));
        return Ok(None);
    }
    match Transforms::read(&path) {
        Err(Error::NoFrames { .. }) => {
            notes.push(format!("no frames in {path:?}, so there are no test views"));
            Ok(None)
        }
        read => read.map(Some),
    }
}

/// Frames of a list with the paths of their images.
type Placed<'a> = Vec<(&'a Frame, PathBuf)>;

fn placed<'a>(list: &'a Transforms, files: &Files, options: &LoadOptions, notes: &mut Vec<String>) -> Placed<'a> {
    list.frames.iter().zip(list.places(files, options, notes)).collect()
}

/// Frames without those whose image was resolved to that of a training view.
fn apart<'a>(held_out: Placed<'a>, trained: &Placed<'_>, notes: &mut Vec<String>) -> Placed<'a> {
    let trained: HashMap<&Path, &str> =
        trained.iter().map(|(frame, place)| (place.as_path(), frame.file_path.as_str())).collect();
    let is_apart = |(frame, place): &(&Frame, PathBuf)| {
        trained.get(place.as_path()).is_none_or(|name| plain_path(name) == plain_path(&frame.file_path))
    };
    let (apart, others): (Placed<'_>, Placed<'_>) = held_out.into_iter().partition(is_apart);
    if !others.is_empty() {
        let names: Vec<&str> = others.iter().map(|(frame, _)| frame.file_path.as_str()).collect();
        notes.push(format!(
            "skipped {} test views that share an image with a training view: {}",
            names.len(),
            some_of(&names)
        ));
    }
    apart
}

/// Finds the images of a list, in its order.
fn find(
    list: &Transforms,
    frames: &Placed<'_>,
    folders: &Folders<'_>,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<(PathBuf, Shot)>> {
    // Sizes in these lists may be those of larger images with another aspect ratio.
    let posed: Result<Vec<_>> = frames.iter().map(|(frame, image)| list.posed(frame, image.clone(), None)).collect();
    found(posed?, folders, options, notes)
}

/// Finds the test views with their ground truth. A list whose pictures were never rendered has
/// none.
fn find_test(
    test: &Transforms,
    frames: &Placed<'_>,
    folders: &Folders<'_>,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<(PathBuf, Shot)>> {
    if frames.is_empty() {
        return Ok(Vec::new());
    }
    let mut shots = match find(test, frames, folders, options, notes) {
        Err(error @ (Error::NoImages { .. } | Error::UnreadFormat { .. })) => {
            notes.push(format!("there are no test views of {:?}: {error}", test.path()));
            Vec::new()
        }
        shots => shots?,
    };
    for (_, shot) in &mut shots {
        (shot.normal, shot.materials) = truth_beside(&shot.image);
    }
    Ok(shots)
}

/// Files of the ground truth beside an image `r_0.png`: `r_0_normal.png`, `r_0_albedo.png`,
/// `r_0_material.png`. Opaque images, such as those of `ball` in Shiny Blender, have their coverage
/// in `r_0_alpha.png`.
fn truth_beside(image: &Path) -> (Option<NormalFiles>, MaterialFiles) {
    let stem = image.file_stem().unwrap_or_default();
    let named = |kind: &str| image.with_file_name(format!("{}_{kind}.png", stem.to_string_lossy()));
    let beside = |kind: &str| Some(named(kind)).filter(|path| path.is_file());
    let normal = beside("normal").map(|map| NormalFiles { map, coverage: beside("alpha") });
    (normal, MaterialFiles { albedo: beside("albedo"), surface: beside("material") })
}
