//! Light for other programs: files that a reader that is not ours understands, and what they say.

use crate::tiny::{Tiny, specula, train};
use serde_json::Value;
use specula_core::{cubemap::texel_direction, pack::unpack2};
use specula_io::latlong::{self, LatLong};
use std::{fs, path::Path};

/// Red, green, blue of each texel of each level.
fn levels(path: &Path) -> Vec<Vec<[f32; 3]>> {
    let file = ktx2::Reader::new(fs::read(path).unwrap()).unwrap();
    let texel = |bytes: &[u8]| {
        let word = |at: usize| unpack2(u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
        [word(0)[0], word(0)[1], word(4)[0]]
    };
    file.levels().map(|level| level.data.chunks_exact(8).map(texel).collect()).collect()
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn write_sky(path: &Path, color: impl Fn(usize, usize) -> [f32; 3]) {
    let rgb = (0..16 * 8).flat_map(|k| color(k % 16, k / 16)).collect();
    latlong::write(path, &LatLong { width: 16, height: 8, rgb }).unwrap();
}

#[test]
fn a_constant_light_is_constant_in_every_level_of_every_scheme() {
    let tiny = Tiny::new();
    let (sky, out) = (tiny.path("sky.exr"), tiny.path("out/sky.ktx2"));
    write_sky(&sky, |_, _| [0.5, 1.0, 2.0]);
    let schemes = [("specula", "64", vec![0.0, 0.25, 0.5, 0.75, 1.0]), ("paper", "64", vec![0.08, 0.5, 1.0])];
    for (scheme, resolution, roughness) in schemes {
        let mut command = specula();
        command.arg("prefilter").arg(&sky).arg("-o").arg(&out).args(["--scheme", scheme, "--exposure", "1"]);
        command.args(["--resolution", resolution, "--previews"]).assert().success();
        let levels = levels(&out);
        assert_eq!(levels.len(), roughness.len(), "{scheme}");
        for (number, texels) in levels.iter().enumerate() {
            let size = resolution.parse::<usize>().unwrap() >> number;
            assert_eq!(texels.len(), 6 * size * size, "{scheme}: each level is half as wide");
            let is_constant = |texel: &[f32; 3]| texel.iter().zip([1.0, 2.0, 4.0]).all(|(a, b)| (a - b).abs() < 2e-3);
            assert!(texels.iter().all(is_constant), "{scheme}: level {number}");
            let preview = image::open(tiny.path(&format!("out/sky.level{number}.png"))).unwrap();
            assert_eq!(preview.width(), 2 * preview.height(), "{scheme}: lat-long");
        }
        let said = json(&tiny.path("out/sky.json"));
        assert_eq!(said["scheme"], scheme);
        let found: Vec<f64> =
            said["levels"].as_array().unwrap().iter().map(|level| level["roughness"].as_f64().unwrap()).collect();
        assert!(found.iter().zip(&roughness).all(|(a, b): (&f64, &f64)| (a - b).abs() < 1e-6), "{scheme}: {found:?}");
    }
}

/// The mean of the texels of the first level that lie within 45° of an axis.
fn towards(texels: &[[f32; 3]], axis: [f64; 3]) -> f32 {
    let size = 16;
    let direction = |k: usize| texel_direction(k / (size * size), k % size, k / size % size, size);
    let cosine = |k: usize| (0..3).map(|c| direction(k)[c] * axis[c]).sum::<f64>();
    let near: Vec<f32> = (0..texels.len()).filter(|k| cosine(*k) > 0.8).map(|k| texels[k][0]).collect();
    near.iter().sum::<f32>() / near.len() as f32
}

#[test]
fn the_upper_edge_is_above_and_the_middle_ahead() {
    let tiny = Tiny::new();
    let (sky, out) = (tiny.path("sky.exr"), tiny.path("sky.ktx2"));
    // Bright above, half as bright in the middle, black elsewhere.
    write_sky(&sky, |column, row| {
        let is_middle = (6..10).contains(&column) && (3..5).contains(&row);
        [if row < 2 {
            1.0
        } else if is_middle {
            0.5
        } else {
            0.0
        }; 3]
    });
    let cases = [("y", [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]), ("z", [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])];
    for (up, above, ahead) in cases {
        let mut command = specula();
        command.arg("prefilter").arg(&sky).arg("-o").arg(&out).args(["--resolution", "16", "--up", up]);
        command.assert().success();
        let sharpest = &levels(&out)[0];
        assert!(towards(sharpest, above) > 0.8, "{up}: the upper edge is above");
        assert!(towards(sharpest, above.map(|c| -c)) < 0.01, "{up}: nothing is below");
        let middle = towards(sharpest, ahead);
        assert!((0.1..0.6).contains(&middle) && towards(sharpest, ahead.map(|c| -c)) < 0.01, "{up}: {middle}");
        assert!(json(&tiny.path("sky.json"))["up"].as_str().unwrap().starts_with(&format!("+{up}")), "it is said");
    }
}

#[test]
fn the_light_of_a_model_is_written_as_it_is_or_turned() {
    let tiny = Tiny::new();
    train(&tiny, "model").arg("--quiet").assert().success();
    let model = tiny.path("model");
    let (own, resolution) = latlong::read_cube_exr(&model.join("light/iteration_30/environment.exr")).unwrap();
    for up in ["z", "y"] {
        let mut command = specula();
        command.arg("prefilter").arg(&model).arg("-o").arg(tiny.path("light.exr")).args(["--up", up]);
        command.assert().success();
        let (sharpest, found) = latlong::read_cube_exr(&tiny.path("light.level0.exr")).unwrap();
        assert_eq!(found, resolution, "the light keeps its resolution");
        match up {
            "z" => assert_eq!(sharpest, own, "a mirror shows the light"),
            _ => assert_eq!(sharpest, latlong::y_up_from_z_up(&own, resolution), "z becomes y"),
        }
    }
    assert!(tiny.path("light.level2.exr").is_file(), "16, 8 and 4 texels");
    assert_eq!(json(&tiny.path("light.json"))["files"].as_array().unwrap().len(), 3);
}

#[test]
fn what_cannot_be_filtered_is_refused_in_one_sentence() {
    let tiny = Tiny::new();
    let sky = tiny.path("sky.exr");
    write_sky(&sky, |_, _| [1.0; 3]);
    let cases: [(&str, &[&str], &str); 5] = [
        ("sky.dds", &[], ".ktx2 or .exr"),
        ("sky.ktx2", &["--resolution", "48"], "power of two"),
        ("sky.ktx2", &["--resolution", "16", "--levels", "7"], "--levels with 2 to 5"),
        ("sky.ktx2", &["--resolution", "32", "--scheme", "official"], "--resolution 64"),
        ("sky.ktx2", &["--scheme", "paper", "--levels", "4"], "omit --levels"),
    ];
    for (name, words, expected) in cases {
        let mut command = specula();
        command.arg("prefilter").arg(&sky).arg("-o").arg(tiny.path(name)).args(words);
        let output = command.assert().code(2).get_output().clone();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(stderr.lines().count() == 1 && stderr.contains(expected), "{words:?}: {stderr}");
        assert!(!tiny.path(name).exists(), "{words:?}: nothing is written");
    }
}
