//! Gaussians and points as PLY files: every layout and encoding, and how what is broken is refused.

use specula_core::scene::{
    DIFFUSE, Gaussians, LOG_SCALE, Layout, NORMAL_RESIDUAL_1, OPACITY, QUAT, ROUGHNESS, TINT, len_of_values,
};
use specula_io::{
    gaussian_ply::{self, GaussianFile},
    points_ply::{self, PointCloud},
};
use std::{
    fs,
    path::{Path, PathBuf},
};
use tempfile::TempDir;

const LAYOUTS: [Layout; 13] = [
    Layout::radiance(0),
    Layout::radiance(1),
    Layout::radiance(2),
    Layout::radiance(3),
    Layout::shaded(None),
    Layout::shaded(Some(0)),
    Layout::shaded(Some(1)),
    Layout::shaded(Some(2)),
    Layout::shaded(Some(3)),
    Layout::radiance(2).antialiased(),
    Layout::shaded(Some(1)).antialiased(),
    Layout::shaded(None).physical(),
    Layout::shaded(Some(2)).physical().antialiased(),
];

/// Plane p of Gaussian i is p + i / 64: exact in every format.
fn gaussians(layout: Layout, count: usize) -> Gaussians<Vec<f32>> {
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for gaussian in 0..count {
        for plane in 0..layout.plane_count() {
            gaussians.set(gaussian, plane, [plane as f32 + gaussian as f32 / 64.0]);
        }
    }
    gaussians
}

fn written(gaussians: &Gaussians<Vec<f32>>) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    gaussian_ply::write(&path, gaussians, &["made by a test".to_owned()]).unwrap();
    (folder, path)
}

fn write(text: impl AsRef<[u8]>) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    fs::write(&path, text).unwrap();
    (folder, path)
}

fn header_of(path: &Path) -> Vec<String> {
    let text = String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
    text.lines().take_while(|line| *line != "end_header").map(str::to_owned).collect()
}

fn properties_of(path: &Path) -> Vec<String> {
    header_of(path).iter().filter_map(|line| Some(line.strip_prefix("property float ")?.to_owned())).collect()
}

fn refusal(path: &Path) -> String {
    gaussian_ply::read(path).expect_err("this file is broken").to_string()
}

fn assert_says(sentence: &str, parts: &[&str]) {
    for part in parts {
        assert!(sentence.contains(part), "{part:?} is missing in: {sentence}");
    }
}

/// The same file in another encoding, with a property of another type and one that nobody asked
/// for.
fn translated(path: &Path, encoding: &str) -> Vec<u8> {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let header = header.replace("binary_little_endian", encoding);
    let header = header.replace("property float x\n", "property uchar flag\nproperty double x\n");

    let numbers: Vec<f32> = bytes[end..].chunks(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect();
    let row_len = header.matches("property").count() - 1;
    let mut out = header.into_bytes();
    for row in numbers.chunks(row_len) {
        match encoding {
            "ascii" => {
                let words: Vec<String> = row.iter().map(|number| format!("{number:e}")).collect();
                out.extend(format!("7 {}\r\n", words.join(" ")).bytes());
            }
            "binary_big_endian" => {
                out.push(7);
                out.extend(f64::from(row[0]).to_be_bytes());
                out.extend(row[1..].iter().flat_map(|number| number.to_be_bytes()));
            }
            _ => {
                out.push(7);
                out.extend(f64::from(row[0]).to_le_bytes());
                out.extend(row[1..].iter().flat_map(|number| number.to_le_bytes()));
            }
        }
    }
    out
}

#[test]
fn every_layout_survives_a_round_trip() {
    for (layout, count) in LAYOUTS.into_iter().zip([1, 15, 16, 17, 33, 0, 40, 2, 100, 18, 31, 19, 48]) {
        let gaussians = gaussians(layout, count);
        let (_folder, path) = written(&gaussians);
        let read = gaussian_ply::read(&path).unwrap();
        assert_eq!(
            read,
            GaussianFile {
                gaussians,
                comments: vec!["made by a test".to_owned()],
                notes: vec![],
                are_materials: false
            }
        );
    }
}

#[test]
fn every_encoding_says_the_same() {
    for layout in LAYOUTS {
        let gaussians = gaussians(layout, 21);
        let (_folder, path) = written(&gaussians);
        for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
            fs::write(&path, translated(&path, encoding)).unwrap();
            assert_eq!(gaussian_ply::read(&path).unwrap().gaussians, gaussians, "{encoding}, {layout:?}");
            gaussian_ply::write(&path, &gaussians, &[]).unwrap();
        }
    }
}

