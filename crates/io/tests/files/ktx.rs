//! Cube maps for other programs, read back by a reader that is not ours.

use ktx2::{ColorModel, Format, Header, LevelIndex, Reader, TransferFunction};
use specula_core::{cubemap::texel_index, pack::unpack2};
use specula_io::ktx::{self, CubeLevel};
use std::fs;

/// Numbers that halves hold, different for every texel of every level.
fn chain(resolution: usize, count: usize) -> Vec<CubeLevel> {
    let level = |level: usize| {
        let resolution = resolution >> level;
        let rgb = (0..18 * resolution * resolution).map(|k| k as f32 + 0.25 * level as f32).collect();
        CubeLevel { resolution, rgb }
    };
    (0..count).map(level).collect()
}

fn written(levels: &[CubeLevel], notes: &[(&str, &str)]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.ktx2");
    ktx::write_cube(&path, levels, notes).unwrap();
    fs::read(path).unwrap()
}

/// Red, green, blue and alpha of eight bytes.
fn texel(bytes: &[u8]) -> [f32; 4] {
    let word = |at: usize| unpack2(u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
    let ([r, g], [b, a]) = (word(0), word(4));
    [r, g, b, a]
}

#[test]
fn a_reader_of_others_finds_every_texel_of_every_level() {
    let levels = chain(8, 4);
    let file = Reader::new(written(&levels, &[])).unwrap();
    let header = file.header();
    assert_eq!(header.format, Some(Format::R16G16B16A16_SFLOAT));
    assert_eq!((header.pixel_width, header.pixel_height, header.pixel_depth), (8, 8, 0));
    assert_eq!((header.face_count, header.layer_count, header.level_count, header.type_size), (6, 0, 4, 2));
    assert_eq!(header.supercompression_scheme, None);
    assert_eq!(file.levels().len(), levels.len());
    for (found, CubeLevel { resolution, rgb }) in file.levels().zip(&levels) {
        assert_eq!(found.data.len(), 6 * resolution * resolution * 8);
        for (found, expected) in found.data.chunks_exact(8).zip(rgb.chunks_exact(3)) {
            assert_eq!(texel(found), [expected[0], expected[1], expected[2], 1.0]);
        }
    }
}

#[test]
fn faces_and_rows_lie_as_core_counts_them() {
    let resolution = 4;
    let mut rgb = vec![0.0; 18 * 16];
    let place = texel_index(3, 2, 1, resolution);
    rgb[3 * place] = 7.0;
    let file = Reader::new(written(&[CubeLevel { resolution, rgb }], &[])).unwrap();
    let level = file.levels().next().unwrap();
    let bright = level.data.chunks_exact(8).position(|bytes| texel(bytes)[0] == 7.0);
    assert_eq!(bright, Some((3 * resolution + 1) * resolution + 2), "face, row, column");
}

#[test]
fn the_format_is_described_as_linear_colours() {
    let file = Reader::new(written(&chain(4, 3), &[])).unwrap();
    assert_eq!(file.color_model(), Some(ColorModel::RGBSDA));
    assert_eq!(file.transfer_function(), Some(TransferFunction::Linear));
    let description = file.basic_dfd().unwrap();
    assert_eq!(description.sample_information.len(), 4, "red, green, blue, alpha");
    assert_eq!(description.bytes_planes[0], 8, "bytes of a texel");
}

#[test]
fn notes_are_kept_in_order_of_their_keys_and_say_how_rows_run() {
    let file = Reader::new(written(&chain(4, 2), &[("roughness", "0 1"), ("a", "")])).unwrap();
    let notes: Vec<(&str, &[u8])> = file.key_value_data().collect();
    let keys: Vec<&str> = notes.iter().map(|(key, _)| *key).collect();
    assert_eq!(keys, ["KTXorientation", "KTXwriter", "a", "roughness"]);
    assert_eq!((notes[0].1, notes[2].1, notes[3].1), (&b"rd\0"[..], &b"\0"[..], &b"0 1\0"[..]));
    assert!(notes[1].1.starts_with(b"specula "), "the program is named");
}

#[test]
fn levels_are_aligned_and_the_coarsest_comes_first() {
    let bytes = written(&chain(8, 4), &[("odd", "x")]);
    let index = |level: usize| {
        let start = Header::LENGTH + LevelIndex::LENGTH * level;
        LevelIndex::from_bytes(bytes[start..start + LevelIndex::LENGTH].try_into().unwrap())
    };
    let places: Vec<LevelIndex> = (0..4).map(index).collect();
    assert!(places.iter().all(|place| place.byte_offset % 8 == 0), "{places:?}");
    for pair in places.windows(2) {
        assert_eq!(pair[1].byte_offset + pair[1].byte_length, pair[0].byte_offset, "one after the other");
    }
    assert_eq!(places[0].byte_offset + places[0].byte_length, bytes.len() as u64, "nothing comes after");
}

#[test]
fn what_no_half_can_hold_is_limited() {
    let rgb = [1e9, 65504.0, 1e-9].repeat(6);
    let file = Reader::new(written(&[CubeLevel { resolution: 1, rgb }], &[])).unwrap();
    let level = file.levels().next().unwrap();
    assert_eq!(texel(level.data), [65504.0, 65504.0, 0.0, 1.0]);
}
