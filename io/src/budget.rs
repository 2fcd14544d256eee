//! Memory that a file may ask for, decided in one place and before any of it is taken.
//!
//! Bytes are those that a reader holds at once, after conversion: a pixel that is stored in one byte and kept in four counts
//! as both. Whatever a file of ten megabytes says, no reader takes more than a gigabyte for it.

use crate::error::{Error, Result};
use core::fmt::Display;
use std::{
    fs::{self, File},
    io::Read,
    path::Path,
};

/// Pixels along an edge of any picture that a camera may see; COLMAP's own files are held to it as well.
pub const EDGE_MAX: u32 = 1 << 16;
/// Pixels of a picture that is to be rendered: 16 384 by 8192, which take 6 GiB with all that is blended of light.
pub const PIXELS_MAX: u64 = 1 << 27;

/// Gaussians, points, records: numbers that a scene is made of. 36 million Gaussians with harmonics of degree 3 fit.
pub(crate) const SCENE: Budget =
    Budget { kind: "a scene", any: 8 << 30, for_each: 0, remedy: "leave out what is not needed of it, or divide it" };
/// One picture, whatever is made of it: 80 megapixels of a photograph, and more from a file that is large itself. A
/// photograph has a byte for ten that it takes, so only what is nearly all of one colour meets this bound.
pub(crate) const PICTURE: Budget =
    Budget { kind: "a picture from a file of that size", any: 896 << 20, for_each: 90, remedy: "save it smaller" };
/// Text of a list of cameras: a hundred thousand frames of nerfstudio. What JSON becomes takes up to fifty times its text.
pub(crate) const LIST: Budget =
    Budget { kind: "the text of a list", any: 64 << 20, for_each: 0, remedy: "leave frames out of it" };
/// Text that says what is known of a model, which may become two hundred times as much.
pub const FACTS: Budget =
    Budget { kind: "the text of such a file", any: 4 << 20, for_each: 0, remedy: "remove what no tool has written" };

/// Weights of a network: VGG's are 60 MiB.
pub const NETWORK: Budget = Budget { kind: "a network", any: 1 << 30, for_each: 0, remedy: "name a smaller one" };

/// Scans of a JPEG, each of which goes over the whole picture, however few bytes it has; progressive ones have a dozen.
pub(crate) const JPEG_SCANS_MAX: usize = 100;
/// Bytes that are unpacked of a picture besides its pixels, such as a profile of colours.
pub(crate) const PICTURE_NOTES_MAX: u64 = 64 << 20;
/// Header of a PLY file: a thousand times what tools write.
pub(crate) const PLY_HEADER_MAX: u64 = 1 << 20;
/// A line of a PLY file in text: a thousand times a Gaussian with all its harmonics.
pub(crate) const PLY_LINE_MAX: u64 = 1 << 20;
/// Line of a text file of COLMAP: all places of points in one image.
pub(crate) const COLMAP_LINE_MAX: u64 = 1 << 28;
/// Header of a checkpoint: a thousand times what is written.
pub(crate) const CHECKPOINT_HEADER_MAX: u64 = 1 << 22;

/// Memory that files of one kind may take.
#[derive(Debug)]
pub struct Budget {
    /// The kind, as a sentence names it.
    kind: &'static str,
    /// Bytes for any file.
    any: u64,
    /// Bytes for each byte of a file, where that is more.
    for_each: u64,
    /// Advice for whom it is too little.
    remedy: &'static str,
}

impl Budget {
    /// Bytes for a file of this length.
    pub(crate) fn of(&self, len: u64) -> u64 {
        self.any.max(len.saturating_mul(self.for_each))
    }

    /// Refuses a file of length `len` in which `what` would take more.
    ///
    /// # Errors
    ///
    /// [`Error::TooLarge`] where `wanted` is beyond the budget.
    pub(crate) fn ask(&self, path: &Path, len: u64, what: impl Display, wanted: u64) -> Result<()> {
        let most = self.of(len);
        if wanted <= most {
            return Ok(());
        }
        let (what, kind, remedy) = (what.to_string(), self.kind, self.remedy);
        Err(Error::TooLarge { path: path.to_owned(), what, wanted, kind, most, remedy })
    }

    /// The bytes of a file that is kept whole; no more is read than may be, whatever length the file has.
    ///
    /// # Errors
    ///
    /// [`Error::TooLarge`] for a longer file, [`Error::Read`] for one that cannot be read.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let file = File::open(path).map_err(Error::reading(path))?;
        let len = file.metadata().map_err(Error::reading(path))?.len();
        self.ask(path, 0, "it", len)?;
        let mut bytes = Vec::new();
        file.take(self.any + 1).read_to_end(&mut bytes).map_err(Error::reading(path))?;
        self.ask(path, 0, "it", bytes.len() as u64)?;
        Ok(bytes)
    }
}

/// Length of a file in bytes.
pub(crate) fn len_of(path: &Path) -> Result<u64> {
    Ok(fs::metadata(path).map_err(Error::reading(path))?.len())
}

/// The size of a picture that can be rendered.
///
/// # Errors
///
/// A sentence about a size that cannot.
pub fn view_size([width, height]: [u64; 2]) -> core::result::Result<[u32; 2], String> {
    let edge = |len: u64| u32::try_from(len).ok().filter(|len| (1..=EDGE_MAX).contains(len));
    let fits = edge(width).zip(edge(height)).filter(|_| width * height <= PIXELS_MAX);
    fits.map(<[u32; 2]>::from).ok_or_else(|| {
        format!(
            "{width} by {height} pixels; pictures have from 1 to {EDGE_MAX} along an edge, and {} million at most",
            PIXELS_MAX / 1_000_000
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_granted_what_its_kind_may_take_or_its_own_length_pays_for() {
        assert_eq!([0, 9 << 20, 1 << 30].map(|len| PICTURE.of(len)), [896 << 20, 896 << 20, 90 << 30]);
        let refusal = SCENE.ask(Path::new("a.ply"), 60 << 30, "its 300000000 vertices", 60 << 30).unwrap_err();
        let sentence = refusal.to_string();
        for word in ["a.ply", "300000000 vertices", "61440 MiB", "8192 MiB", "divide it"] {
            assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
        }
    }

    #[test]
    fn a_file_without_end_is_not_read_to_its_end() {
        let endless = Path::new("/dev/zero");
        if endless.exists() {
            assert!(FACTS.read(endless).unwrap_err().to_string().contains("4 MiB"));
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