#[test]
fn radiance_is_written_in_the_order_of_3d_gaussian_splatting() {
    let (_folder, path) = written(&gaussians(Layout::radiance(3), 1));
    let rest: Vec<String> = (0..45).map(|i| format!("f_rest_{i}")).collect();
    let expected = [
        &["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].map(str::to_owned)[..],
        &rest,
        &["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(str::to_owned),
    ];
    assert_eq!(properties_of(&path), expected.concat());
    assert_eq!(
        header_of(&path)[..4],
        ["ply", "format binary_little_endian 1.0", "comment made by a test", "element vertex 1"]
    );
}

#[test]
fn shading_is_written_in_the_order_of_gaussian_shader() {
    let (_folder, path) = written(&gaussians(Layout::shaded(None), 1));
    let expected = "x y z nx ny nz nx2 ny2 nz2 f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 \
                    rot_3 roughness specular0 specular1 specular2";
    assert_eq!(properties_of(&path).join(" "), expected);

    let (_folder, path) = written(&gaussians(Layout::shaded(Some(1)), 1));
    assert_eq!(
        properties_of(&path)[12..25].join(" "),
        (0..12).map(|i| format!("f_rest_{i} ")).collect::<String>() + "opacity"
    );
}

/// The number in the file under a property's name, for one Gaussian.
fn in_file(layout: Layout, property: &str) -> f32 {
    let (_folder, path) = written(&gaussians(layout, 1));
    let bytes = fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
    let index = properties_of(&path).iter().position(|name| name == property).unwrap();
    f32::from_le_bytes(bytes[end + 4 * index..][..4].try_into().unwrap())
}

#[test]
fn properties_hold_the_planes_that_they_should() {
    let (radiance, shaded) = (Layout::radiance(2), Layout::shaded(Some(2)));
    // Colour by colour without the constant: f_rest_9 is coefficient 2 of green, plane 3k + c.
    assert_eq!(in_file(radiance, "f_rest_9"), (radiance.sh_start() + 3 * 2 + 1) as f32);
    assert_eq!(in_file(radiance, "f_dc_2"), (radiance.sh_start() + 2) as f32);
    assert_eq!(in_file(radiance, "ny"), 0.0);
    // Coefficient by coefficient with the constant.
    assert_eq!(in_file(shaded, "f_rest_9"), (shaded.sh_start() + 9) as f32);
    assert_eq!(in_file(shaded, "f_dc_1"), (DIFFUSE + 1) as f32);
    assert_eq!(in_file(shaded, "nz"), (NORMAL_RESIDUAL_1 + 2) as f32);
    assert_eq!(in_file(shaded, "nx2"), (NORMAL_RESIDUAL_1 + 3) as f32);
    assert_eq!(in_file(shaded, "rot_0"), QUAT as f32);
    assert_eq!(in_file(shaded, "roughness"), ROUGHNESS as f32);
    assert_eq!(in_file(shaded, "specular2"), (TINT + 2) as f32);
}

#[test]
fn a_quat_of_no_length_is_accepted() {
    let mut none = gaussians(Layout::radiance(0), 2);
    none.set(1, QUAT, [0.0; 4]);
    let (_folder, path) = written(&none);
    assert_eq!(gaussian_ply::read(&path).unwrap().gaussians, none);
}

#[test]
fn a_file_cut_short_is_refused_with_what_is_there() {
    let (_folder, path) = written(&gaussians(Layout::radiance(0), 100));
    let bytes = fs::read(&path).unwrap();
    let row = 4 * 17;
    fs::write(&path, &bytes[..bytes.len() - 30 * row - 5]).unwrap();
    assert_says(&refusal(&path), &["a.ply", "cut short", "69 of 100"]);
    fs::write(&path, &bytes[..200]).unwrap();
    assert_says(&refusal(&path), &["a.ply"]);

    gaussian_ply::write(&path, &gaussians(Layout::radiance(0), 100), &[]).unwrap();
    let text = translated(&path, "ascii");
    let lines: Vec<&[u8]> = text.split_inclusive(|byte| *byte == b'\n').collect();
    fs::write(&path, lines[..lines.len() - 12].concat()).unwrap();
    assert_says(&refusal(&path), &["a.ply", "cut short", "88 of 100"]);
}

#[test]
fn a_missing_property_is_refused_by_name_and_layout() {
    for (layout, gone, expected) in [
        (Layout::radiance(1), "rot_3", "3D Gaussian splatting"),
        (Layout::shaded(None), "nx2", "GaussianShader"),
        (Layout::shaded(None), "specular1", "GaussianShader"),
        (Layout::radiance(1), "f_rest_4", "3D Gaussian splatting"),
    ] {
        let (_folder, path) = written(&gaussians(layout, 3));
        let bytes = fs::read(&path).unwrap();
        let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap();
        let header =
            String::from_utf8(bytes[..end].to_vec()).unwrap().replace(&format!("float {gone}\n"), "float other\n");
        let header = header.replace("other", if gone.starts_with("f_rest") { "f_rest_99" } else { "other" });
        fs::write(&path, [header.as_bytes(), &bytes[end..]].concat()).unwrap();
        assert_says(&refusal(&path), &["a.ply", &format!("\"{gone}\""), expected]);
    }
}

#[test]
fn harmonics_of_no_degree_are_refused() {
    let (_folder, path) = written(&gaussians(Layout::radiance(1), 1));
    let bytes = fs::read(&path).unwrap();
    let changed: Vec<u8> = String::from_utf8_lossy(&bytes).replace("float f_rest_8\n", "float f_rust_8\n").into_bytes();
    fs::write(&path, changed).unwrap();
    assert_says(&refusal(&path), &["8 properties f_rest_*", "a.ply", "0, 9, 24 or 45"]);
}

#[test]
fn numbers_that_are_not_finite_are_refused_by_place_and_count() {
    let mut broken = gaussians(Layout::shaded(None), 40);
    broken.set(20, ROUGHNESS, [f32::NAN]);
    broken.set(7, DIFFUSE + 1, [f32::INFINITY]);
    broken.set(7, TINT, [f32::NEG_INFINITY]);
    let (_folder, path) = written(&broken);
    assert_says(&refusal(&path), &["3 numbers", "a.ply", "vertex 7", "\"f_dc_1\""]);
}

/// A file with other names of its columns, of as many bytes in each row.
fn renamed(path: &Path, names: &[(&str, &str)]) {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap();
    let mut header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    for (from, to) in names {
        header = header.replacen(&format!("property float {from}\n"), to, 1);
    }
    fs::write(path, [header.as_bytes(), &bytes[end..]].concat()).unwrap();
}

#[test]
fn layouts_of_baselines_are_shown_by_their_harmonics_and_other_columns_are_noted() {
    let written_first = gaussians(Layout::radiance(3), 20);
    // Columns instead of normals, which plain Gaussians may lack.
    for names in [
        ["roughness", "metallic", "base_color_0"],
        ["metallic", "refl_strength", "ambient_0"],
        ["specular0", "roughness", "incidents_dc_0"],
    ] {
        let (_folder, path) = written(&written_first);
        let columns = names.map(|name| format!("property float {name}\n"));
        renamed(&path, &[("nx", &columns[0]), ("ny", &columns[1]), ("nz", &columns[2])]);
        let read = gaussian_ply::read(&path).unwrap();
        assert_eq!(read.gaussians, written_first, "{names:?}");
        assert_says(&read.notes.concat(), &names);
    }
    let shaded = gaussians(Layout::shaded(Some(3)), 20);
    let (_folder, path) = written(&shaded);
    renamed(&path, &[("f_rest_47", "property float f_rest_47\n")]);
    let read = gaussian_ply::read(&path).unwrap();
    assert_eq!((read.gaussians, read.notes), (shaded, vec![]), "GaussianShader's own layout");
}

#[test]
fn rows_without_rotation_and_numbers_after_activation_are_noted() {
    let notes = |change: &dyn Fn(&mut Gaussians<Vec<f32>>)| {
        let mut gaussians = gaussians(Layout::radiance(1), 20);
        (0..20).for_each(|index| gaussians.set(index, QUAT, [1.0, 0.0, 0.5, 0.0]));
        change(&mut gaussians);
        let (_folder, path) = written(&gaussians);
        gaussian_ply::read(&path).unwrap().notes.concat()
    };
    assert_eq!(notes(&|_| {}), "");
    assert_says(&notes(&|gaussians| gaussians.set(7, QUAT, [0.0; 4])), &["1 Gaussians with the rotation 0 0 0 0"]);
    let activated = notes(&|gaussians| {
        for index in 0..20 {
            gaussians.set(index, LOG_SCALE, [0.01, 0.2, 0.3]);
            gaussians.set(index, OPACITY, [0.5]);
        }
    });
    assert_says(&activated, &["read as logarithms and logits"]);
}

#[test]
fn gaussians_with_two_scales_are_flat() {
    let solid = gaussians(Layout::radiance(1), 20);
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let (_folder, path) = written(&solid);
        fs::write(&path, translated(&path, encoding)).unwrap();
        let text = fs::read(&path).unwrap();
        let at = text.windows(7).position(|window| window == b"scale_2").unwrap();
        fs::write(&path, [&text[..at], b"unknown", &text[at + 7..]].concat()).unwrap();
        let read = gaussian_ply::read(&path).unwrap();
        for index in 0..20 {
            let [one, other, third] = read.gaussians.get::<3>(index, LOG_SCALE);
            assert_eq!([one, other], solid.get::<2>(index, LOG_SCALE), "{encoding}");
            assert!((third - one.min(other) + 1000_f32.ln()).abs() < 1e-5, "{encoding}: {third}");
        }
        assert_says(&read.notes.concat(), &["two scales", "unknown", "flag"]);
    }
}

#[test]
fn infinities_with_a_meaning_are_read_as_it_says() {
    let mut known = gaussians(Layout::radiance(0), 20);
    known.set(3, OPACITY, [f32::INFINITY]);
    known.set(17, OPACITY, [f32::NEG_INFINITY]);
    known.set(5, LOG_SCALE, [-2.0, f32::NEG_INFINITY, -4.0]);
    known.set(6, LOG_SCALE, [f32::NEG_INFINITY; 3]);
    let (_folder, path) = written(&known);
    let GaussianFile { gaussians: read, notes, .. } = gaussian_ply::read(&path).unwrap();
    assert!(read.get::<1>(3, OPACITY)[0] > 15.0 && read.get::<1>(17, OPACITY)[0] < -15.0);
    let [one, flat, other] = read.get::<3>(5, LOG_SCALE);
    assert!([one, other] == [-2.0, -4.0] && (-12.0..-10.0).contains(&flat), "{flat}");
    assert!(read.get::<3>(6, LOG_SCALE)[0] < -20.0);
    assert_says(&notes.concat(), &["2 infinite opacities", "2 Gaussians"]);
    for (plane, number) in [(LOG_SCALE, f32::INFINITY), (OPACITY, f32::NAN), (QUAT, f32::NEG_INFINITY)] {
        let mut broken = known.clone();
        broken.set(9, plane, [number]);
        let (_folder, path) = written(&broken);
        assert_says(&refusal(&path), &["1 numbers", "vertex 9"]);
    }
}

#[test]
fn names_that_stand_twice_are_refused() {
    let (_folder, path) = written(&gaussians(Layout::radiance(0), 3));
    renamed(&path, &[("nx", "property float opacity\n")]);
    assert_says(&refusal(&path), &["a.ply", "\"vertex opacity\" twice"]);
    let (_folder, path) = write(behind("element vertex 1\nproperty float x\n", &[0; 4]));
    assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["\"vertex\" twice"]);
}

