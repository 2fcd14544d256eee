//! Listing of photographs from lists of cameras: a folder of images, optional smaller copies and
//! masks, and held-out views.
//!
//! A data set becomes a list of shots, each with a file, a pose and a lens, before any picture is
//! opened. Shots are then opened, masked, reduced and undistorted, so executors and kernels only
//! see pinhole cameras. COLMAP addresses pixels as stored; EXIF orientation is applied only if a
//! picture has the aspect ratio of its camera after rotation and not before. Pictures remain bytes
//! throughout; reducing one needs a row of sums.

use crate::{
    color_space::InputSpace,
    error::{Error, Result},
    lens::Lens,
    listing::{Listing, LoadOptions, TEST_EVERY},
    masks,
    materials::MaterialFiles,
    named::{Absent, Files, key_of, stem_of},
    shot::{PictureLight, Pose, Shot, find_image, is_macos_shadow, name_of, without_image_ending},
};
use core::fmt::Debug;
use std::{
    collections::{HashMap, HashSet, hash_map::Entry},
    path::{Path, PathBuf},
};

/// Maximum number of names in a note.
const NAMES_MAX: usize = 3;
/// Factors of smaller copies; the largest copies are used if there are no other images.
const COPIES: [u32; 3] = [2, 4, 8];

/// A camera of a list, with the name of its image.
pub(crate) struct Posed {
    /// Image, relative to the folder of images.
    pub(crate) image: PathBuf,
    /// Mask as the list names it.
    pub(crate) mask: Option<String>,
    pub(crate) pose: Pose,
    pub(crate) light: PictureLight,
    pub(crate) measured_size: Option<[u32; 2]>,
    pub(crate) lens: Box<dyn Fn([u32; 2]) -> Result<Lens> + Send + Sync>,
}

/// Rule for held-out views.
pub(crate) enum HeldOut {
    /// N to hold out every Nth view by name, from the first; 0 for none.
    Every(u32),
    /// Images that the list names, by their keys without endings.
    Named(HashSet<String>),
}

/// Files of a data set, and its folder of images below their root.
pub(crate) struct Folders<'a> {
    pub(crate) files: &'a Files,
    pub(crate) images: PathBuf,
}

/// File of an image, and its remaining downscaling factor.
type Place = core::result::Result<(PathBuf, u32), Absent>;

impl<'a> Folders<'a> {
    /// Images of the options' folder, or the data set's own where it has no such folder, but
    /// pictures of these names.
    pub(crate) fn of<'n>(files: &'a Files, names: impl IntoIterator<Item = &'n str>, options: &LoadOptions) -> Self {
        let is_default = options.other_images().is_none() && files.folder(Path::new(&options.images)).is_none();
        let has_pictures = || names.into_iter().any(|name| files.picture(Path::new(name)).is_ok());
        let images = if is_default && has_pictures() { PathBuf::new() } else { PathBuf::from(&options.images) };
        Self { files, images }
    }

    /// Folder of the images.
    fn path(&self) -> PathBuf {
        self.files.root.join(&self.images)
    }

    /// Finds the image of a camera and its remaining downscaling factor. A copy in a folder such as
    /// `images_4` is used if it exists and the calibrated size of the lens is known.
    fn image_of(&self, camera: &Posed, downscale: u32) -> Place {
        let may_be_copy = downscale > 1 && camera.measured_size.is_some();
        let copy = may_be_copy.then(|| find_image(&self.smaller(downscale).join(&camera.image))).flatten();
        copy.map_or_else(
            || Ok((self.files.picture(&self.images.join(&camera.image))?, downscale)),
            |copy| Ok((copy, 1)),
        )
    }

    /// Images of all cameras in the largest smaller copies, with their folder.
    fn copies_of(&self, posed: &[Posed], downscale: u32) -> Option<(Vec<Place>, PathBuf)> {
        let copies = |factor: u32| {
            let copy = |camera: &Posed| match camera.measured_size {
                Some(_) => {
                    Ok((self.files.picture(&self.smaller(factor).join(&camera.image))?, (downscale / factor).max(1)))
                }
                None => Err(Absent::Missing),
            };
            (posed.iter().map(copy).collect::<Vec<Place>>(), self.smaller(factor))
        };
        COPIES.into_iter().map(copies).find(|(places, _)| places.iter().flatten().next().is_some())
    }

    /// Folder of smaller copies: `images_4` for `images`.
    fn smaller(&self, downscale: u32) -> PathBuf {
        let mut name = self.path().into_os_string();
        name.push(format!("_{downscale}"));
        name.into()
    }

    /// Error for a list without any existing image.
    fn none_of(&self, posed: &[Posed], places: &[Place]) -> Error {
        let first = posed.first().map_or(PathBuf::new(), |camera| camera.image.clone());
        let unread = |place: &Place| match place {
            Err(Absent::Unread(path)) => Some(path.clone()),
            _ => None,
        };
        match places.iter().find_map(unread) {
            Some(path) => Error::UnreadFormat { path: self.files.root.join(path) },
            None => {
                let elsewhere = self.files.folder_with(&first);
                Error::NoImages { data: self.files.root.clone(), path: self.path(), first, elsewhere }
            }
        }
    }
}

