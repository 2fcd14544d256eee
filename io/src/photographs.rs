//! Listing of photographs from one list of cameras: a folder of images, optional smaller copies and
//! masks beside it, and held-out views.
//!
//! A data set becomes a list of shots, each with a file, a pose and a lens, before any picture is
//! opened. Shots are then opened, masked, reduced and undistorted, so that executors only see
//! pinholes and no kernel knows a lens. COLMAP addresses pixels as stored; EXIF orientation is
//! applied only where a picture has the shape of its camera after rotation, and not before.
//! Pictures remain bytes throughout; reducing one needs a row of sums.

use crate::{
    error::{Error, Result},
    lens::Lens,
    listing::{Listing, LoadOptions},
    materials::MaterialFiles,
    shot::{Pose, Shot, find_image, find_mask, is_macos_shadow, name_of, without_image_ending},
};
use std::{collections::HashSet, path::PathBuf};

/// Folder of masks, beside the folder of images.
const MASKS: &str = "masks";
/// Most names that a note spells out.
const NAMES_MAX: usize = 3;

/// A camera of a list, with the name of its image.
pub(crate) struct Posed {
    /// Image, relative to the folder of images.
    pub(crate) image: PathBuf,
    /// Mask, where the list names one.
    pub(crate) mask: Option<PathBuf>,
    pub(crate) pose: Pose,
    pub(crate) measured_size: Option<[u32; 2]>,
    pub(crate) lens: Box<dyn Fn([u32; 2]) -> Result<Lens> + Send + Sync>,
}

/// Rule for held-out views.
pub(crate) enum HeldOut {
    /// Every Nth view by name, from the first, is held out; none for 0.
    Every(u32),
    /// Images that the list names.
    Named(HashSet<PathBuf>),
}

/// Folders of a data set.
pub(crate) struct Folders {
    /// Root of the data set.
    pub(crate) root: PathBuf,
    /// Folder of the images.
    pub(crate) images: PathBuf,
}

impl Folders {
    /// Finds the image of a camera and its remaining downscaling factor. A copy in a folder such as
    /// `images_4` is taken where it exists and the calibrated size of the lens is known.
    fn image_of(&self, camera: &Posed, downscale: u32) -> Option<(PathBuf, u32)> {
        let may_be_copy = downscale > 1 && camera.measured_size.is_some();
        let copy = may_be_copy.then(|| find_image(&self.smaller(downscale).join(&camera.image))).flatten();
        copy.map(|copy| (copy, 1)).or_else(|| Some((find_image(&self.images.join(&camera.image))?, downscale)))
    }

    /// Folder of smaller copies: `images_4` for `images`.
    fn smaller(&self, downscale: u32) -> PathBuf {
        let mut name = self.images.as_os_str().to_owned();
        name.push(format!("_{downscale}"));
        name.into()
    }
}

/// Lists photographs by name. Missing images are skipped with a note, since users delete blurred
/// ones.
///
/// # Errors
///
/// [`Error::NoImages`], where all are missing.
pub(crate) fn list(posed: Vec<Posed>, folders: &Folders, held_out: &HeldOut, options: &LoadOptions) -> Result<Listing> {
    let mut listing = Listing::default();
    let mut found = Vec::with_capacity(posed.len());
    let mut missing = Vec::new();
    let mut copies = 0;
    for camera in posed {
        match folders.image_of(&camera, options.downscale) {
            _ if is_macos_shadow(&camera.image) => missing.push(camera.image),
            Some((file, downscale)) => {
                copies += usize::from(downscale != options.downscale);
                found.push((camera.image.clone(), shot(camera, file, downscale, folders)));
            }
            None => missing.push(camera.image),
        }
    }
    if found.is_empty() {
        let first = missing.first().cloned().unwrap_or_default();
        return Err(Error::NoImages { data: folders.root.clone(), path: folders.images.clone(), first });
    }
    note_copies(&mut listing.notes, copies, found.len(), folders, options.downscale);
    note_missing(&mut listing.notes, &missing, folders);
    found.sort_by(|(one, _), (other, _)| one.cmp(other));
    name_apart(&mut found);
    for (index, (image, shot)) in found.into_iter().enumerate() {
        let is_test = match held_out {
            HeldOut::Every(every) => *every > 0 && index.is_multiple_of(*every as usize),
            HeldOut::Named(names) => names.contains(&image),
        };
        if is_test { listing.test.push(shot) } else { listing.train.push(shot) }
    }
    Ok(listing)
}

fn shot(camera: Posed, file: PathBuf, downscale: u32, folders: &Folders) -> Shot {
    let Posed { image, mask, pose, measured_size, lens } = camera;
    let mask = mask.or_else(|| find_mask(&folders.root.join(MASKS), &image));
    Shot {
        name: name_of(&image),
        image: file,
        mask,
        normal: None,
        materials: MaterialFiles::default(),
        pose,
        measured_size,
        lens,
        downscale,
    }
}

/// Adds folders to the names of views where names would be equal otherwise.
fn name_apart(found: &mut [(PathBuf, Shot)]) {
    let names: HashSet<&str> = found.iter().map(|(_, shot)| shot.name.as_str()).collect();
    if names.len() < found.len() {
        for (image, shot) in found {
            shot.name = without_image_ending(image).to_string_lossy().replace('\\', "/");
        }
    }
}

fn note_copies(notes: &mut Vec<String>, copies: usize, all: usize, folders: &Folders, downscale: u32) {
    if copies > 0 {
        let rest = match all - copies {
            0 => String::new(),
            rest => format!("; {rest} are not there and were made smaller"),
        };
        notes.push(format!("{copies} images are those of {:?}{rest}", folders.smaller(downscale)));
    }
}

fn note_missing(notes: &mut Vec<String>, missing: &[PathBuf], folders: &Folders) {
    if !missing.is_empty() {
        let names: Vec<String> = missing.iter().take(NAMES_MAX).map(|image| format!("{image:?}")).collect();
        let more = if missing.len() > NAMES_MAX { ", …" } else { "" };
        let count = missing.len();
        notes.push(format!(
            "skipped {count} cameras without an image in {:?}: {}{more}",
            folders.images,
            names.join(", ")
        ));
    }
}
