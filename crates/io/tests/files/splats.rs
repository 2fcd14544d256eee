//! `.spz`, `.splat` and compressed PLY files, as their formats are described.

use flate2::{Compression, write::GzEncoder};
use specula_core::{
    activation::sigmoid,
    antialias::LowPass,
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values},
    sh::Y0,
};
use specula_io::{
    gaussian_ply,
    model_folder::{self, Model},
    splat, spz,
};
use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};
use tempfile::TempDir;

/// Exponentials, logarithms and logits in `f32`.
const ROUNDED: f32 = 1e-5;
/// Two steps of the ten bits of a quat over its range.
const QUAT_STEPS: f32 = 2.0 * core::f32::consts::SQRT_2 / 1023.0;

fn cloud(layout: Layout, count: usize) -> Gaussians<Vec<f32>> {
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for index in 0..count {
        let step = index as f32;
        gaussians.set(index, MEAN, [step, -0.5 * step, 0.25]);
        // The first are the largest, the order of .splat files.
        gaussians.set(index, LOG_SCALE, [-1.0 - step, -1.5, -2.0]);
        gaussians.set(index, QUAT, [0.5, -0.5, 0.5, 0.5]);
        gaussians.set(index, OPACITY, [1.0]);
        for plane in layout.sh_start()..layout.sh_end() {
            gaussians.set(index, plane, [0.01 * plane as f32]);
        }
    }
    gaussians
}

fn close(found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "numbers are missing");
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }
}

fn place(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

fn open(path: &Path) -> Model {
    model_folder::open(path).unwrap()
}

fn refusal(path: &Path) -> String {
    model_folder::open(path).expect_err("this file is broken").to_string()
}

#[test]
fn written_spz_files_are_read_back() {
    for degree in 0..4 {
        let (_folder, path) = place("a.spz");
        let gaussians = cloud(Layout::radiance(degree), 21);
        spz::write(&path, &gaussians).unwrap();
        assert_eq!(open(&path).gaussians, spz::stored(&gaussians), "degree {degree}");
    }
}

#[test]
fn written_splat_files_are_read_back() {
    let (_folder, path) = place("a.splat");
    let gaussians = cloud(Layout::radiance(0), 5);
    splat::write(&path, &gaussians).unwrap();
    close(&open(&path).gaussians.values, &splat::stored(&gaussians).values, ROUNDED);
}

/// Arrays of two Gaussians: means, opacities, colours, scales, rotations of three or four bytes.
fn arrays(rotation: &[u8]) -> [Vec<u8>; 5] {
    let mean = |x: i32| x.to_le_bytes()[..3].to_vec();
    [
        [mean(256), mean(-256), mean(128), mean(0), mean(0), mean(-1)].concat(),
        vec![255, 51],
        vec![128; 6],
        vec![160, 144, 128, 160, 160, 160],
        [rotation, rotation].concat(),
    ]
}

fn header(version: u32, flags: u8, arrays: u8) -> Vec<u8> {
    let words = [0x5053_474e_u32, version, 2].map(u32::to_le_bytes);
    [words.concat(), vec![0, 8, flags, arrays]].concat()
}

fn assert_holds_the_arrays(model: &Model, quat: [f32; 4]) {
    let gaussians = &model.gaussians;
    assert_eq!((gaussians.count, gaussians.layout.sh_degree), (2, Some(0)), "of the header");
    assert_eq!(gaussians.get::<3>(0, MEAN), [1.0, -1.0, 0.5], "the first mean");
    assert_eq!(gaussians.get::<3>(1, MEAN), [0.0, 0.0, -1.0 / 256.0], "the second mean");
    assert_eq!(gaussians.get::<3>(0, LOG_SCALE), [0.0, -1.0, -2.0], "the first scales");
    close(&[sigmoid(gaussians.get::<1>(1, OPACITY)[0])], &[0.2], ROUNDED);
    close(&gaussians.get::<3>(0, 11), &[(128.0 / 255.0 - 0.5) / 0.15; 3], ROUNDED);
    close(&gaussians.get::<4>(0, QUAT), &quat, 0.01);
}

#[test]
fn version_2_has_rotations_of_three_bytes_and_may_lack_gzip() {
    let bytes = [header(2, 0, 0), arrays(&[191, 64, 191]).concat()].concat();
    let (_folder, path) = place("a.spz");
    fs::write(&path, &bytes).unwrap();
    assert_holds_the_arrays(&open(&path), [0.5, 0.5, -0.5, 0.5]);
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&bytes).unwrap();
    fs::write(&path, gzip.finish().unwrap()).unwrap();
    assert_holds_the_arrays(&open(&path), [0.5, 0.5, -0.5, 0.5]);
}

/// Frame of Zstandard with one uncompressed block.
fn frame(bytes: &[u8]) -> Vec<u8> {
    let block = (bytes.len() as u32) << 3 | 1;
    [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, bytes.len() as u8], &block.to_le_bytes()[..3], bytes].concat()
}