/// Lists photographs by name.
///
/// # Errors
///
/// Those of [`found`].
pub(crate) fn list(
    posed: Vec<Posed>,
    folders: &Folders<'_>,
    held_out: &HeldOut,
    options: &LoadOptions,
) -> Result<Listing> {
    let mut listing = Listing::default();
    let mut found = found(posed, folders, options, &mut listing.notes)?;
    listing.used.extend(masks::assign(folders.files, &folders.images, &mut found, &mut listing.notes));
    found.sort_by(|(one, _), (other, _)| one.cmp(other));
    name_apart(&mut found);
    for (index, (image, shot)) in found.into_iter().enumerate() {
        let is_test = match held_out {
            HeldOut::Every(every) => *every > 0 && index.is_multiple_of(*every as usize),
            HeldOut::Named(names) => names.contains(stem_of(&key_of(&image))),
        };
        if is_test { listing.test.push(shot) } else { listing.train.push(shot) }
    }
    listing.held_out = match held_out {
        HeldOut::Every(0) => "none".into(),
        HeldOut::Every(every) => format!("the first of every {every} by name"),
        HeldOut::Named(_) => "named by the list".into(),
    };
    if matches!(held_out, HeldOut::Named(_)) {
        note_idle_rule(options, &mut listing.notes);
    }
    Ok(listing)
}

/// Notes a rule for held-out views that does not apply.
pub(crate) fn note_idle_rule(options: &LoadOptions, notes: &mut Vec<String>) {
    if options.test_every != TEST_EVERY {
        let every = options.test_every;
        notes.push(format!("lists select the held-out views, so holding out one of every {every} has no effect"));
    }
}

/// Finds the images of cameras, in their order. Missing images are skipped with a note, because
/// users delete blurred ones.
///
/// # Errors
///
/// [`Error::NoImages`] or [`Error::UnreadFormat`], where all are missing.
pub(crate) fn found(
    posed: Vec<Posed>,
    folders: &Folders<'_>,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<(PathBuf, Shot)>> {
    let place = |camera: &Posed| match is_macos_shadow(&camera.image) {
        true => Err(Absent::Missing),
        false => folders.image_of(camera, options.downscale),
    };
    let mut places: Vec<Place> = posed.iter().map(place).collect();
    if places.iter().flatten().next().is_none() {
        let (copies, folder) =
            folders.copies_of(&posed, options.downscale).ok_or_else(|| folders.none_of(&posed, &places))?;
        notes.push(format!("no image is in {:?}; using smaller copies in {folder:?}", folders.path()));
        places = copies;
    } else {
        note_copies(notes, &places, folders, options.downscale);
    }
    let owners = owners(&posed, &places, folders);
    let (mut found, mut skipped) = (Vec::with_capacity(posed.len()), Skipped::default());
    for (index, (camera, place)) in posed.into_iter().zip(places).enumerate() {
        match place {
            Ok((file, downscale)) if owners[&file] == index => {
                found.push((camera.image.clone(), shot(camera, file, downscale, folders, &mut skipped)));
            }
            Ok(_) => skipped.twice.push(camera.image),
            Err(_) if is_macos_shadow(&camera.image) => skipped.shadows.push(camera.image),
            Err(Absent::Missing) => skipped.missing.push(camera.image),
            Err(Absent::Ambiguous) => skipped.ambiguous.push(camera.image),
            Err(Absent::Unread(path)) => skipped.unread.push(path),
        }
    }
    skipped.note(folders, notes);
    Ok(found)
}

