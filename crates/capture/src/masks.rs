//! Masks of pictures, in the form that both COLMAP and trainings read: `masks/NAME.jpg.png`, black
//! where a pixel is hidden, as large as the picture.

use crate::error::{Error, Result};
use image::{DynamicImage, GrayImage, imageops::FilterType};
use specula_io::{masks, picture};
use std::path::{Path, PathBuf};

/// Copies the masks of a folder to `to` for the pictures of `images`. Existing ones are kept.
/// Returns the number of pictures with a mask, and of masks of no picture.
///
/// # Errors
///
/// No mask has the name of a picture, a mask cannot be read or written.
pub(crate) fn copy(from: &Path, images: &Path, names: &[PathBuf], to: &Path) -> Result<[usize; 2]> {
    let found = masks::assigned(from, names);
    let pairs: Vec<_> = names.iter().zip(found.masks).filter_map(|(name, mask)| Some((name, mask?))).collect();
    if pairs.is_empty() {
        let first = names.first().map_or("1.jpg".into(), |name| name.display().to_string());
        return Err(Error::Input(format!(
            "{from:?} has {} files, none of which is the mask of a picture; the mask of {first} is named {first}.png or \
             has the name of the picture",
            found.unused.len()
        )));
    }
    for (name, mask) in &pairs {
        let mut file = to.join(name).into_os_string();
        file.push(".png");
        let file = PathBuf::from(file);
        if !file.is_file() {
            let read = |path: &Path| {
                image::open(path).map_err(|error| Error::Input(format!("{path:?} cannot be read: {error}")))
            };
            let size = image::image_dimensions(images.join(name)).unwrap_or_default();
            let folder = file.parent().unwrap_or(to);
            std::fs::create_dir_all(folder).map_err(Error::writing(folder))?;
            picture::write(&file, &hiding(&read(mask)?, size))?;
        }
    }
    if !found.unused.is_empty() {
        tracing::warn!(
            "{} masks of {from:?} match no picture, such as {:?}; name them like their pictures",
            found.unused.len(),
            found.unused[0]
        );
    }
    if pairs.len() < names.len() {
        tracing::warn!(
            "{} of {} pictures have no mask; all of their pixels count",
            names.len() - pairs.len(),
            names.len()
        );
    }
    Ok([pairs.len(), found.unused.len()])
}

/// Mask of two levels, of the size of its picture: alpha where the file has some, else brightness.
fn hiding(mask: &DynamicImage, (width, height): (u32, u32)) -> DynamicImage {
    let rgba = mask.to_rgba8();
    let has_alpha = rgba.pixels().any(|pixel| pixel[3] < 255);
    let grey = mask.to_luma8();
    let level = |x, y| {
        let level = if has_alpha { rgba.get_pixel(x, y)[3] } else { grey.get_pixel(x, y)[0] };
        image::Luma([if level < 128 { 0 } else { 255 }])
    };
    let levels: DynamicImage = GrayImage::from_fn(mask.width(), mask.height(), level).into();
    match width * height == 0 || (width, height) == (mask.width(), mask.height()) {
        true => levels,
        false => levels.resize_exact(width, height, FilterType::Nearest),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage, Rgba, RgbaImage};

    #[test]
    fn masks_of_any_name_and_size_become_those_of_colmap() {
        let folder = tempfile::tempdir().unwrap();
        let [images, from, to] = ["images", "given", "masks"].map(|name| folder.path().join(name));
        [&images, &from].into_iter().for_each(|folder| std::fs::create_dir_all(folder).unwrap());
        let names = ["a.jpg", "b.jpg", "c.jpg"].map(PathBuf::from);
        names.iter().for_each(|name| RgbImage::new(8, 6).save(images.join(name)).unwrap());
        RgbImage::from_pixel(4, 3, Rgb([255; 3])).save(from.join("a_mask.png")).unwrap();
        RgbaImage::from_pixel(8, 6, Rgba([0, 0, 0, 255])).save(from.join("b.jpg.png")).unwrap();
        RgbImage::new(8, 6).save(from.join("other.png")).unwrap();
        assert_eq!(copy(&from, &images, &names, &to).unwrap(), [2, 1]);
        let a = image::open(to.join("a.jpg.png")).unwrap().to_luma8();
        assert!((a.width(), a.height()) == (8, 6) && a.pixels().all(|pixel| pixel[0] == 255));
        assert!(to.join("b.jpg.png").is_file() && !to.join("c.jpg.png").exists());
        let sentence = copy(&from, &images, &[PathBuf::from("z.jpg")], &to).unwrap_err().to_string();
        assert!(sentence.contains("z.jpg.png"), "{sentence}");
    }
}