#[test]
fn files_of_known_kinds_are_named() {
    let xyz = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    let points = format!("{xyz}property uchar red\nend_header\n1 2 3 4\n");
    let mesh = format!("{xyz}element face 1\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n1 0\n");
    let folder = tempfile::tempdir().unwrap();
    for (name, contents, words) in [
        ("a.ply", points.as_bytes(), ["point cloud", "--points"]),
        ("a.ply", mesh.as_bytes(), ["mesh", "trained"]),
        ("a.ply", b"version https://git-lfs.github.com/spec/v1\n", ["Git LFS", "git lfs pull"]),
        ("a.ply", b"<!DOCTYPE html>", ["web page", "again"]),
        ("a.ply", b"\x1f\x8b\x08\0", ["archive", "unpack"]),
        ("a.SPZ", b"\x1f\x8b\x08\0", [".spz", "as a scene"]),
        ("a.splat", &[0; 32], [".splat", "as a scene"]),
        ("a.ksplat", &[0; 32], [".ksplat", "SuperSplat"]),
        ("a.sog", b"PK\x03\x04", [".sog", "SuperSplat"]),
        ("a.lcc", b"{}", [".lcc", "SuperSplat"]),
        ("a.usdz", b"PK\x03\x04", ["USD", "does not read"]),
        ("a.stl", b"solid", ["mesh", "trained"]),
        ("a", b"v 1 2 3\n", ["PLY", "ply"]),
        ("chkpnt30000.pth", b"PK\x03\x04", ["checkpoint", "point_cloud.ply"]),
        ("a.bin", b"\x89PNG\r\n", ["picture", "not a scene"]),
        ("a.MOV", b"\0\0\0\x14ftypqt", ["a video", "specula capture"]),
        ("a.las", b"LASF", ["point cloud", "--points"]),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, contents).unwrap();
        assert_says(&refusal(&path), &words);
    }
}

