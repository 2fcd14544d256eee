//! Scenes of NeRF Synthetic and Shiny Blender: a list of training views and one of test views.

use crate::{
    error::Result,
    listing::{Listing, LoadOptions},
    materials::MaterialFiles,
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
    listing.train = shots(&train, options, |_| Truth::default(), &mut listing.notes)?;
    if let Some(test) = &test {
        listing.test = shots(test, options, Truth::beside, &mut listing.notes)?;
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
    truth_of: impl Fn(&Path) -> Truth,
    notes: &mut Vec<String>,
) -> Result<Vec<Shot>> {
    let mut shots = Vec::with_capacity(transforms.frames.len());
    for frame in &transforms.frames {
        if frame.is_macos_shadow() {
            notes.push(format!("skipped {:?}, which macOS made for its own use", frame.file_path));
            continue;
        }
        shots.push(shot(transforms, frame, options, &truth_of)?);
    }
    Ok(shots)
}

fn shot(
    transforms: &Transforms,
    frame: &Frame,
    options: &LoadOptions,
    truth_of: &impl Fn(&Path) -> Truth,
) -> Result<Shot> {
    let image = transforms.image_of(frame)?;
    let Truth { normal, materials } = truth_of(&image);
    Ok(Shot {
        name: frame.name(),
        mask: None,
        normal,
        materials,
        pose: transforms.pose(frame)?,
        // Sizes in these lists may belong to larger images of another shape.
        measured_size: None,
        lens: Box::new(transforms.lens(frame)),
        downscale: options.downscale,
        image,
    })
}

/// Files of the ground truth of a view.
#[derive(Default)]
struct Truth {
    normal: Option<NormalFiles>,
    materials: MaterialFiles,
}

impl Truth {
    /// Files beside an image `r_0.png`: `r_0_normal.png`, `r_0_albedo.png`, `r_0_material.png`.
    /// Opaque images, such as those of `ball` in Shiny Blender, have their coverage in
    /// `r_0_alpha.png`.
    fn beside(image: &Path) -> Self {
        let Some(stem) = image.file_stem() else { return Self::default() };
        let named = |kind: &str| image.with_file_name(format!("{}_{kind}.png", stem.to_string_lossy()));
        let beside = |kind: &str| Some(named(kind)).filter(|path| path.is_file());
        Self {
            normal: beside("normal").map(|map| NormalFiles { map, coverage: beside("alpha") }),
            materials: MaterialFiles { albedo: beside("albedo"), surface: beside("material") },
        }
    }
}
