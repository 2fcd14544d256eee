//! Cube maps with all mip levels for other programs, as KTX 2.0.

use crate::{error::Result, whole_file};
use ktx2::{
    Format, Header, Index, LevelIndex,
    dfd::{Basic, Block},
};
use specula_core::{cubemap::FACE_COUNT, pack::pack2};
use std::path::Path;

/// Four half floats: every KTX 2.0 reader supports them, and their relative steps of 2⁻¹¹ are finer
/// than the error of any prefilter.
const FORMAT: Format = Format::R16G16B16A16_SFLOAT;
/// Bytes of a texel, which is also the alignment of levels.
const TEXEL_LEN: usize = 8;
/// Alignment of key-value pairs in bytes.
const NOTE_ALIGNMENT: usize = 4;
/// Face orientation of all graphics APIs: columns to the right, rows down.
const ORIENTATION: (&str, &str) = ("KTXorientation", "rd");
const WRITER: (&str, &str) = ("KTXwriter", concat!("specula ", env!("CARGO_PKG_VERSION")));

/// One level of a cube map.
#[derive(Clone, Debug, PartialEq)]
pub struct CubeLevel {
    /// Texels along an edge of a face.
    pub resolution: usize,
    /// Red, green, blue of each texel: faces +X −X +Y −Y +Z −Z, rows from the top.
    pub rgb: Vec<f32>,
}

/// Writes a cube map as halves with an alpha of 1, finest level first, each half as wide as the one
/// before. Numbers are clamped to ±65504. `notes` are keys and texts that tools show; the format's
/// own keys begin with KTX.
///
/// # Errors
///
/// [`crate::Error::Write`] if the file cannot be written.
pub fn write_cube(path: &Path, levels: &[CubeLevel], notes: &[(&str, &str)]) -> Result<()> {
    for (level, CubeLevel { resolution, rgb }) in levels.iter().enumerate() {
        assert_eq!(*resolution, levels[0].resolution >> level, "each level is half as wide as the one before");
        assert_eq!(rgb.len(), 3 * FACE_COUNT * resolution * resolution, "six faces of resolution² texels");
    }
    whole_file::write_bytes(path, &file_of(levels, notes))
}

/// Bytes of the file: header, level index, format, notes; then the levels, coarsest first.
fn file_of(levels: &[CubeLevel], notes: &[(&str, &str)]) -> Vec<u8> {
    let (format, type_size) = Basic::from_format(FORMAT).expect("halves are known");
    let format = sized(&Block::Basic(format).to_vec());
    let notes = bytes_of_notes(notes);
    let format_at = Header::LENGTH + LevelIndex::LENGTH * levels.len();
    let notes_at = format_at + format.len();

    let mut end = (notes_at + notes.len()).next_multiple_of(TEXEL_LEN);
    let texels_at = end;
    let mut places: Vec<LevelIndex> = levels.iter().rev().map(|level| place(level, &mut end)).collect();
    places.reverse();

    let header = Header {
        format: Some(FORMAT),
        type_size,
        pixel_width: levels[0].resolution as u32,
        pixel_height: levels[0].resolution as u32,
        pixel_depth: 0,
        layer_count: 0,
        face_count: FACE_COUNT as u32,
        level_count: levels.len() as u32,
        supercompression_scheme: None,
        index: Index {
            dfd_byte_offset: format_at as u32,
            dfd_byte_length: format.len() as u32,
            kvd_byte_offset: notes_at as u32,
            kvd_byte_length: notes.len() as u32,
            sgd_byte_offset: 0,
            sgd_byte_length: 0,
        },
    };
    let mut bytes = header.as_bytes().to_vec();
    places.iter().for_each(|place| bytes.extend(place.as_bytes()));
    bytes.extend(format);
    bytes.extend(notes);
    bytes.resize(texels_at, 0);
    levels.iter().rev().for_each(|level| bytes.extend(bytes_of(level)));
    bytes
}

/// Index entry of a level, stored after the preceding levels.
fn place(level: &CubeLevel, end: &mut usize) -> LevelIndex {
    let (start, len) = (*end, level.rgb.len() / 3 * TEXEL_LEN);
    *end += len;
    LevelIndex { byte_offset: start as u64, byte_length: len as u64, uncompressed_byte_length: len as u64 }
}

fn bytes_of(level: &CubeLevel) -> impl Iterator<Item = u8> {
    let words = level.rgb.chunks_exact(3).flat_map(|rgb| [pack2(rgb[0], rgb[1]), pack2(rgb[2], 1.0)]);
    words.flat_map(u32::to_le_bytes)
}

/// Key-value pairs sorted by key, each zero-terminated.
fn bytes_of_notes(notes: &[(&str, &str)]) -> Vec<u8> {
    let mut notes = [notes, &[ORIENTATION, WRITER]].concat();
    notes.sort_unstable();
    let mut bytes = Vec::new();
    for (key, text) in notes {
        let note = [key.as_bytes(), &[0], text.as_bytes(), &[0]].concat();
        bytes.extend((note.len() as u32).to_le_bytes());
        bytes.extend(note);
        bytes.resize(bytes.len().next_multiple_of(NOTE_ALIGNMENT), 0);
    }
    bytes
}

/// Bytes after their length, which includes itself.
fn sized(bytes: &[u8]) -> Vec<u8> {
    let len = (bytes.len() + size_of::<u32>()) as u32;
    [&len.to_le_bytes(), bytes].concat()
}
