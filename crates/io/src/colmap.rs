//! Reconstructions of COLMAP: `cameras`, `images` and `points3D` in its binary or text format, as
//! its page on output formats defines them. Poses are camera-from-world, x right, y down, z
//! forwards; pixel centres are at + ½, as everywhere in specula.

mod binary;
mod record;
mod text;

use crate::{
    error::{Error, Result},
    listing::{Listing, LoadOptions},
    named::Files,
    photographs::{self, Folders, HeldOut, Posed},
    points_ply::{self, PointCloud},
    shot::{PictureLight, Pose},
    within,
};
use glam::DVec3;
pub(crate) use record::Track;
pub(crate) use record::refuse;
use record::{Camera, Image, Point};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

/// Candidate folders of a reconstruction; COLMAP numbers models that it could not merge.
const PLACES: [&str; 5] = ["sparse", "", "colmap/sparse", "colmap", "distorted/sparse"];

/// A reconstruction on disk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Model {
    pub(crate) folder: PathBuf,
    pub(crate) is_text: bool,
}

impl Model {
    pub(crate) fn in_folder(folder: &Path) -> Option<Self> {
        let has =
            |ending: &str| ["cameras", "images"].iter().all(|name| folder.join(format!("{name}.{ending}")).is_file());
        let is_text = match (has("bin"), has("txt")) {
            (true, _) => false,
            (false, true) => true,
            (false, false) => return None,
        };
        Some(Self { folder: folder.to_owned(), is_text })
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.{}", if self.is_text { "txt" } else { "bin" }))
    }

    /// Size in bytes, which selects the largest of several models.
    fn size(&self) -> u64 {
        fs::metadata(self.file("images")).map_or(0, |data| data.len())
    }

    fn format(&self) -> &'static str {
        if self.is_text { "text" } else { "binary" }
    }
}

/// Error for a reconstruction without one of its two lists; `None` without a reconstruction.
pub(crate) fn incomplete(folder: &Path) -> Option<Error> {
    let places = PLACES.iter().map(|place| folder.join(place));
    let places = places.flat_map(|place| [numbered(&place), vec![place]].concat());
    places.into_iter().find_map(|place| {
        let is_there = |name: &str, ending: &str| place.join(name).with_extension(ending).is_file();
        if ["bin", "txt"].iter().any(|ending| ["cameras", "images"].iter().all(|name| is_there(name, ending))) {
            return None;
        }
        let has = |name: &str| ["bin", "txt"].iter().any(|ending| is_there(name, ending));
        let advice = "of one format; copy the whole folder, or write it again with `colmap model_converter`";
        match (has("cameras"), has("images")) {
            (true, false) => Some(refuse(&place, "the reconstruction", format!("has cameras, but no images {advice}"))),
            (false, true) => Some(refuse(&place, "the reconstruction", format!("has images, but no cameras {advice}"))),
            (true, true) => Some(refuse(&place, "the reconstruction", format!("has no cameras and images {advice}"))),
            (false, false) => None,
        }
    })
}

/// Finds the reconstruction of a data set; of several, the largest.
pub(crate) fn find(folder: &Path) -> Option<Model> {
    PLACES.iter().find_map(|place| in_place(&folder.join(place), place.is_empty()))
}

/// True if the reconstruction is at the top level of the data set, not in a folder of another
/// program.
pub(crate) fn is_at(folder: &Path) -> bool {
    PLACES[..2].iter().any(|place| in_place(&folder.join(place), place.is_empty()).is_some())
}

fn in_place(place: &Path, is_root: bool) -> Option<Model> {
    if let Some(model) = Model::in_folder(place) {
        return Some(model);
    }
    if is_root {
        return None;
    }
    let mut models: Vec<Model> = numbered(place).iter().filter_map(|folder| Model::in_folder(folder)).collect();
    models.sort_by_key(|model| core::cmp::Reverse(model.size()));
    models.into_iter().next()
}

