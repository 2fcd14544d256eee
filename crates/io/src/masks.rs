//! Masks of photographs: from a list, or from a folder by the names of their pictures.

use crate::{
    error::Result,
    listing::{Listing, MaskUse},
    named::{Files, is_picture, key_of, only, stem_of},
    photographs::some_of,
    pixels::Mask,
    shot::{Shot, find_mask, has_image_ending},
};
use std::{
    collections::{HashMap, HashSet},
    path::{Path, PathBuf},
};

/// Names of the folder of masks, in the data set or in its folder of images.
const FOLDERS: [&str; 2] = ["masks", "mask"];
/// Suffixes that distinguish masks from their pictures.
const ENDS: [&str; 3] = ["_mask", ".mask", "-mask"];

/// Folder of masks of a data set.
pub(crate) fn folder(files: &Files, images: &Path) -> Option<PathBuf> {
    let places = [Path::new(""), images].into_iter().flat_map(|place| FOLDERS.map(|name| place.join(name)));
    places.filter_map(|place| files.folder(&place)).next().map(Path::to_owned)
}

/// Masks of pictures, and masks of no picture.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Assigned {
    /// Mask of each picture, `None` if it has none.
    pub masks: Vec<Option<PathBuf>>,
    /// Paths of masks that match no picture, or several.
    pub unused: Vec<PathBuf>,
}

/// Assigns the masks of a folder to pictures, by their paths below the folder of images:
/// `NAME.png`, `NAME.jpg.png`, `NAME_mask.png`, `NAME.mask.png` or `NAME-mask.png`, in the
/// subfolders of the pictures or in none.
pub fn assigned(folder: &Path, pictures: &[PathBuf]) -> Assigned {
    let masks = Masks::below(&Files::below(folder), Path::new(""));
    let counts = counts_of_names(pictures.iter().map(PathBuf::as_path));
    let found: Vec<_> = pictures.iter().map(|picture| masks.of(picture, counts[&name_of(picture)] == 1)).collect();
    let used: HashSet<&Path> = found.iter().flatten().map(PathBuf::as_path).collect();
    let all = masks.paths.iter().map(|path| masks.folder.join(path));
    let unused = all.filter(|path| !used.contains(path.as_path())).collect();
    Assigned { masks: found, unused }
}

/// Number of pictures of each name.
fn counts_of_names<'a>(pictures: impl Iterator<Item = &'a Path>) -> HashMap<String, usize> {
    pictures.fold(HashMap::new(), |mut counts, picture| {
        *counts.entry(name_of(picture)).or_default() += 1;
        counts
    })
}

/// Adds masks of the folder to pictures without one, by their paths below the folder of images, and
/// notes masks and pictures that remain. Returns the folder.
pub(crate) fn assign(
    files: &Files,
    images: &Path,
    shots: &mut [(PathBuf, Shot)],
    notes: &mut Vec<String>,
) -> Option<PathBuf> {
    let masks = folder(files, images).map(|folder| Masks::below(files, &folder));
    let counts = counts_of_names(shots.iter().map(|(image, _)| image.as_path()));
    if let Some(masks) = &masks {
        let pictures: HashSet<PathBuf> = shots.iter().map(|(_, shot)| shot.image.clone()).collect();
        for (image, shot) in shots.iter_mut().filter(|(_, shot)| shot.mask.is_none()) {
            let mask = masks.of(image, counts[&name_of(image)] == 1);
            shot.mask = mask.filter(|mask| !pictures.contains(mask));
        }
        // Pictures without a camera are noted as such; their masks are as they should be.
        let is_other = |path: &Path| !pictures.contains(path) && !path.starts_with(&masks.folder);
        let others = files.paths.iter().filter(|path| is_picture(path) && is_other(&files.root.join(path)));
        let others = others.filter_map(|path| masks.of(path.strip_prefix(images).ok()?, true));
        let others: Vec<PathBuf> = others.collect();
        let used = shots.iter().filter_map(|(_, shot)| shot.mask.as_deref()).chain(others.iter().map(PathBuf::as_path));
        masks.note_unused(used.collect(), notes);
    }
    let without = shots.iter().filter(|(_, shot)| shot.mask.is_none()).count();
    if without > 0 && without < shots.len() {
        let place = masks.as_ref().map_or(String::new(), |masks| format!(" in {:?}", masks.folder));
        notes.push(format!("{without} of {} pictures have no mask{place}; all of their pixels count", shots.len()));
    }
    masks.map(|masks| masks.folder)
}

/// Largest number of masks that decide whether they cut an object out.
const SAMPLES: usize = 8;

