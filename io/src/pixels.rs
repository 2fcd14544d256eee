//! Photographs and normal maps in memory, and the area average that makes them smaller.

use crate::error::{Error, Result};
use glam::Vec3;
use image::{DynamicImage, ImageReader, Limits};
use std::{fs, path::Path};

/// A picture may take so many bytes of memory, however small its file.
const MEMORY_MIN: u64 = 256 << 20;
/// A larger one has to come from a file of so manieth of its size: what packs best packs a thousand bytes into one.
const PACKED_MAX: u64 = 2000;

/// A photograph as it was stored: eight bits a channel, sRGB, straight alpha.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue, alpha of each pixel, rows from the top.
    pub rgba: Vec<u8>,
}

impl Pixels {
    /// Decodes an image of any format and depth; without an alpha channel it is opaque.
    pub fn read(path: &Path) -> Result<Self> {
        let image = decode(path)?.into_rgba8();
        let (width, height) = image.dimensions();
        Ok(Self { width, height, rgba: image.into_raw() })
    }

    /// The average colour over the area of each new pixel, weighted with alpha, so that what is invisible does not
    /// bleed into edges. Colours are averaged as they are stored, in sRGB.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let premultiplied: Vec<[f32; 4]> = self.rgba.chunks_exact(4).map(premultiply).collect();
        let averages = area_average(&premultiplied, [self.width, self.height], [width, height]);
        Self { width, height, rgba: averages.into_iter().flat_map(straighten).collect() }
    }
}

fn premultiply(pixel: &[u8]) -> [f32; 4] {
    let alpha = f32::from(pixel[3]) / 255.0;
    [f32::from(pixel[0]) * alpha, f32::from(pixel[1]) * alpha, f32::from(pixel[2]) * alpha, alpha]
}

fn straighten([red, green, blue, alpha]: [f32; 4]) -> [u8; 4] {
    let scale = if alpha > 0.0 { alpha.recip() } else { 0.0 };
    [red * scale, green * scale, blue * scale, alpha * 255.0].map(|channel| (channel + 0.5) as u8)
}

/// True normals of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Unit normals in world space; zero where there is none.
    pub values: Vec<[f32; 3]>,
    /// Where there is a normal.
    pub mask: Vec<bool>,
}

impl Normals {
    /// Decodes a normal map: n = 2 RGB / 255 − 1, made unit, where alpha is at least one half.
    pub fn read(path: &Path) -> Result<Self> {
        let image = decode(path)?.into_rgba8();
        let (width, height) = image.dimensions();
        let sums = image.as_raw().chunks_exact(4).map(|pixel| {
            let normal = Vec3::new(pixel[0].into(), pixel[1].into(), pixel[2].into()) * (2.0 / 255.0) - Vec3::ONE;
            if pixel[3] >= 128 { normal.normalize_or_zero().extend(1.0).to_array() } else { [0.0; 4] }
        });
        Ok(Self::from_sums(sums, width, height))
    }

    /// The mean direction over the area of each new pixel, where at least half of that area has normals.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let weighted: Vec<[f32; 4]> = self
            .values
            .iter()
            .zip(&self.mask)
            .map(|(n, mask)| [n[0], n[1], n[2], f32::from(u8::from(*mask))])
            .collect();
        let sums = area_average(&weighted, [self.width, self.height], [width, height]);
        Self::from_sums(sums.into_iter(), width, height)
    }

    /// From sums of normals and the share of the area that has any.
    fn from_sums(sums: impl Iterator<Item = [f32; 4]>, width: u32, height: u32) -> Self {
        let unit = |[x, y, z, share]: [f32; 4]| {
            if share >= 0.5 { Vec3::new(x, y, z).normalize_or_zero() } else { Vec3::ZERO }
        };
        let values: Vec<[f32; 3]> = sums.map(|sum| unit(sum).to_array()).collect();
        let mask = values.iter().map(|normal| *normal != [0.0; 3]).collect();
        Self { width, height, values, mask }
    }
}

/// Decodes an image by its content, or else by its name, and refuses one without pixels.
pub(crate) fn decode(path: &Path) -> Result<DynamicImage> {
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    let mut reader = reader.map_err(Error::reading(path))?;
    reader.limits(limits_of(path)?);
    with_pixels(path, reader.decode().map_err(Error::decoding(path))?)
}

