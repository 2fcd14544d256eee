//! Findings on files of Gaussians.

use specula_core::{
    activation::sigmoid,
    color::linear_from_srgb,
    scene::{
        ALBEDO, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT,
        ROUGHNESS, len_of_values,
    },
    sh::Y0,
};
use specula_io::{
    gaussian_ply::{self, SurfaceMaterial},
    lint::lint,
    spz,
};
use std::{fs, path::PathBuf};
use tempfile::TempDir;

const COUNT: usize = 40;
/// Logits and the sRGB curve in `f32`.
const ROUNDED: f32 = 1e-5;

/// Gaussians of an ordinary file, whose harmonics are nearly grey.
fn cloud() -> Gaussians<Vec<f32>> {
    let layout = Layout::radiance(1);
    let mut gaussians = Gaussians { count: COUNT, layout, values: vec![0.0; len_of_values(COUNT, layout)] };
    for index in 0..COUNT {
        let step = index as f32;
        gaussians.set(index, MEAN, [0.1 * step, 0.5, 0.25]);
        gaussians.set(index, LOG_SCALE, [-4.0, -4.5, -5.0]);
        gaussians.set(index, QUAT, [1.0, 0.0, 0.0, 0.0]);
        gaussians.set(index, OPACITY, [step - 10.0]);
        for k in 0..3 {
            let grey = (step * (1.0 + k as f32)).sin();
            gaussians.set(index, layout.sh_start() + 3 * (k + 1), [grey, 0.9 * grey, 0.8 * grey]);
        }
    }
    gaussians
}

fn written(change: impl FnOnce(&mut Gaussians<Vec<f32>>), comments: &[String]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let mut gaussians = cloud();
    change(&mut gaussians);
    let normals = [[0.0, 0.0, 1.0]; COUNT];
    gaussian_ply::write_with_normals(&path, &gaussians, Some(&normals), comments).unwrap();
    (folder, path)
}

fn found(path: &std::path::Path) -> Vec<String> {
    lint(path).unwrap().into_iter().map(|finding| finding.found).collect()
}

#[test]
fn an_ordinary_file_has_no_findings() {
    let (_folder, path) = written(|_| (), &[]);
    assert_eq!(found(&path), Vec::<String>::new());
    let spz = path.with_extension("spz");
    spz::write(&spz, &cloud()).unwrap();
    assert_eq!(found(&spz), Vec::<String>::new());
}

#[test]
fn each_unusual_number_is_found() {
    type Change = fn(&mut Gaussians<Vec<f32>>);
    let cases: [(Change, &str); 9] = [
        (|cloud| cloud.set(3, LOG_SCALE + 1, [f32::NEG_INFINITY]), "scales of 0"),
        (|cloud| cloud.set(3, MEAN, [f32::NAN]), "not finite, the first is number 3"),
        (|cloud| cloud.set(3, LOG_SCALE, [f32::INFINITY]), "not finite"),
        (|cloud| cloud.set(3, OPACITY, [f32::INFINITY]), "infinite logits"),
        (|cloud| cloud.set(3, QUAT, [0.0; 4]), "rotation 0 0 0 0"),
        (|cloud| cloud.set(3, QUAT, [2.0, 0.0, 0.0, 0.0]), "not normalised"),
        (|cloud| (0..COUNT).for_each(|index| cloud.set(index, OPACITY, [0.5])), "probably not logits"),
        (|cloud| (0..COUNT).for_each(|index| cloud.set(index, LOG_SCALE, [0.1; 3])), "probably lengths"),
        (|cloud| cloud.set(3, MEAN, [1e6, 0.0, 0.0]), "1000000 from the origin"),
    ];
    for (change, word) in cases {
        let (_folder, path) = written(change, &[]);
        let found = found(&path);
        assert!(found.len() == 1 && found[0].contains(word), "{word}: {found:?}");
    }
}

#[test]
fn harmonics_in_the_order_of_coefficients_are_found() {
    let (_folder, path) = written(
        |cloud| {
            let start = cloud.layout.sh_start() + 3;
            for index in 0..COUNT {
                // Coefficient by coefficient in the columns f_rest.
                let grey: [f32; 9] = cloud.get(index, start);
                cloud.set(index, start, core::array::from_fn::<f32, 9, _>(|plane| grey[3 * (plane % 3) + plane / 3]));
            }
        },
        &[],
    );
    assert!(found(&path).iter().any(|found| found.contains("order red, green, blue")), "{:?}", found(&path));
}