#[test]
fn a_word_is_no_number() {
    let (_folder, path) = write(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
         1 2 3\n4 five 6\n",
    );
    assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["\"five\"", "vertex 1", "a.ply", "\"y\""]);
}

#[test]
fn a_damaged_compressed_file_is_refused() {
    let (_folder, path) = write(
        "ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 4\n\
         property uint packed_position\nproperty uint packed_rotation\nend_header\n0000",
    );
    assert_says(&refusal(&path), &["a.ply", "cut short"]);
}

#[test]
fn files_of_other_kinds_are_refused() {
    for text in ["", "no ply", "ply\nformat ascii 1.0\nend_header\n", "ply\nformat ascii 1.0\nelement vertex 3\n"] {
        let (_folder, path) = write(text);
        assert_says(&refusal(&path), &["a.ply"]);
    }
    assert_says(&refusal(Path::new("/no/such.ply")), &["cannot read \"/no/such.ply\""]);
}

#[test]
fn a_list_among_the_vertices_is_refused() {
    let (_folder, path) = write(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
         property list uchar int near\nend_header\n1 2 3 1 0\n",
    );
    assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["\"near\"", "a.ply", "list"]);
}

#[test]
fn a_header_cannot_ask_for_more_than_the_file_holds() {
    let (_folder, path) = write(
        "ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\nproperty float x\nproperty float y\n\
         property float z\nend_header\nabc",
    );
    assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["a.ply", "999999999999 vertices"]);
}

