//! Memory budgets of files, checked before memory is allocated, and limits of their contents.
//!
//! Budgets count the bytes that a reader holds at the same time: a pixel that is stored in one byte
//! and converted to four counts as five. No reader takes more than a gigabyte for a file of ten
//! megabytes, whatever its header says.

use crate::{
    error::{Error, Result},
    within,
};
use core::fmt::Display;
use std::{io::Read, path::Path};

/// Largest edge of a camera's picture in pixels, also for COLMAP's files.
pub const EDGE_MAX: u32 = 1 << 16;
/// Largest radiance of a light file: its square is finite, and the sun's radiance is far below.
pub const RADIANCE_MAX: f32 = 1e18;
/// Largest rendered picture in pixels: 16 384 by 8192, 12.5 GiB of `f32` with all layers.
pub const PIXELS_MAX: u64 = 1 << 27;

/// Gaussians, points and records of a scene: 36 million Gaussians with harmonics of degree 3 fit.
pub(crate) const SCENE: Budget =
    Budget { kind: "a scene", any: 8 << 30, for_each: 0, remedy: "remove what is not needed, or split it" };
/// Gaussians of a compressed file: thirty bytes of memory per byte of an ordinary one; only clouds
/// of nearly equal Gaussians reach this limit.
pub(crate) const PACKED: Budget = Budget {
    kind: "Gaussians from a compressed file of that size",
    any: 896 << 20,
    for_each: 90,
    remedy: "save them as a PLY",
};
/// One picture with all conversions: 80 megapixels of a photograph, and more for a large file. A
/// photograph takes ten bytes of memory per byte of its file, so only pictures of nearly one colour
/// reach this limit.
pub(crate) const PICTURE: Budget =
    Budget { kind: "a picture from a file of that size", any: 896 << 20, for_each: 90, remedy: "save it smaller" };
/// Text of a list of cameras: a hundred thousand frames of nerfstudio. Parsed JSON takes up to
/// fifty times the memory of its text.
pub const LIST: Budget =
    Budget { kind: "the text of a list", any: 64 << 20, for_each: 0, remedy: "remove some frames" };
/// Text of a model's description; parsed, it takes up to two hundred times the memory.
pub const FACTS: Budget =
    Budget { kind: "the text of such a file", any: 4 << 20, for_each: 0, remedy: "remove entries that no tool wrote" };

/// Weights of a network: VGG's are 60 MiB.
pub const NETWORK: Budget = Budget { kind: "a network", any: 1 << 30, for_each: 0, remedy: "use a smaller one" };

/// Maximum number of scans of a JPEG. Each scan covers the whole picture, even with few bytes;
/// progressive files have a dozen.
pub(crate) const JPEG_SCANS_MAX: usize = 100;
/// Bytes of a picture's metadata, such as a colour profile.
pub(crate) const PICTURE_NOTES_MAX: u64 = 64 << 20;
/// Header of a PLY file: a thousand times the common length.
pub(crate) const PLY_HEADER_MAX: u64 = 1 << 20;
/// Line of a PLY file in text: a thousand times the length of a Gaussian with all harmonics.
pub(crate) const PLY_LINE_MAX: u64 = 1 << 20;
/// Line of a text file of COLMAP: all 2D points of an image.
pub(crate) const COLMAP_LINE_MAX: u64 = 1 << 28;
/// Header of a checkpoint: a thousand times the common length.
pub(crate) const CHECKPOINT_HEADER_MAX: u64 = 1 << 22;

/// Memory budget for files of one kind.
#[derive(Debug)]
pub struct Budget {
    /// Name of the kind in error messages.
    kind: &'static str,
    /// Bytes for a file of any length.
    any: u64,
    /// Bytes for each byte of the file, if that is more.
    for_each: u64,
    /// Remedy in error messages.
    remedy: &'static str,
}

impl Budget {
    /// Budget in bytes for a file of this length.
    pub(crate) fn of(&self, len: u64) -> u64 {
        self.any.max(len.saturating_mul(self.for_each))
    }

    /// Rejects a file of length `len` if its part `what` needs more than the budget, or more than
    /// the system grants.
    ///
    /// # Errors
    ///
    /// [`Error::TooLarge`] if `wanted` exceeds the budget, [`Error::OutOfMemory`].
    pub(crate) fn ask(&self, path: &Path, len: u64, what: impl Display, wanted: u64) -> Result<()> {
        let most = self.of(len);
        if wanted <= most && is_granted(wanted) {
            return Ok(());
        }
        let (path, what, kind, remedy) = (path.to_owned(), what.to_string(), self.kind, self.remedy);
        Err(match wanted <= most {
            true => Error::OutOfMemory { path, what, wanted, remedy },
            false => Error::TooLarge { path, what, wanted, kind, most, remedy },
        })
    }