#[test]
fn headers_that_break_loaders_are_found() {
    let (_folder, path) = written(|_| (), &["Grüße".to_owned()]);
    let says = |words: &[&str]| {
        let found = found(&path);
        assert_eq!(found.len(), words.len(), "{found:?}");
        assert!(found.iter().zip(words).all(|(found, word)| found.contains(word)), "{found:?}");
    };
    says(&["has comments", "ASCII"]);
    let bytes = fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|word| word == b"end_header\n").unwrap() + 11;
    let (header, rows) = bytes.split_at(end);
    let header = String::from_utf8(header.to_vec()).unwrap().replace("comment Grüße\n", "");
    let with = |header: String| fs::write(&path, [header.as_bytes(), rows].concat()).unwrap();
    with(header.replace('\n', "\r\n"));
    says(&["CR LF"]);
    with(header.replace("property float nx\nproperty float ny\n", "property float ny\nproperty float nx\n"));
    says(&["not those of INRIA"]);
    with(header.replace("property float n", "property float m"));
    says(&["not those of INRIA", "no normals"]);
}

#[test]
fn relightable_files_have_no_findings_and_are_read_as_materials() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let layout = Layout::radiance(0);
    let mut gaussians = Gaussians { count: COUNT, layout, values: vec![0.0; len_of_values(COUNT, layout)] };
    for index in 0..COUNT {
        gaussians.set(index, LOG_SCALE, [-4.0, -4.5, -5.0]);
        gaussians.set(index, QUAT, [0.0, 2.0, 0.0, 0.0]);
        gaussians.set(index, OPACITY, [index as f32 - 10.0]);
        gaussians.set(index, layout.sh_start(), [(0.75 - 0.5) / Y0, 0.0, (0.2 - 0.5) / Y0]);
    }
    let (normal, back) = ([0.0, 0.6, 0.8], [0.0, -0.8, -0.6]);
    let material = SurfaceMaterial { normal, back, albedo: [0.5; 3], metalness: 0.25, roughness: 0.4 };
    gaussian_ply::write_relightable(&path, &gaussians, &[material; COUNT]).unwrap();
    assert_eq!(found(&path), Vec::<String>::new());
    let text = String::from_utf8_lossy(&fs::read(&path).unwrap()).into_owned();
    assert!(!text.contains("comment"));

    let bytes = fs::read(&path).unwrap();
    // Each family alone, and the names of inspectors.
    for (ours, theirs) in [
        ([("pm", "p1"), ("pr", "p2")], "metallicFactor"),
        ([("metallicFactor", "p1"), ("roughnessFactor", "p2")], "pm"),
        ([("metallicFactor", "metallic"), ("roughnessFactor", "roughness")], "metallic"),
        ([("nx_back", "b1"), ("ny_back", "b2")], "no normals on the other side"),
    ] {
        let mut bytes = bytes.clone();
        for (from, to) in ours {
            let (from, to) = (format!("float {from}\n"), format!("float {to}\n"));
            let at = bytes.windows(from.len()).position(|word| word == from.as_bytes()).unwrap();
            bytes.splice(at..at + from.len(), to.into_bytes());
        }
        fs::write(&path, bytes).unwrap();
        let file = gaussian_ply::read(&path).unwrap();
        assert!(file.are_materials, "{theirs}");
        let read = &file.gaussians;
        let first = read.layout.physical_planes().expect("materials");
        let albedo = read.get::<3>(7, first + ALBEDO).map(sigmoid);
        for (found, encoded) in albedo.into_iter().zip([0.75, 0.5, 0.2]) {
            assert!((found - linear_from_srgb(encoded)).abs() < ROUNDED, "{albedo:?}");
        }
        let [metalness] = read.get::<1>(7, first + METALNESS).map(sigmoid);
        let [roughness] = read.get::<1>(7, ROUGHNESS).map(sigmoid);
        assert!((metalness - 0.25).abs() < ROUNDED && (roughness - 0.4).abs() < ROUNDED, "{metalness} {roughness}");
        // The shortest axis is −z: normals are −z + Δn₁, and z + Δn₂ from the other side.
        let [first, second] = [NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2].map(|plane| read.get::<3>(7, plane));
        let back = if theirs.starts_with("no normals") { normal } else { back };
        for (residual, expected) in [(first, [0.0, 0.6, 1.8]), (second, [0.0, back[1], back[2] - 1.0])] {
            assert!(residual.iter().zip(expected).all(|(a, b)| (a - b).abs() < ROUNDED), "{theirs}: {residual:?}");
        }
        assert_eq!(read.get::<4>(7, QUAT), [0.0, 1.0, 0.0, 0.0], "normalised");
        assert_eq!(read.get::<1>(7, OPACITY), [-3.0], "a logit");
    }
}