#[test]
fn elements_before_the_vertices_are_skipped() {
    let (_folder, path) = write(
        "ply\nformat ascii 1.0\nelement camera 1\nproperty list uchar float pose\nelement vertex 1\nproperty float x\n\
         property float y\nproperty float z\nend_header\n2 0.5 0.5\n1 2 3\n",
    );
    assert_eq!(points_ply::read(&path).unwrap().positions, [[1.0, 2.0, 3.0]]);
}

/// A point behind other elements, in binary.
fn behind(elements: &str, bytes: &[u8]) -> Vec<u8> {
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let header = format!("ply\nformat binary_little_endian 1.0\n{elements}element vertex 1\n{xyz}end_header\n");
    [header.as_bytes(), bytes, &[1.0_f32, 2.0, 3.0].map(f32::to_le_bytes).concat()].concat()
}

#[test]
fn elements_are_skipped_without_being_kept() {
    let lists = "element face 3\nproperty uchar kind\nproperty list ushort short near\n";
    for (elements, bytes) in [
        ("", &[][..]),
        // Nothing stands in a file for what has no properties.
        ("element junk 1000000000\n", &[]),
        ("element junk 18446744073709551615\n", &[]),
        ("element camera 2\nproperty double a\nproperty uchar b\n", &[7; 18]),
        (lists, &[9, 0, 0, 9, 2, 0, 1, 1, 1, 1, 9, 1, 0, 5, 5]),
    ] {
        let (_folder, path) = write(behind(elements, bytes));
        assert_eq!(points_ply::read(&path).unwrap().positions, [[1.0, 2.0, 3.0]], "{elements}");
    }
    let (_folder, path) = write(
        "ply\nformat ascii 1.0\nelement junk 1000000000\nelement vertex 1\nproperty float x\n\
         property float y\nproperty float z\nend_header\n1 2 3\n",
    );
    assert_eq!(points_ply::read(&path).unwrap().positions, [[1.0, 2.0, 3.0]]);
}