/// Decides whether masks cut an object out, as `LoadOptions::masks` says or as the training
/// pictures suggest, and notes it.
///
/// # Errors
///
/// Those of the masks that are read.
pub(crate) fn apply(masks: MaskUse, listing: &mut Listing) -> Result<()> {
    let is_cut_out = match masks {
        MaskUse::Ignore => false,
        MaskUse::Cut => true,
        MaskUse::Auto => hide_most(&listing.train, &mut listing.notes)?,
    };
    listing.train.iter_mut().chain(&mut listing.test).for_each(|shot| shot.is_cut_out = is_cut_out);
    Ok(())
}

/// Returns whether every picture has a mask, and masks hide more than half of the pictures but not
/// all, by a sample of them.
fn hide_most(shots: &[Shot], notes: &mut Vec<String>) -> Result<bool> {
    let Some(masks) = shots.iter().map(|shot| shot.mask.as_deref()).collect::<Option<Vec<_>>>() else {
        return Ok(false);
    };
    let samples = masks.len().min(SAMPLES);
    let shares = (0..samples).map(|k| Ok(Mask::read(masks[k * masks.len() / samples])?.hidden_share()));
    let share = shares.collect::<Result<Vec<f64>>>()?.iter().sum::<f64>() / samples as f64;
    if samples == 0 || share <= 0.5 || share >= 1.0 {
        return Ok(false);
    }
    notes.push(format!(
        "masks hide {:.0} % of the pictures and cut the object out, as alpha does; if their pixels should not count \
         instead, set --masks ignore",
        100.0 * share
    ));
    Ok(true)
}

/// Masks of a folder.
struct Masks {
    folder: PathBuf,
    paths: Vec<PathBuf>,
    /// Indices of masks by the paths and by the names of their pictures.
    by_path: HashMap<String, Vec<usize>>,
    by_name: HashMap<String, Vec<usize>>,
}

impl Masks {
    fn below(files: &Files, folder: &Path) -> Self {
        let below = files.paths.iter().filter_map(|path| path.strip_prefix(folder).ok());
        let paths: Vec<PathBuf> = below.filter(|path| is_picture(path)).map(Path::to_owned).collect();
        let mut masks =
            Self { folder: files.root.join(folder), paths, by_path: HashMap::new(), by_name: HashMap::new() };
        for (index, path) in masks.paths.iter().enumerate().filter(|(_, path)| has_image_ending(path)) {
            masks.by_path.entry(mask_key(path)).or_default().push(index);
            masks.by_name.entry(name_of(path)).or_default().push(index);
        }
        masks
    }

    /// Mask of a picture, by its path, or by its name if that is unique.
    fn of(&self, image: &Path, has_own_name: bool) -> Option<PathBuf> {
        let one = |masks: &HashMap<String, Vec<usize>>, key: &str| only(masks.get(key)?.iter()).copied();
        let by_name = || one(&self.by_name, &name_of(image)).filter(|_| has_own_name);
        let alike = || one(&self.by_path, &mask_key(image)).or_else(by_name);
        find_mask(&self.folder, image).or_else(|| Some(self.folder.join(&self.paths[alike()?])))
    }

    fn note_unused(&self, used: HashSet<&Path>, notes: &mut Vec<String>) {
        let (read, unread): (Vec<&PathBuf>, Vec<_>) = self.paths.iter().partition(|path| has_image_ending(path));
        if read.is_empty() {
            notes.push(format!(
                "{:?} has no readable mask; masks are PNG or JPEG with the names of the pictures",
                self.folder
            ));
        } else if !unread.is_empty() {
            notes.push(format!(
                "{} of {} masks in {:?} have unsupported formats: {}; convert them to PNG",
                unread.len(),
                self.paths.len(),
                self.folder,
                some_of(&unread)
            ));
        }
        let is_unused = |path: &&PathBuf| !used.contains(self.folder.join(path).as_path());
        let unused: Vec<&PathBuf> = read.into_iter().filter(is_unused).collect();
        if !unused.is_empty() {
            notes.push(format!(
                "{} of {} masks in {:?} are unused, because they match no picture or several: {}; give them the names \
                 of the pictures",
                unused.len(),
                self.paths.len(),
                self.folder,
                some_of(&unused)
            ));
        }
    }
}

/// Key of the picture that a mask belongs to.
fn mask_key(path: &Path) -> String {
    let key = key_of(path);
    let stem = stem_of(&key);
    let bare = ENDS.iter().find_map(|end| stem.strip_suffix(end)).unwrap_or(stem);
    stem_of(bare).to_owned()
}

fn name_of(path: &Path) -> String {
    mask_key(Path::new(path.file_name().unwrap_or_default()))
}
