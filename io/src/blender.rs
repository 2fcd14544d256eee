//! Scenes of NeRF Synthetic and Shiny Blender: a list of training views and one of test views.

use crate::{
    error::Result,
    listing::{Listing, LoadOptions},
    shot::{NormalFiles, Shot},
    transforms::{Frame, Transforms},
};
use std::path::Path;

/// List of training views, which identifies the format.
pub(crate) const TRAIN: &str = "transforms_train.json";
/// List of test views.
const TEST: &str = "transforms_test.json";

/// Lists a scene. All images are searched before any is decoded, so that a missing one is reported
/// at once.
pub(crate) fn list(folder: &Path, options: &LoadOptions) -> Result<Listing> {
    let train = Transforms::read(&folder.join(TRAIN))?;
    let mut listing = Listing { source: format!("{:?}", train.path()), ..Listing::default() };
    let test = read_test(folder, &mut listing.notes)?;
    listing.train = shots(&train, options, |_| None, &mut listing.notes)?;
    if let Some(test) = &test {
        listing.test = shots(test, options, normals_beside, &mut listing.notes)?;
    }
    Ok(listing)
}

fn read_test(folder: &Path, notes: &mut Vec<String>) -> Result<Option<Transforms>> {
    let path = folder.join(TEST);
    if path.is_file() {
        return Transforms::read(&path).map(Some);
    }
    notes.push(format!("no {path:?}, so there are no test views"));
    Ok(None)
}

fn shots(
    transforms: &Transforms,
    options: &LoadOptions,
    normal_of: impl Fn(&Path) -> Option<NormalFiles>,
    notes: &mut Vec<String>,
) -> Result<Vec<Shot>> {
    let mut shots = Vec::with_capacity(transforms.frames.len());
    for frame in &transforms.frames {
        if frame.is_macos_shadow() {
            notes.push(format!("skipped {:?}, which macOS made for its own use", frame.file_path));
            continue;
        }
        shots.push(shot(transforms, frame, options, &normal_of)?);
    }
    Ok(shots)
}

fn shot(
    transforms: &Transforms,
    frame: &Frame,
    options: &LoadOptions,
    normal_of: &impl Fn(&Path) -> Option<NormalFiles>,
) -> Result<Shot> {
    let image = transforms.image_of(frame)?;
    Ok(Shot {
        name: frame.name(),
        mask: None,
        normal: normal_of(&image),
        pose: transforms.pose(frame)?,
        // Sizes in these lists may belong to larger images of another shape.
        measured_size: None,
        lens: Box::new(transforms.lens(frame)),
        downscale: options.downscale,
        image,
    })
}

/// Normal map of an image, `r_0_normal.png` beside `r_0.png`. Opaque images, such as those of
/// `ball` in Shiny Blender, have their coverage in `r_0_alpha.png`.
fn normals_beside(image: &Path) -> Option<NormalFiles> {
    let stem = image.file_stem()?.to_string_lossy();
    let beside = |kind: &str| Some(image.with_file_name(format!("{stem}_{kind}.png"))).filter(|path| path.is_file());
    Some(NormalFiles { map: beside("normal")?, coverage: beside("alpha") })
}
