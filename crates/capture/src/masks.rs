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
    if !from.is_dir() {
        return Err(Error::Input(format!("there is no folder {from:?}; give the folder of the masks with --masks")));
    }
    let found = masks::assigned(from, names);
    let pairs: Vec<_> = names.iter().zip(found.masks).filter_map(|(name, mask)| Some((name, mask?))).collect();
    if pairs.is_empty() {
        let first = names.first().map_or("1.jpg".into(), |name| name.display().to_string());
        return Err(Error::Input(format!(
            "none of the files in {from:?} ({}) is the mask of a picture; the mask of {first} is named {first}.png or \
             has the name of the picture",
            found.unused.len()
        )));
    }
    for (name, mask) in &pairs {
        let file = mask_of(to, name);
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

/// Mask of a picture in a folder of masks.
fn mask_of(folder: &Path, name: &Path) -> PathBuf {
    let mut file = folder.join(name).into_os_string();
    file.push(".png");
    file.into()
}

/// Pairs of pictures whose surroundings are compared, and the size that they are compared in.
const COMPARED: usize = 8;
const COMPARED_SIZE: u32 = 96;
/// Difference of surroundings, in standard deviations of their brightness, below which they stand
/// still: noise has 0.1, another view of a room 0.5 to 1.
const STILL: f64 = 0.25;
/// Standard deviation of brightness, in levels of 8 bits, of surroundings without texture.
const EVEN: f64 = 6.0;

/// Whether the pixels that masks hide are the same in consecutive pictures, as those around an
/// object on a turntable are, or have no texture. Such surroundings tell no cameras.
pub(crate) fn surroundings_stand_still(images: &Path, masks: &Path, names: &[PathBuf]) -> bool {
    let small = |path: &Path| Some(image::open(path).ok()?.thumbnail_exact(COMPARED_SIZE, COMPARED_SIZE).to_luma8());
    let masked = |name: &PathBuf| Some((small(&images.join(name))?, small(&mask_of(masks, name))?));
    let step = (names.len() / COMPARED).max(1);
    let pairs = names.windows(2).step_by(step).filter_map(|pair| Some([masked(&pair[0])?, masked(&pair[1])?]));
    let mut differences: Vec<f64> = pairs.filter_map(|[one, other]| difference(&one, &other)).collect();
    differences.sort_by(f64::total_cmp);
    differences.get(differences.len() / 2).is_none_or(|median| *median < STILL)
}

/// Mean difference of brightness where two masks hide pixels, in standard deviations; 0 without
/// texture, none of few pixels.
fn difference((one, mask): &(GrayImage, GrayImage), (other, other_mask): &(GrayImage, GrayImage)) -> Option<f64> {
    const FEW: usize = 100;
    let levels = one.pixels().zip(other.pixels()).zip(mask.pixels().zip(other_mask.pixels()));
    let hidden: Vec<[f64; 2]> = levels
        .filter(|(_, (mask, other_mask))| mask[0] == 0 && other_mask[0] == 0)
        .map(|((one, other), _)| [f64::from(one[0]), f64::from(other[0])])
        .collect();
    if hidden.len() < FEW {
        return None;
    }
    let mean = |values: &dyn Fn(&[f64; 2]) -> f64| hidden.iter().map(values).sum::<f64>() / hidden.len() as f64;
    let level = mean(&|[one, _]| *one);
    let deviation = mean(&|[one, _]| (one - level) * (one - level)).sqrt();
    Some(if deviation < EVEN { 0.0 } else { mean(&|[one, other]| (one - other).abs()) / deviation })
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

    /// Pictures of a disc before stripes that move by pixels from picture to picture.
    fn turned(pixels: u32, contrast: u8) -> bool {
        let folder = tempfile::tempdir().unwrap();
        let [images, masks] = ["images", "masks"].map(|name| folder.path().join(name));
        [&images, &masks].into_iter().for_each(|folder| std::fs::create_dir_all(folder).unwrap());
        let names: Vec<PathBuf> = (0..6).map(|k| format!("{k}.png").into()).collect();
        let is_object = |x: u32, y: u32| x.abs_diff(60).pow(2) + y.abs_diff(45).pow(2) < 900;
        for (k, name) in names.iter().enumerate() {
            let shift = k as u32 * pixels;
            let level = |x: u32, y: u32| match is_object(x, y) {
                true => (40 * k) as u8 + (x % 40) as u8,
                false => 100 + contrast * u8::from((x + shift) % 24 < 12) + ((7 * x + 13 * y + 3 * k as u32) % 5) as u8,
            };
            GrayImage::from_fn(120, 90, |x, y| image::Luma([level(x, y)])).save(images.join(name)).unwrap();
            let mask = GrayImage::from_fn(120, 90, |x, y| image::Luma([255 * u8::from(is_object(x, y))]));
            mask.save(masks.join(format!("{}.png", name.display()))).unwrap();
        }
        surroundings_stand_still(&images, &masks, &names)
    }

    #[test]
    fn surroundings_that_stand_still_or_have_no_texture_are_told_from_those_that_move() {
        assert!(turned(0, 60), "a turntable: noise moves, stripes do not");
        assert!(!turned(5, 60), "a walk");
        assert!(turned(5, 0), "a backdrop without texture");
    }
}