    /// Reads a whole file within the budget.
    ///
    /// # Errors
    ///
    /// [`Error::TooLarge`] for a longer file, [`Error::NotAFile`] and [`Error::Read`] for one that
    /// cannot be read.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let file = within::open(path)?;
        let len = file.metadata().map_err(Error::reading(path))?.len();
        self.ask(path, 0, "it", len)?;
        let mut bytes = Vec::new();
        file.take(self.any + 1).read_to_end(&mut bytes).map_err(Error::reading(path))?;
        self.ask(path, 0, "it", bytes.len() as u64)?;
        Ok(bytes)
    }
}

/// True if memory can be allocated; it is freed at once. A failing allocation in a reader would end
/// the program.
fn is_granted(bytes: u64) -> bool {
    const LITTLE: u64 = 16 << 20;
    bytes < LITTLE || usize::try_from(bytes).is_ok_and(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok())
}

/// Checks the radiance of a light from a file, with its exposure.
///
/// # Errors
///
/// [`Error::TooBright`].
pub fn radiance(path: &Path, values: &[f32]) -> Result<()> {
    match values.iter().find(|radiance| !(**radiance <= RADIANCE_MAX)) {
        Some(found) => Err(Error::TooBright { path: path.to_owned(), found: *found }),
        None => Ok(()),
    }
}

/// Checks the size of a picture to render.
///
/// # Errors
///
/// A description of the size if it is out of range.
pub fn view_size([width, height]: [u64; 2]) -> core::result::Result<[u32; 2], String> {
    let edge = |len: u64| u32::try_from(len).ok().filter(|len| (1..=EDGE_MAX).contains(len));
    let fits = edge(width).zip(edge(height)).filter(|_| width * height <= PIXELS_MAX);
    fits.map(<[u32; 2]>::from).ok_or_else(|| {
        format!(
            "{width} by {height} pixels; pictures have 1 to {EDGE_MAX} along an edge, and at most {} million",
            PIXELS_MAX / 1_000_000
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_budget_of_a_file_follows_from_its_kind_and_its_length() {
        assert_eq!([0, 9 << 20, 1 << 30].map(|len| PICTURE.of(len)), [896 << 20, 896 << 20, 90 << 30]);
        let refusal = SCENE.ask(Path::new("a.ply"), 60 << 30, "its 300000000 vertices", 60 << 30).unwrap_err();
        let sentence = refusal.to_string();
        for word in ["a.ply", "300000000 vertices", "61440 MiB", "8192 MiB", "split it"] {
            assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
        }
    }

    #[test]
    fn memory_that_the_system_does_not_grant_is_an_error() {
        let any = Budget { any: u64::MAX, ..SCENE };
        let refusal = any.ask(Path::new("a.ply"), 0, "its 7 vertices", 1 << 60).unwrap_err();
        assert!(
            matches!(refusal, Error::OutOfMemory { .. }) && refusal.to_string().contains("its 7 vertices"),
            "{refusal}"
        );
    }

    #[test]
    fn the_square_of_the_largest_radiance_is_finite() {
        let path = Path::new("a.hdr");
        assert!(radiance(path, &[0.0, RADIANCE_MAX]).is_ok());
        for found in [1.1 * RADIANCE_MAX, f32::INFINITY, f32::NAN] {
            assert!(radiance(path, &[1.0, found]).unwrap_err().to_string().contains("maximum 1e18"), "{found}");
        }
    }

    #[test]
    fn only_regular_files_within_the_budget_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::fs::File::create(&path).unwrap().set_len(5 << 20).unwrap();
        assert!(FACTS.read(&path).unwrap_err().to_string().contains("4 MiB"));
        for other in [folder.path(), Path::new("/dev/zero")] {
            assert!(!other.exists() || matches!(FACTS.read(other), Err(Error::NotAFile { .. })), "{other:?}");
        }
    }

    #[test]
    fn sizes_of_views_are_bounded_along_edges_and_in_all() {
        assert_eq!(view_size([16_384, 8192]), Ok([16_384, 8192]));
        assert_eq!(view_size([1, 65_536]), Ok([1, 65_536]));
        for size in [[0, 5], [65_537, 1], [16_384, 8193], [1_000_000_000; 2], [u64::MAX; 2]] {
            assert!(view_size(size).unwrap_err().contains(&size[0].to_string()), "{size:?}");
        }
    }
}