#[test]
fn version_4_has_a_frame_for_each_array() {
    // The largest component is the last, w; the others are 0.
    let arrays = arrays(&(3_u32 << 30).to_le_bytes());
    let frames: Vec<Vec<u8>> = arrays.iter().map(|array| frame(array)).collect();
    let mut bytes = [header(4, 1, 5), 32_u32.to_le_bytes().to_vec(), vec![0; 12]].concat();
    for (frame, array) in frames.iter().zip(&arrays) {
        bytes.extend([frame.len() as u64, array.len() as u64].map(u64::to_le_bytes).concat());
    }
    bytes.extend(frames.concat());
    let (_folder, path) = place("a.spz");
    fs::write(&path, &bytes).unwrap();
    let model = open(&path);
    assert_holds_the_arrays(&model, [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(model.gaussians.layout.low_pass, LowPass::Compensated, "the flag of its training");
    fs::write(&path, &bytes[..bytes.len() - 4]).unwrap();
    assert!(refusal(&path).contains("a.spz"));
}

#[test]
fn damaged_files_are_refused_in_a_sentence() {
    let (_folder, path) = place("a.spz");
    for (bytes, word) in [
        (header(1, 0, 0), "version 1"),
        (header(5, 0, 0), "version 5"),
        (header(3, 0, 0), "cut short"),
        (header(3, 0, 0)[..9].to_vec(), "too short"),
        (vec![0; 40], "header"),
    ] {
        fs::write(&path, bytes).unwrap();
        assert!(refusal(&path).contains(word), "{}", refusal(&path));
    }
    let path = path.with_file_name("a.splat");
    fs::write(&path, [0; 33]).unwrap();
    assert!(refusal(&path).contains("33 bytes"));
    fs::write(&path, [255; 32]).unwrap();
    assert!(refusal(&path).contains("not finite"));
}

/// A compressed PLY with a chunk and a Gaussian for each row of four integers.
fn compressed(colors: &str, ranges: &[f32], rows: &[[u32; 4]], harmonics: &[u8]) -> Vec<u8> {
    let floats = |names: &str| -> String { names.split(' ').map(|name| format!("property float {name}\n")).collect() };
    let ranges_of = "min_x min_y min_z max_x max_y max_z min_scale_x min_scale_y min_scale_z max_scale_x max_scale_y \
                     max_scale_z";
    let packed = ["position", "rotation", "scale", "color"].map(|name| format!("property uint packed_{name}\n"));
    let mut text = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk 1\n{}{}element vertex {}\n{}",
        floats(ranges_of),
        if colors.is_empty() { String::new() } else { floats(colors) },
        rows.len(),
        packed.concat()
    );
    if !harmonics.is_empty() {
        let names: String = (0..9).map(|k| format!("property uchar f_rest_{k}\n")).collect();
        text += &format!("element sh {}\n{names}", rows.len());
    }
    let ranges: Vec<u8> = ranges.iter().flat_map(|number| number.to_le_bytes()).collect();
    let rows: Vec<u8> = rows.iter().flatten().flat_map(|integer| integer.to_le_bytes()).collect();
    [text.as_bytes(), b"end_header\n", &ranges, &rows, harmonics].concat()
}

#[test]
fn compressed_ply_files_are_read() {
    const RANGES: [f32; 12] = [-1.0, -2.0, 0.0, 1.0, 2.0, 4.0, -6.0, -5.0, -4.0, -3.0, -2.0, -1.0];
    // Largest index 3, the last component z; the others are 0 in the middle of their range.
    let unturned_z = 3 << 30 | 511 << 20 | 511 << 10 | 511;
    let rows = [[u32::MAX, unturned_z, 0, 0xff80_40ff], [0, unturned_z, u32::MAX, 0x0000_0033]];
    let (_folder, path) = place("a.compressed.ply");
    fs::write(&path, compressed("", &RANGES, &rows, &[])).unwrap();
    let file = gaussian_ply::read(&path).unwrap();
    let gaussians = &file.gaussians;
    assert_eq!(gaussians.get::<3>(0, MEAN), [1.0, 2.0, 4.0]);
    assert_eq!(gaussians.get::<3>(1, MEAN), [-1.0, -2.0, 0.0]);
    assert_eq!(gaussians.get::<3>(0, LOG_SCALE), [-6.0, -5.0, -4.0]);
    assert_eq!(gaussians.get::<3>(1, LOG_SCALE), [-3.0, -2.0, -1.0]);
    close(&gaussians.get::<4>(0, QUAT), &[0.0, 0.0, 0.0, 1.0], QUAT_STEPS);
    let color = gaussians.get::<3>(0, 11).map(|number| 0.5 + Y0 * number);
    close(&color, &[1.0, 128.0 / 255.0, 64.0 / 255.0], ROUNDED);
    close(&[sigmoid(gaussians.get::<1>(1, OPACITY)[0])], &[0.2], ROUNDED);

    let ranges = [&RANGES[..], &[-0.5, 0.0, 0.0, 1.5, 1.0, 1.0]].concat();
    let harmonics = [[0_u8, 1, 2, 3, 4, 5, 6, 7, 255]; 2].concat();
    fs::write(&path, compressed("min_r min_g min_b max_r max_g max_b", &ranges, &rows, &harmonics)).unwrap();
    let gaussians = gaussian_ply::read(&path).unwrap().gaussians;
    close(&[0.5 + Y0 * gaussians.get::<1>(0, 11)[0]], &[1.5], ROUNDED);
    // Colour by colour: the second coefficient of green is the fifth byte.
    assert_eq!(gaussians.get::<3>(0, 14), [-4.0, 8.0 * (3.5 / 256.0 - 0.5), 8.0 * (6.5 / 256.0 - 0.5)]);
    assert_eq!(gaussians.get::<3>(0, 20)[2], 4.0);

    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() - 1]).unwrap();
    assert!(refusal(&path).contains("cut short"));
    let text = String::from_utf8_lossy(&whole[..700]).replace("max_scale_z", "max_scale_w");
    fs::write(&path, text).unwrap();
    assert!(model_folder::open(&path).is_err());
}