/// Memory that a picture may take, so that a broken header does not ask for more than its file could ever fill.
pub(crate) fn limits_of(path: &Path) -> Result<Limits> {
    let size = fs::metadata(path).map_err(Error::reading(path))?.len();
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(size.saturating_mul(PACKED_MAX).max(MEMORY_MIN));
    Ok(limits)
}

pub(crate) fn with_pixels(path: &Path, image: DynamicImage) -> Result<DynamicImage> {
    if image.width() == 0 || image.height() == 0 {
        return Err(Error::EmptyImage { path: path.to_owned() });
    }
    Ok(image)
}

/// Averages over the area of each new pixel: columns first, then rows.
fn area_average(pixels: &[[f32; 4]], from: [u32; 2], to: [u32; 2]) -> Vec<[f32; 4]> {
    let [width, height] = from.map(|size| size as usize);
    let [new_width, new_height] = to.map(|size| size as usize);

    let columns = spans(width, new_width);
    let narrow: Vec<[f32; 4]> =
        pixels.chunks_exact(width).flat_map(|row| columns.iter().map(|span| span.sum(|x| row[x]))).collect();

    let rows = spans(height, new_height);
    let pixel_of = |span: &Span, x: usize| span.sum(|y| narrow[y * new_width + x]);
    rows.iter().flat_map(|span| (0..new_width).map(move |x| pixel_of(span, x))).collect()
}

/// Which old pixels lie in a new one, in one direction, and with what share; the shares add up to one.
struct Span {
    first: usize,
    shares: Vec<f32>,
}

impl Span {
    fn sum(&self, pixel: impl Fn(usize) -> [f32; 4]) -> [f32; 4] {
        let mut sum = [0.0; 4];
        for (offset, share) in self.shares.iter().enumerate() {
            let pixel = pixel(self.first + offset);
            sum = core::array::from_fn(|k| sum[k] + share * pixel[k]);
        }
        sum
    }
}

fn spans(from: usize, to: usize) -> Vec<Span> {
    let ratio = from as f64 / to as f64;
    let span = |i: usize| {
        let (start, end) = (i as f64 * ratio, ((i + 1) as f64 * ratio).min(from as f64));
        let (first, last) = (start as usize, (end.ceil() as usize).min(from));
        let overlap = |pixel: usize| (end.min((pixel + 1) as f64) - start.max(pixel as f64)).max(0.0);
        Span { first, shares: (first..last).map(|pixel| (overlap(pixel) / (end - start)) as f32).collect() }
    };
    (0..to).map(span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(width: u32, height: u32, rgba: &[[u8; 4]]) -> Pixels {
        Pixels { width, height, rgba: rgba.concat() }
    }

    #[test]
    fn invisible_pixels_do_not_bleed() {
        let edge = pixels(2, 1, &[[200, 100, 50, 255], [0, 255, 0, 0]]);
        assert_eq!(edge.resized(1, 1).rgba, [200, 100, 50, 128]);
    }

    #[test]
    fn a_constant_image_stays_constant_at_any_size() {
        let constant = pixels(7, 5, &[[10, 20, 30, 200]; 35]);
        assert_eq!(constant.resized(3, 2), pixels(3, 2, &[[10, 20, 30, 200]; 6]));
    }

    #[test]
    fn each_new_pixel_is_the_mean_of_its_block() {
        let rgba: Vec<[u8; 4]> = (0..16).map(|i| [10 * i, 0, 0, 255]).collect();
        let half = pixels(4, 4, &rgba).resized(2, 2);
        let red: Vec<u8> = half.rgba.chunks(4).map(|pixel| pixel[0]).collect();
        assert_eq!(red, [25, 45, 105, 125]);
    }

    #[test]
    fn fractional_borders_share_their_pixel() {
        let row = pixels(3, 1, &[[0, 0, 0, 255], [90, 0, 0, 255], [240, 0, 0, 255]]);
        let shrunk = row.resized(2, 1);
        assert_eq!([shrunk.rgba[0], shrunk.rgba[4]], [30, 190]);
    }

    #[test]
    fn normals_are_averaged_where_there_are_any() {
        let normals = Normals {
            width: 2,
            height: 2,
            values: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0; 3], [0.0; 3]],
            mask: vec![true, true, false, false],
        };
        let shrunk = normals.resized(1, 1);
        assert!(shrunk.mask[0], "half of the area has normals");
        assert!((Vec3::from(shrunk.values[0]) - Vec3::new(0.5, 0.5, 0.0).normalize()).length() < 1e-6);
    }
}