/// Subfolders of a folder, by name.
fn numbered(place: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(place).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// Lists a data set with cameras of COLMAP, and reads its points.
pub(crate) fn list(files: &Files, model: &Model, options: &LoadOptions) -> Result<Listing> {
    let mut cameras = read_cameras(model)?;
    let images = read_images(model)?;
    if images.is_empty() {
        return Err(Error::NoFrames { path: model.file("images") });
    }
    let mut notes = Vec::new();
    note_several(&files.root, model, &mut notes);
    let folders = Folders::of(files, images.iter().map(|image| image.name.as_str()), options);
    let written = images.iter().map(|image| image.name.as_str());
    let places = files.placed_all(&folders.images, Path::new(""), written, &mut notes);
    let posed = images.into_iter().zip(places).map(|(image, place)| posed(model, image, place, &mut cameras));
    let posed = posed.collect::<Result<Vec<Posed>>>()?;
    let mut listing = photographs::list(posed, &folders, &HeldOut::Every(options.test_every), options)?;
    listing.notes.splice(0..0, notes);
    let kinds: BTreeSet<&str> = cameras.values().flatten().map(|camera| camera.model.name).collect();
    listing.source = format!(
        "COLMAP's model in {:?} ({}; cameras: {}, {})",
        model.folder,
        model.format(),
        cameras.len(),
        kinds.into_iter().collect::<Vec<_>>().join(", ")
    );
    match model.folder == files.root {
        true => listing.used.extend(["cameras", "images", "points3D"].map(|name| model.file(name))),
        false => listing.used.push(model.folder.clone()),
    }
    if options.points.is_none() {
        let cloud = Some(model.file("points3D")).filter(|path| !path.is_file()).and_then(|_| points_ply::find(files));
        listing.points = Some(match cloud {
            Some(path) => {
                listing.used.push(path.clone());
                points_ply::read_noting(&path, &mut listing.notes)?
            }
            None => read_points(model, &mut listing.notes)?,
        });
    }
    Ok(listing)
}

/// Other models beside a model.
pub(crate) fn others(model: &Model) -> Vec<Model> {
    let place = model.folder.parent().map(numbered).unwrap_or_default();
    place.iter().filter_map(|folder| Model::in_folder(folder)).filter(|other| other != model).collect()
}

fn note_several(folder: &Path, model: &Model, notes: &mut Vec<String>) {
    if model.folder.parent().is_none_or(|place| place == folder) {
        return;
    }
    let names: Vec<String> = others(model).iter().map(|other| format!("{:?}", other.folder)).collect();
    if !names.is_empty() {
        notes.push(format!("{:?} is the largest model; skipped: {}", model.folder, names.join(", ")));
    }
}

fn posed(model: &Model, image: Image, place: PathBuf, cameras: &mut BTreeMap<u32, Result<Camera>>) -> Result<Posed> {
    let refuse = |what: &str| refuse(&model.file("images"), format!("image {:?}", image.name), what);
    let camera = cameras
        .entry(image.camera)
        .or_insert_with(|| Err(refuse(&format!("has the camera {}, which is not listed", image.camera))));
    let lens = match camera {
        Ok(camera) => camera.lens(),
        Err(_) => return Err(cameras.remove(&image.camera).and_then(Result::err).expect("it is one")),
    };
    let pose = image.pose().ok_or_else(|| {
        refuse("has a pose that is not finite or has no rotation; remove the image, or reconstruct again")
    })?;
    Ok(Posed {
        image: place,
        mask: None,
        pose,
        light: PictureLight::default(),
        measured_size: Some([lens.width, lens.height]),
        lens: Box::new(move |[width, height]| Ok(lens.resized(width, height))),
    })
}

/// Reads cameras. A faulty camera is an error if an image uses it.
fn read_cameras(model: &Model) -> Result<BTreeMap<u32, Result<Camera>>> {
    let path = model.file("cameras");
    let cameras = if model.is_text { text::cameras(&path)? } else { binary::cameras(&path)? };
    let checked = |(id, camera): (u32, Result<Camera>)| {
        let refuse = |what: String| refuse(&path, format!("camera {id}"), what);
        (id, camera.and_then(|camera| camera.checked().map_err(refuse)))
    };
    let count = cameras.len();
    let checked: BTreeMap<u32, Result<Camera>> = cameras.into_iter().map(checked).collect();
    match checked.len() {
        distinct if distinct == count => Ok(checked),
        distinct => Err(refuse(
            &path,
            "the list",
            format!("lists {count} cameras with {distinct} identifiers; remove duplicates"),
        )),
    }
}

fn read_images(model: &Model) -> Result<Vec<Image>> {
    let path = model.file("images");
    if model.is_text { text::images(&path) } else { binary::images(&path) }
}

/// Names and poses of the images, by identifier. Images without a valid pose are skipped.
pub(crate) fn registered(model: &Model) -> Result<BTreeMap<u32, (String, Pose)>> {
    let images = read_images(model)?;
    Ok(images.into_iter().filter_map(|image| Some((image.id, (image.name.clone(), image.pose()?)))).collect())
}

/// Reads points with the images that see them; none without a list of points.
pub(crate) fn tracks(model: &Model) -> Result<Vec<Track>> {
    let path = model.file("points3D");
    match (path.is_file(), model.is_text) {
        (false, _) => Ok(Vec::new()),
        (true, true) => text::tracks(&path),
        (true, false) => binary::tracks(&path),
    }
}

/// Reads the points of a reconstruction. Points that are not finite are skipped with a note.
pub(crate) fn read_points(model: &Model, notes: &mut Vec<String>) -> Result<PointCloud> {
    let path = model.file("points3D");
    if path.symlink_metadata().is_ok_and(|found| !found.is_dir()) {
        within::holds(&path)?;
    }
    if !path.is_file() {
        notes.push(format!("no {path:?}, so training starts from random points"));
        return Ok(PointCloud::default());
    }
    let points = if model.is_text { text::points(&path)? } else { binary::points(&path)? };
    let mut cloud = PointCloud::default();
    for Point { position, color } in &points {
        if DVec3::from(*position).as_vec3().is_finite() {
            cloud.positions.push(*position);
            cloud.colors.push(color.map(|channel| f32::from(channel) / 255.0));
        }
    }
    let left_out = points.len() - cloud.positions.len();
    if left_out > 0 {
        notes.push(format!("skipped {left_out} points of {path:?} that are not finite"));
    }
    Ok(cloud)
}
