//! Ground-truth materials of a view: albedo, roughness and metalness.

use crate::{
    error::{Error, Result},
    pixels::Pixels,
};
use std::path::{Path, PathBuf};

/// Minimum alpha of a pixel with a material: one half.
pub const ALPHA_MIN: u8 = 128;

/// Ground-truth materials of a view, at the size of its picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Materials {
    /// Base colour, sRGB-encoded, where alpha is at least [`ALPHA_MIN`]: the diffuse albedo of
    /// dielectrics, the reflectance at normal incidence of metals.
    pub albedo: Option<Pixels>,
    /// Perceptual roughness (red) and metalness (green), 255 for 1, where alpha is at least
    /// [`ALPHA_MIN`]. Lambertian surfaces have neither and are transparent.
    pub surface: Option<Pixels>,
}

impl Materials {
    /// True if neither is known.
    pub const fn is_empty(&self) -> bool {
        self.albedo.is_none() && self.surface.is_none()
    }
}

/// Files of the ground-truth materials of a view, if they exist.
#[derive(Clone, Debug, Default)]
pub(crate) struct MaterialFiles {
    /// sRGB-encoded base colour.
    pub(crate) albedo: Option<PathBuf>,
    /// Roughness, metalness, and a flag of Lambertian surfaces in blue.
    pub(crate) surface: Option<PathBuf>,
}

impl MaterialFiles {
    /// Reads both files. `size` is the stored size of the picture, which they must have; `finish`
    /// downscales them like the view.
    ///
    /// # Errors
    ///
    /// [`Error::TruthSize`] for files of another size; the errors of [`Pixels::read`].
    pub(crate) fn read(&self, size: [u32; 2], finish: impl Fn(Pixels) -> Pixels) -> Result<Materials> {
        let read = |path: &Option<PathBuf>| path.as_deref().map(|path| sized(path, size)).transpose();
        let [albedo, surface] = [read(&self.albedo)?, read(&self.surface)?.map(without_lambertian)];
        Ok(Materials { albedo: albedo.map(&finish), surface: surface.map(&finish) })
    }
}

/// Reads a picture that must have this size.
fn sized(path: &Path, expected: [u32; 2]) -> Result<Pixels> {
    let pixels = Pixels::read(path)?;
    let found = [pixels.width, pixels.height];
    if found == expected { Ok(pixels) } else { Err(Error::TruthSize { path: path.to_owned(), found, expected }) }
}

/// Makes Lambertian surfaces transparent, so that averages skip them.
fn without_lambertian(mut pixels: Pixels) -> Pixels {
    let is_lambertian = |pixel: &[u8]| pixel[2] >= ALPHA_MIN;
    pixels.rgba.chunks_exact_mut(4).filter(|pixel| is_lambertian(pixel)).for_each(|pixel| pixel.fill(0));
    pixels
}