#[test]
fn elements_that_the_file_does_not_hold_are_refused() {
    for (elements, word) in [
        ("element face 1000000000\nproperty list uchar int near\n", "\"face\""),
        ("element face 1\nproperty list uint double near\n", "\"face\""),
        ("element face 1\nproperty list char int near\n", "no length"),
        ("element face 1\nproperty list float int near\n", "no length"),
        ("element camera 18446744073709551615\nproperty double a\nproperty double b\n", "\"camera\""),
    ] {
        let (_folder, path) = write(behind(elements, &[0xff; 8]));
        assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["a.ply", word]);
    }
}

/// Holes take no room on a disk, so that a few bytes are a file of any length.
#[test]
fn a_file_that_is_longer_than_a_scene_may_be_is_refused_by_its_size() {
    let (_folder, path) = write(
        "ply\nformat binary_little_endian 1.0\nelement vertex 5000000000\nproperty float x\nproperty float y\n\
         property float z\nend_header\n",
    );
    fs::File::options().write(true).open(&path).unwrap().set_len(60 << 30).unwrap();
    assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["a.ply", "61440 MiB", "8192 MiB", "split it"]);
}

#[test]
fn headers_and_lines_have_an_end() {
    let long = "0".repeat(2 << 20);
    let (_folder, path) = write(format!("ply\ncomment {long}\n"));
    assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["a.ply", "1048576 bytes"]);
    let (_folder, path) = write(format!(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
         {long} 2 3\n"
    ));
    assert_says(&points_ply::read(&path).unwrap_err().to_string(), &["a.ply", "1048576 bytes"]);
}

#[test]
fn points_survive_a_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input.ply");
    let points = PointCloud {
        positions: (0..35).map(|i| [f64::from(i), -0.5 * f64::from(i), 1e6]).collect(),
        colors: (0..35).map(|i| [i as f32 / 255.0, 1.0, 0.2]).collect(),
    };
    points_ply::write(&path, &points).unwrap();
    assert_eq!(points_ply::read(&path).unwrap(), points);
}

#[test]
fn colours_are_bytes_or_fractions_or_none() {
    let read = |colors: &str, row: &str| {
        let (_folder, path) = write(format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\n{colors}\
             end_header\n1 2 3 {row}\n"
        ));
        points_ply::read(&path).unwrap().colors[0]
    };
    let colors = |kind: &str| ["red", "green", "blue"].map(|name| format!("property {kind} {name}\n")).concat();
    assert_eq!(read(&colors("uchar"), "255 0 51"), [1.0, 0.0, 0.2]);
    assert_eq!(read(&colors("float"), "0.25 0.5 1"), [0.25, 0.5, 1.0]);
    assert_eq!(read("", ""), [0.5; 3]);
}