/// Camera of each file: the one that names it exactly, else the first.
fn owners(posed: &[Posed], places: &[Place], folders: &Folders<'_>) -> HashMap<PathBuf, usize> {
    let images = folders.path();
    let mut owners = HashMap::with_capacity(posed.len());
    for (index, place) in places.iter().enumerate() {
        let Ok((file, _)) = place else { continue };
        let is_exact = |index: usize| images.join(&posed[index].image) == *file;
        match owners.entry(file.clone()) {
            Entry::Vacant(owner) => drop(owner.insert(index)),
            Entry::Occupied(mut owner) if !is_exact(*owner.get()) && is_exact(index) => drop(owner.insert(index)),
            Entry::Occupied(_) => {}
        }
    }
    owners
}

/// Images and masks that are not used.
#[derive(Default)]
struct Skipped {
    missing: Vec<PathBuf>,
    ambiguous: Vec<PathBuf>,
    unread: Vec<PathBuf>,
    twice: Vec<PathBuf>,
    shadows: Vec<PathBuf>,
    masks: Vec<String>,
}

impl Skipped {
    fn note(&self, folders: &Folders<'_>, notes: &mut Vec<String>) {
        let images = folders.path();
        let mut note = |count: usize, what: &str, names: String| {
            if count > 0 {
                notes.push(format!("skipped {count} {what}: {names}"));
            }
        };
        let lists: [(&[PathBuf], String); 5] = [
            (&self.missing, format!("cameras without an image in {images:?}")),
            (&self.ambiguous, format!("cameras with several matching images in {images:?}")),
            (&self.unread, "images of an unsupported format; convert them to PNG or JPEG".into()),
            (&self.twice, "cameras that share an image with another one".into()),
            (&self.shadows, "cameras with a macOS companion file (._*) as image".into()),
        ];
        lists.iter().for_each(|(list, what)| note(list.len(), what, some_of(list)));
        note(self.masks.len(), "masks in the list that do not exist", some_of(&self.masks));
    }
}

/// The first of some names, for a note.
pub(crate) fn some_of(names: &[impl Debug]) -> String {
    let some: Vec<String> = names.iter().take(NAMES_MAX).map(|name| format!("{name:?}")).collect();
    let more = if names.len() > NAMES_MAX { ", …" } else { "" };
    some.join(", ") + more
}

fn shot(camera: Posed, file: PathBuf, downscale: u32, folders: &Folders<'_>, skipped: &mut Skipped) -> Shot {
    let Posed { image, mask: named_mask, pose, light, measured_size, lens } = camera;
    let mask = named_mask.as_ref().and_then(|mask| folders.files.named_mask(mask).ok());
    skipped.masks.extend(named_mask.filter(|_| mask.is_none()));
    Shot {
        name: name_of(&image),
        image: file,
        space: InputSpace::Auto,
        mask,
        is_cut_out: false,
        normal: None,
        materials: MaterialFiles::default(),
        pose,
        light,
        measured_size,
        lens,
        downscale,
    }
}

/// Adds folders to the names of views that would be equal otherwise.
fn name_apart(found: &mut [(PathBuf, Shot)]) {
    let names: HashSet<&str> = found.iter().map(|(_, shot)| shot.name.as_str()).collect();
    if names.len() < found.len() {
        for (image, shot) in found {
            shot.name = without_image_ending(image).to_string_lossy().replace('\\', "/");
        }
    }
}

fn note_copies(notes: &mut Vec<String>, places: &[Place], folders: &Folders<'_>, downscale: u32) {
    let found = places.iter().flatten().count();
    let copies = places.iter().flatten().filter(|(_, remaining)| *remaining != downscale).count();
    if copies > 0 {
        let rest = match found - copies {
            0 => String::new(),
            rest => format!("; {rest} are missing there and were downscaled"),
        };
        notes.push(format!("{copies} images are those of {:?}{rest}", folders.smaller(downscale)));
    }
}
