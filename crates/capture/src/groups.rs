//! Groups of pictures that share a camera: of one size, camera, focal length and input.

use exif::{In, Reader, Tag};
use std::{
    collections::BTreeMap,
    fs::File,
    io::BufReader,
    path::{Path, PathBuf},
};

/// Smallest group with a camera of its own; pictures of smaller groups have a camera each.
const SHARED_MIN: usize = 3;

/// Facts that pictures of one camera share.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Key {
    /// Subfolder, which is that of an input.
    pub(crate) folder: PathBuf,
    pub(crate) size: [u32; 2],
    /// Camera and focal length as EXIF has them.
    pub(crate) camera: String,
}

impl Key {
    /// Reads the header of a picture; no size if it cannot be read.
    pub(crate) fn of(images: &Path, name: &Path) -> Self {
        let path = images.join(name);
        let size = image::image_dimensions(&path).map_or([0; 2], |(width, height)| [width, height]);
        Self { folder: name.parent().unwrap_or(Path::new("")).into(), size, camera: camera(&path).unwrap_or_default() }
    }
}

fn camera(path: &Path) -> Option<String> {
    let found = Reader::new().read_from_container(&mut BufReader::new(File::open(path).ok()?)).ok()?;
    let fields = [Tag::Make, Tag::Model, Tag::LensModel, Tag::FocalLength];
    let text = |tag| found.get_field(tag, In::PRIMARY).map(|field| field.display_value().to_string());
    Some(fields.into_iter().filter_map(text).collect::<Vec<_>>().join(" "))
}

/// Lists of pictures: each of the first shares a camera, those of the last have one each.
pub(crate) fn of_keys(pictures: &[(PathBuf, Key)]) -> (Vec<Vec<PathBuf>>, Vec<PathBuf>) {
    let mut by_key: BTreeMap<&Key, Vec<PathBuf>> = BTreeMap::new();
    pictures.iter().for_each(|(name, key)| by_key.entry(key).or_default().push(name.clone()));
    let (shared, single): (Vec<_>, Vec<_>) = by_key.into_values().partition(|group| group.len() >= SHARED_MIN);
    let mut single = single.concat();
    single.sort();
    (shared, single)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_one_size_and_camera_share_a_camera() {
        let picture = |name: &str, size: [u32; 2], camera: &str| {
            (PathBuf::from(name), Key { size, camera: camera.into(), ..Key::default() })
        };
        let mut pictures: Vec<_> = (0..4).map(|k| picture(&format!("{k}.jpg"), [800, 600], "phone 4 mm")).collect();
        pictures.extend((4..7).map(|k| picture(&format!("{k}.jpg"), [600, 800], "phone 4 mm")));
        pictures.push(picture("zoom.jpg", [800, 600], "phone 9 mm"));
        let (shared, single) = of_keys(&pictures);
        assert_eq!(shared.iter().map(Vec::len).collect::<Vec<_>>(), [3, 4]);
        assert_eq!(single, [PathBuf::from("zoom.jpg")]);
    }
}
