//! Scenes for other programs: every file is opened by a reader that is not ours, and holds what the
//! scene holds.

use crate::tiny::{Tiny, psnr, specula};
use core::f32::consts::{PI, TAU};
use glam::{Mat3, Quat, Vec3};
use ply2splat::SplatPoint;
use serde::Deserialize;
use serde_json::Value;
use specula_core::{
    activation::{logit, sigmoid},
    camera::Camera,
    color::srgb_from_linear,
    pack::unpack2,
    scene::{
        ALBEDO, AMBIENT, DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, OPACITY, QUAT, ROUGHNESS,
        RadianceActivation, TINT, len_of_values,
    },
    sh::Y0,
};
use specula_io::{
    cameras, gaussian_ply,
    latlong::{self, LatLong},
    model_folder::{self, ModelInfo, Snapshot},
};
use specula_scene::OpenedModel;
use std::{
    collections::BTreeMap,
    fs,
    io::BufReader,
    path::{Path, PathBuf},
};

/// Gaussians of the ball.
const COUNT: usize = 2500;
/// Cameras around it; the first are test views.
const CAMERAS: usize = 24;
const TEST_VIEWS: usize = 6;
const LIGHT_RESOLUTION: usize = 16;
/// Tolerance for values that pass through σ(σ⁻¹(x)), exp and normalisation in `f32`.
const ROUNDED: f32 = 1e-5;
/// Half a step of 8 bits, and the roundings on the way.
const HALF_A_BYTE: f32 = 0.5 / 255.0 + 1e-5;
/// Halves have steps of 2⁻¹¹, the way through a half another rounding.
const HALVES: f32 = 1e-3;

/// A shiny ball, each Gaussian flat on it, in the folder of a model.
pub(crate) struct Ball {
    pub(crate) tiny: Tiny,
    pub(crate) gaussians: Gaussians<Vec<f32>>,
}

impl Ball {
    /// Under a light that is given for every direction.
    pub(crate) fn under(light: impl Fn([f64; 3]) -> [f32; 3]) -> Self {
        Self::of(light, |_| [0.3, 0.1, 0.05], 0.3)
    }

    fn of(light: impl Fn([f64; 3]) -> [f32; 3], diffuse: impl Fn(Vec3) -> [f32; 3], roughness: f32) -> Self {
        let layout = Layout::shaded(None).physical();
        let first = layout.physical_planes().unwrap();
        let mut gaussians = Gaussians { count: COUNT, layout, values: vec![0.0; len_of_values(COUNT, layout)] };
        for k in 0..COUNT {
            let normal = on_sphere(k, COUNT);
            gaussians.set(k, MEAN, normal.to_array());
            gaussians.set(k, LOG_SCALE, [0.07_f32.ln(), 0.065_f32.ln(), 0.004_f32.ln()]);
            let quat = Quat::from_rotation_arc(Vec3::Z, normal);
            gaussians.set(k, QUAT, [quat.w, quat.x, quat.y, quat.z]);
            gaussians.set(k, OPACITY, [3.0 + 0.001 * k as f32]);
            // Files have the diffuse colour as the authors' code reads it: σ(f_dc − ln 3).
            gaussians.set(k, DIFFUSE, diffuse(normal).map(|color| logit(color) + 3.0_f32.ln()));
            gaussians.set(k, TINT, [0.6_f32, 0.5, 0.4].map(logit));
            gaussians.set(k, ROUGHNESS, [logit(roughness)]);
            gaussians.set(k, first + ALBEDO, [0.7_f32, 0.5, 0.2].map(logit));
            gaussians.set(k, first + METALNESS, [logit(0.25)]);
            gaussians.set(k, first + AMBIENT, [1.0; 3]);
        }
        let ball = Self { tiny: Tiny::new(), gaussians };
        ball.save(&light);
        ball
    }

    /// Writes the model again.
    pub(crate) fn save(&self, light: &impl Fn([f64; 3]) -> [f32; 3]) {
        let texel = |k: usize| {
            let n = LIGHT_RESOLUTION;
            light(specula_core::cubemap::texel_direction(k / (n * n), k % n, k / n % n, n))
        };
        let values = (0..6 * LIGHT_RESOLUTION * LIGHT_RESOLUTION).flat_map(texel).collect();
        let activation = RadianceActivation::Identity;
        let light = Environment { resolution: LIGHT_RESOLUTION, activation, values };
        let rest = serde_json::json!({"test_views": TEST_VIEWS, "axis": "shortest", "prefilter": "exact"});
        let rest = rest.as_object().unwrap().clone();
        let info = ModelInfo { shading: "deferred".into(), rest, ..ModelInfo::default() };
        let snapshot = Snapshot {
            gaussians: &self.gaussians,
            comments: &[],
            light: Some(&light),
            other_lights: &[],
            near_field: None,
            info: &info,
        };
        model_folder::save(&self.model(), 7, &snapshot).unwrap();
        let camera = |k: usize| {
            let towards = on_sphere(k, CAMERAS);
            let up = towards.any_orthonormal_vector();
            (format!("{k}"), Camera::look_at(4.0 * towards, Vec3::ZERO, up, 0.7, 96, 96))
        };
        let all: Vec<_> = (0..CAMERAS).map(|k| camera(k * 7 % CAMERAS)).collect();
        cameras::write(&self.model().join("cameras.json"), &all, [0.0; 3]).unwrap();
    }

    pub(crate) fn model(&self) -> PathBuf {
        self.tiny.path("ball")
    }

    /// Exports to a file; returns its path and what was said.
    pub(crate) fn export(&self, name: &str, words: &[&str]) -> (PathBuf, String) {
        let path = self.tiny.path(name);
        let mut command = specula();
        command.arg("export").arg(self.model()).arg("-o").arg(&path).args(words).arg("--quiet");
        let output = command.assert().success().get_output().clone();
        (path, String::from_utf8(output.stdout).unwrap())
    }

    /// The Gaussian of the ball at a place.
    fn at(&self, place: [f32; 3], tolerance: f32) -> usize {
        let distance = |k: &usize| Vec3::from(self.gaussians.get::<3>(*k, MEAN)).distance(place.into());
        let nearest = (0..COUNT).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        assert!(distance(&nearest) <= tolerance, "nothing of the ball is at {place:?}");
        nearest
    }
}

/// Points spread over the unit sphere.
fn on_sphere(k: usize, count: usize) -> Vec3 {
    let z = 1.0 - (2 * k + 1) as f32 / count as f32;
    let (sin, cos) = (k as f32 * PI * (3.0 - 5.0_f32.sqrt())).sin_cos();
    Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
}

/// Brighter above, and coloured by the direction: nothing sharp.
pub(crate) fn soft([x, y, z]: [f64; 3]) -> [f32; 3] {
    [0.5 + 0.3 * z, 0.4 + 0.2 * x, 0.4 + 0.2 * y].map(|x| x as f32)
}

fn assert_near(found: &[f32], expected: &[f32], tolerance: f32, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let is_near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance);
    assert!(is_near, "{what}: {found:?} is not {expected:?} within {tolerance}");
}

/// Quats that turn alike: q and −q do.
fn assert_same_turn(found: [f32; 4], expected: [f32; 4], tolerance: f32, what: &str) {
    let unit = |q: [f32; 4]| glam::Vec4::from(q).normalize();
    let dot = unit(found).dot(unit(expected)).abs();
    assert!(dot >= 1.0 - tolerance, "{what}: {found:?} is not {expected:?}");
}

/// The decibels that were said.
fn decibels(said: &str) -> f64 {
    if said.contains("its pictures equal specula's own") {
        return f64::INFINITY;
    }
    said.split("PSNR ")
        .nth(1)
        .unwrap_or_else(|| panic!("no PSNR in {said}"))
        .split(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap()
}

#[derive(Deserialize)]
struct PlyRows {
    vertex: Vec<BTreeMap<String, f32>>,
}

fn ply_rows(path: &Path) -> Vec<BTreeMap<String, f32>> {
    let rows: PlyRows = serde_ply::from_reader(BufReader::new(fs::File::open(path).unwrap())).unwrap();
    rows.vertex
}

fn columns<const N: usize>(row: &BTreeMap<String, f32>, names: [&str; N]) -> [f32; N] {
    names.map(|name| row[name])
}

#[test]
fn a_ply_has_the_layout_of_inria_and_the_shapes_and_normals_of_the_scene() {
    let ball = Ball::under(soft);
    let (path, said) = ball.export("ball.ply", &["--no-error"]);
    assert!(
        said.contains("2 500 Gaussians") && said.contains("harmonics of degree 3") && !said.contains("dB"),
        "{said}"
    );

    let header = serde_ply::PlyReader::from_reader(BufReader::new(fs::File::open(&path).unwrap())).unwrap();
    let found: Vec<&str> = header.header().elem_defs[0].properties.iter().map(|p| p.name.as_str()).collect();
    let mut expected: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec();
    expected.extend((0..3).map(|k| format!("f_dc_{k}")));
    expected.extend((0..45).map(|k| format!("f_rest_{k}")));
    expected.push("opacity".into());
    expected.extend((0..3).map(|k| format!("scale_{k}")));
    expected.extend((0..4).map(|k| format!("rot_{k}")));
    assert_eq!(found, expected, "names and their order");

    let rows = ply_rows(&path);
    assert_eq!(rows.len(), COUNT);
    for row in &rows {
        let mean = columns(row, ["x", "y", "z"]);
        let k = ball.at(mean, 0.0);
        assert_eq!(columns(row, ["scale_0", "scale_1", "scale_2"]), ball.gaussians.get::<3>(k, LOG_SCALE));
        assert_eq!(columns(row, ["rot_0", "rot_1", "rot_2", "rot_3"]), ball.gaussians.get::<4>(k, QUAT));
        assert_eq!([row["opacity"]], ball.gaussians.get::<1>(k, OPACITY));
        // The ball's own normals point out, for only its outside is seen.
        assert_near(&columns(row, ["nx", "ny", "nz"]), &mean, ROUNDED, "normal");
    }
}

#[test]
fn harmonics_of_three_colours_lie_colour_by_colour() {
    // A light that is brighter above in red only: of the harmonics of degree 1, z's of red must
    // stand out.
    let ball = Ball::under(|[_, _, z]| [(0.5 + 0.4 * z) as f32, 0.2, 0.2]);
    let (path, _) = ball.export("ball.ply", &["--no-error"]);
    let energy = |name: &str| ply_rows(&path).iter().map(|row| row[name].powi(2)).sum::<f32>();
    let [red, green, blue] = ["f_rest_1", "f_rest_16", "f_rest_31"].map(energy);
    assert!(red > 100.0 * green && red > 100.0 * blue, "{red}, {green}, {blue}");
}

#[test]
fn constant_light_bakes_to_constants() {
    /// The prefilter's weights sum to one, and the fit solves for what is there, up to rounding and
    /// the 2⁻¹² of texels that are looked up between.
    const CONSTANT: f32 = 1e-3;
    let ball = Ball::under(|_| [0.5, 0.25, 1.0]);
    let (path, said) = ball.export("ball.ply", &[]);
    let lit = [0.3 + 0.6 * 0.5, 0.1 + 0.5 * 0.25, 0.05 + 0.4 * 1.0_f32].map(srgb_from_linear);
    for row in ply_rows(&path) {
        let shown = columns(&row, ["f_dc_0", "f_dc_1", "f_dc_2"]).map(|first| 0.5 + Y0 * first);
        assert_near(&shown, &lit, CONSTANT, "colour");
        let rest: Vec<f32> = (0..45).map(|k| row[&format!("f_rest_{k}")]).collect();
        assert_near(&rest, &[0.0; 45], CONSTANT, "whatever depends on the direction");
    }
    // Colours are within a thousandth; what remains is rounding to 8 bits, which moves by a step
    // here and there.
    assert!(decibels(&said) > 50.0, "{said}");
}

/// Mean PSNR of pictures in two folders.
fn compared(one: &Path, other: &Path) -> f64 {
    let psnr = |k: usize| {
        let [one, other] = [one, other]
            .map(|folder| image::open(folder.join(format!("rgb/{k:05}.png"))).unwrap().to_rgb8().into_raw());
        let square = |(a, b): (&u8, &u8)| (f64::from(a.abs_diff(*b)) / 255.0).powi(2);
        let mean = one.iter().zip(&other).map(square).sum::<f64>() / one.len() as f64;
        -10.0 * mean.log10()
    };
    (0..TEST_VIEWS).map(psnr).sum::<f64>() / TEST_VIEWS as f64
}

#[test]
fn a_baked_scene_looks_as_the_scene_does_and_its_error_is_said() {
    /// The soft light is of degree 1 before the curve of sRGB; what degree 3 leaves of that curve
    /// is a hundredth.
    const ENOUGH: f64 = 38.0;
    /// Pictures are the same; the last digit that is printed is not.
    const PRINTED: f64 = 0.006;
    let ball = Ball::under(soft);
    let (path, said) = ball.export("ball.ply", &[]);
    let render = |scene: &Path, out: &str| {
        let mut command = specula();
        command.arg("render").arg(scene).arg("-o").arg(ball.tiny.path(out)).args(["--layers", "rgb", "--quiet"]);
        command.arg("--cameras").arg(test_cameras(&ball)).assert().success();
        ball.tiny.path(out)
    };
    let measured = compared(&render(&ball.model(), "own"), &render(&path, "baked"));
    assert!(measured > ENOUGH, "{measured} dB");
    assert!((decibels(&said) - measured).abs() < PRINTED, "{measured} dB, but {said}");

    let (path, said) = ball.export("diffuse.ply", &["--bake", "diffuse"]);
    let diffuse = compared(&ball.tiny.path("own"), &render(&path, "diffuse"));
    assert!((decibels(&said) - diffuse).abs() < PRINTED, "{diffuse} dB, but {said}");
    assert!(diffuse < measured - 10.0, "without its light the ball is dark: {diffuse} dB");
    assert!(said.contains("the light and its reflections are omitted"), "{said}");
}

/// A light that is orange on one side and blue on the other.
fn two_colours(ball: &Ball) -> PathBuf {
    let rgb = (0..16 * 8).flat_map(|k| if k % 16 < 8 { [0.9, 0.5, 0.2] } else { [0.1, 0.2, 0.6] }).collect();
    let path = ball.tiny.path("two.hdr");
    latlong::write(&path, &LatLong { width: 16, height: 8, rgb }).unwrap();
    path
}

/// A physical material is baked in the light that is asked for: its pixels are those of `render`.
#[test]
fn a_physical_ball_is_baked_under_another_light() {
    /// Gaussians are baked with the colours of whole pixels.
    const ENOUGH: f64 = 30.0;
    let ball = Ball::under(soft);
    let sky = two_colours(&ball);
    let (path, said) = ball.export("relit.ply", &["--env", sky.to_str().unwrap()]);
    assert!(decibels(&said) > ENOUGH, "{said}");
    let rows = ply_rows(&path);
    let (other, _) = ball.export("other.ply", &["--no-error"]);
    let red = |rows: &[BTreeMap<String, f32>]| rows.iter().map(|row| row["f_dc_0"]).sum::<f32>();
    assert!(red(&rows) != red(&ply_rows(&other)), "the light is another");
}

/// Materials of the ball are those of the scene, and their file is lit like the model.
#[test]
fn materials_are_written_for_programs_that_relight() {
    /// Normals of the scene are turned to each camera, those of the file to all of them.
    const ENOUGH: f64 = 45.0;
    let ball = Ball::under(soft);
    let sky = two_colours(&ball);
    let (path, said) = ball.export("ball.ply", &["--bake", "materials", "--env", sky.to_str().unwrap()]);
    assert!(decibels(&said) > ENOUGH, "{said}");
    for row in ply_rows(&path) {
        let place: [f32; 3] = columns(&row, ["x", "y", "z"]);
        let index = ball.at(place, ROUNDED);
        assert_near(&columns(&row, ["nx", "ny", "nz"]), &place, ROUNDED, "the normal of a ball");
        let color = columns(&row, ["f_dc_0", "f_dc_1", "f_dc_2"]).map(|number: f32| 0.5 + Y0 * number);
        assert_near(&color, &[0.7_f32, 0.5, 0.2].map(srgb_from_linear), ROUNDED, "the albedo");
        for names in [["metallicFactor", "roughnessFactor"], ["pm", "pr"]] {
            assert_near(&columns(&row, names), &[0.25, 0.3], ROUNDED, "metalness and roughness");
        }
        assert_near(&columns(&row, ["opacity"]), &ball.gaussians.get::<1>(index, OPACITY), ROUNDED, "a logit");
        assert!(!row.contains_key("f_rest_0"), "colours do not depend on the view");
    }
    specula().arg("info").arg(&path).args(["--strict", "--quiet"]).assert().success();
    let (_, said) = ball.export("ball.spz", &["--bake", "materials"]);
    assert!(said.contains("relight its .ply instead") && !said.contains("PSNR"), "{said}");
    let (harmonics, _) = ball.export("harmonics.ply", &["--no-error"]);
    let mut command = specula();
    command.arg("export").arg(&harmonics).arg("-o").arg(ball.tiny.path("none.ply")).args(["--bake", "materials"]);
    command.assert().code(2);
    let strict =
        specula().arg("info").arg(&harmonics).args(["--strict", "--quiet"]).assert().code(1).get_output().clone();
    let said = String::from_utf8(strict.stdout).unwrap();
    assert!(said.contains("has comments: loaders that expect the vertex count"), "{said}");
}

/// Files of `docs/shading-extension` follow its schema, in the part of JSON Schema that it uses.
fn follows(value: &Value, schema: &Value, place: &str) {
    if let Some(known) = schema["enum"].as_array() {
        assert!(known.contains(value), "{place}: {value}");
    }
    if let Some(constant) = schema.get("const") {
        assert_eq!(value, constant, "{place}");
    }
    if let Some(minimum) = schema["minimum"].as_u64() {
        assert!(value.as_u64().is_some_and(|number| number >= minimum), "{place}: {value}");
    }
    for name in schema["required"].as_array().into_iter().flatten() {
        assert!(value.get(name.as_str().unwrap()).is_some(), "{place} lacks {name}");
    }
    for (name, value) in value.as_object().filter(|_| schema["type"] == "object").into_iter().flatten() {
        let schema = schema["properties"].get(name).unwrap_or_else(|| panic!("{place} has {name}"));
        follows(value, schema, &format!("{place}/{name}"));
    }
}

#[test]
fn samples_of_the_shading_extension_follow_its_schema_and_open() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/shading-extension");
    let json = |path: &Path| -> Value { serde_json::from_slice(&fs::read(path).unwrap()).unwrap() };
    let schema = json(&folder.join("SPECULA_shading.schema.json"));
    let extension = |path: &Path| -> Value {
        let bytes = fs::read(path).unwrap();
        let json = gltf::Glb::from_slice(&bytes).map_or(bytes.clone(), |glb| glb.json.into_owned());
        let document: Value = serde_json::from_slice(&json).unwrap();
        let primitive = &document["meshes"][0]["primitives"][0];
        primitive["extensions"]["KHR_gaussian_splatting"]["extensions"]["SPECULA_shading"].clone()
    };
    let sample = |name: &str| folder.join(name);
    for name in ["view.gltf", "physical.gltf"] {
        let shading = extension(&sample(name));
        assert!(shading.is_object(), "{name}");
        follows(&shading, &schema, name);
        specula().arg("info").arg(sample(name)).args(["--strict", "--quiet"]).assert().success();
        let scene = OpenedModel::open(&sample(name)).unwrap().scene;
        let light = scene.light.unwrap();
        assert_eq!((scene.gaussians.count, light.resolution), (2, 16));
        assert_eq!((&light.values[..3], &light.values[light.values.len() - 3..]), (&[0.25; 3][..], &[0.25; 3][..]));
        let upper = 4 * 16 * 16 * 3;
        assert_eq!(light.values[upper..upper + 3], [1.0, 0.5, 0.25]);
        // In the order of space, the first is the one at the origin.
        let is_first = scene.gaussians.get::<1>(0, MEAN) == [0.0];
        assert_near(&scene.gaussians.get::<1>(usize::from(!is_first), ROUGHNESS).map(sigmoid), &[0.25], ROUNDED, name);
        assert_eq!(scene.gaussians.layout.is_physical, name == "physical.gltf");
    }
    // What export writes follows the schema, too.
    let ball = Ball::under(soft);
    let (path, _) = ball.export("ball.glb", &["--no-error"]);
    follows(&extension(&path), &schema, "ball.glb");
}

#[test]
fn a_stage_has_the_scene_its_materials_and_its_light() {
    let ball = Ball::under(soft);
    let (path, said) = ball.export("ball.usda", &["--bake", "materials"]);
    assert!(said.contains("the light a DomeLight"), "{said}");
    let text = fs::read_to_string(&path).unwrap();
    for line in [
        "defaultPrim = \"Scene\"",
        "metersPerUnit = 1",
        "upAxis = \"Y\"",
        "quatd xformOp:orient = (",
        "xformOp:scale = (1, 1, 1)",
        "uniform int radiance:sphericalHarmonicsDegree = 0",
        "asset inputs:texture:file = @./ball.light.exr@ (",
    ] {
        assert!(text.contains(line), "{line}");
    }
    let (light, _) = latlong::read(&ball.tiny.path("ball.light.exr")).unwrap();
    let centre = light.rgb[3 * (light.width * light.height / 2 + light.width / 2)..][..3].to_vec();
    assert_near(&centre, &soft([0.0, 0.0, 1.0]), 0.1, "+z is in the centre");
    let (upright, _) = ball.export("ball.usdz", &["--upright", "--no-error"]);
    let bytes = fs::read(upright).unwrap();
    assert!(bytes.starts_with(b"PK") && bytes.windows(12).any(|word| word == b"upAxis = \"Y\""), "y up");
}

/// The model's test views as a file of cameras.
fn test_cameras(ball: &Ball) -> PathBuf {
    let path = ball.tiny.path("test_cameras.json");
    let all = cameras::read(&ball.model().join("cameras.json")).unwrap();
    cameras::write(&path, &all[..TEST_VIEWS], [0.0; 3]).unwrap();
    path
}

#[test]
fn fewer_degrees_and_fewer_gaussians_are_written_where_that_is_asked() {
    let ball = Ball::under(soft);
    let (path, said) = ball.export("ball.ply", &["--sh-degree", "1", "--min-opacity", "0.97", "--no-error"]);
    let opaque = (0..COUNT).filter(|k| sigmoid(3.0 + 0.001 * *k as f32) >= 0.97).count();
    assert!(0 < opaque && opaque < COUNT, "some are left out");
    let rows = ply_rows(&path);
    assert_eq!(rows.len(), opaque);
    assert!(rows[0].contains_key("f_rest_8") && !rows[0].contains_key("f_rest_9"), "nine numbers of degree 1");
    assert!(said.contains(&format!("{} invisible Gaussians are omitted", COUNT - opaque)), "{said}");
}

#[test]
fn a_splat_has_records_of_32_bytes_largest_first() {
    let ball = Ball::under(|_| [0.5, 0.25, 1.0]);
    let (path, said) = ball.export("ball.splat", &[]);
    let bytes = fs::read(path).unwrap();
    assert_eq!(bytes.len(), 32 * COUNT);
    let lit = [0.3 + 0.6 * 0.5, 0.1 + 0.5 * 0.25, 0.05 + 0.4 * 1.0_f32].map(srgb_from_linear);
    let mut before = f32::INFINITY;
    for record in bytes.chunks_exact(32) {
        let number = |k: usize| f32::from_le_bytes(record[4 * k..4 * k + 4].try_into().unwrap());
        let k = ball.at([0, 1, 2].map(number), 0.0);
        let scales = ball.gaussians.get::<3>(k, LOG_SCALE).map(f32::exp);
        assert_near(&[3, 4, 5].map(number), &scales, ROUNDED, "scales");
        let color: Vec<f32> = record[24..27].iter().map(|byte| f32::from(*byte) / 255.0).collect();
        assert_near(&color, &lit, HALF_A_BYTE + 1e-3, "colour");
        let opacity = sigmoid(ball.gaussians.get::<1>(k, OPACITY)[0]);
        assert_near(&[f32::from(record[27]) / 255.0], &[opacity], HALF_A_BYTE, "opacity");
        let quat = core::array::from_fn(|k| f32::from(record[28 + k]) / 128.0 - 1.0);
        // Four components, each off by at most 1/256.
        assert_same_turn(quat, ball.gaussians.get(k, QUAT), 1e-4, "quat");
        let visibility = opacity * scales.iter().product::<f32>();
        assert!(visibility <= before * (1.0 + ROUNDED), "the most visible come first");
        before = visibility;
    }
    assert!(said.contains("80 000 bytes") && said.contains("do not depend on the view"), "{said}");
}

#[test]
fn a_splat_is_what_the_crate_ply2splat_makes_of_a_ply_without_harmonics() {
    let ball = Ball::under(soft);
    let (ply, _) = ball.export("ball.ply", &["--sh-degree", "0", "--no-error"]);
    let (splat, _) = ball.export("ball.splat", &["--no-error"]);
    let ours: Vec<SplatPoint> = bytemuck::pod_collect_to_vec(&fs::read(splat).unwrap());
    let place = |point: &SplatPoint| point.pos.map(f32::to_bits);
    let theirs = ply2splat::ply_to_splat(ply2splat::load_ply(ply).unwrap(), true);
    let theirs: BTreeMap<[u32; 3], SplatPoint> = theirs.iter().map(|point| (place(point), *point)).collect();
    assert_eq!((ours.len(), theirs.len()), (COUNT, COUNT));
    for point in &ours {
        let other = theirs[&place(point)];
        assert_near(&point.scale, &other.scale, ROUNDED, "scales");
        // They cut bytes off, where we round.
        let same = |one: [u8; 4], two: [u8; 4]| one.iter().zip(two).all(|(one, two)| one.abs_diff(two) <= 1);
        assert!(same(point.color, other.color), "{:?} and {:?}", point.color, other.color);
        assert!(same(point.rot, other.rot), "{:?} and {:?}", point.rot, other.rot);
    }
}

#[test]
fn an_spz_is_read_by_the_crate_spz() {
    let ball = Ball::under(soft);
    let (baked, _) = ball.export("ball.ply", &["--no-error"]);
    let rows = ply_rows(&baked);
    let (path, said) = ball.export("ball.spz", &[]);
    let read = spz::GaussianSplat::load_packed_from_file(&path, &spz::UnpackOptions::default()).unwrap();
    assert_eq!((read.num_points as usize, read.spherical_harmonics_degree), (COUNT, 3));
    for (k, row) in rows.iter().enumerate() {
        // A 65536th of the scene.
        assert_near(&read.positions[3 * k..3 * k + 3], &columns(row, ["x", "y", "z"]), 1.0 / 65_536.0, "mean");
        let scales = columns(row, ["scale_0", "scale_1", "scale_2"]);
        assert_near(&read.scales[3 * k..3 * k + 3], &scales, 0.5 / 16.0 + ROUNDED, "scales");
        let first = columns(row, ["f_dc_0", "f_dc_1", "f_dc_2"]);
        assert_near(&read.colors[3 * k..3 * k + 3], &first, HALF_A_BYTE / 0.15, "colour");
        assert_near(&[sigmoid(read.alphas[k])], &[sigmoid(row["opacity"])], HALF_A_BYTE, "opacity");
        let rotation = core::array::from_fn(|c| read.rotations[4 * k + c]);
        let quat = columns(row, ["rot_1", "rot_2", "rot_3", "rot_0"]);
        // Three components, each off by at most √½/1022.
        assert_same_turn(rotation, quat, 2e-6, "rotation");
        for (c, j) in (0..3).flat_map(|c| (0..15).map(move |j| (c, j))) {
            let [found, expected] =
                [read.spherical_harmonics[45 * k + 3 * j + c], row[&format!("f_rest_{}", 15 * c + j)]];
            assert_near(&[found], &[expected], 0.5 / 128.0 + ROUNDED, "harmonics");
        }
    }
    assert!(decibels(&said) > 35.0, "8 bits of each number are enough: {said}");
}

#[test]
fn files_of_other_programs_are_turned_to_the_axes_that_viewers_assume() {
    let ball = Ball::under(soft);
    let (upright, _) = ball.export("ball.ply", &["--upright", "--no-error"]);
    let convert = |from: &Path, to: &str| {
        let path = ball.tiny.path(to);
        let mut command = specula();
        command.arg("export").arg(from).arg("-o").arg(&path).args(["--no-error", "--quiet"]);
        (path, String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap())
    };
    // Coordinates along an axis in ascending order: files have orders of their own.
    let sorted = |mut values: Vec<f32>| {
        values.sort_by(f32::total_cmp);
        values
    };
    let along = |rows: &[BTreeMap<String, f32>], axis: &str, sign: f32| {
        sorted(rows.iter().map(|row| sign * row[axis]).collect())
    };
    let rows = ply_rows(&upright);
    let (spz, said) = convert(&upright, "turned.spz");
    assert!(said.contains("turned to +y up"), "{said}");
    let read = spz::GaussianSplat::load_packed_from_file(&spz, &spz::UnpackOptions::default()).unwrap();
    for (axis, (name, sign)) in [("x", 1.0), ("y", -1.0), ("z", -1.0)].into_iter().enumerate() {
        let found = sorted(read.positions.iter().skip(axis).step_by(3).copied().collect());
        assert_near(&found, &along(&rows, name, sign), 1.0 / 4096.0, name);
    }
    let (back, said) = convert(&spz, "back.ply");
    assert!(said.contains("turned to -y up"), "{said}");
    for name in ["x", "y", "z"] {
        assert_near(&along(&ply_rows(&back), name, 1.0), &along(&rows, name, 1.0), 1.0 / 4096.0, name);
    }
    assert!(!convert(&upright, "same.splat").1.contains("turned"), "both have y down");
}

#[test]
fn a_glb_has_gaussians_as_khronos_wants_them_and_the_shading_beside_them() {
    let ball = Ball::under(soft);
    let (baked, _) = ball.export("ball.ply", &["--no-error"]);
    let rows = ply_rows(&baked);
    let (path, said) = ball.export("ball.glb", &[]);
    assert!(said.contains("also stored as SPECULA_shading"), "{said}");
    let file = gltf::Gltf::from_slice_without_validation(&fs::read(&path).unwrap()).unwrap();
    let json: Value = serde_json::from_slice(&gltf::Glb::from_slice(&fs::read(&path).unwrap()).unwrap().json).unwrap();
    let primitive = &json["meshes"][0]["primitives"][0];
    let extension = &primitive["extensions"]["KHR_gaussian_splatting"];
    assert_eq!((&extension["kernel"], &primitive["mode"]), (&"ellipse".into(), &0.into()));
    assert_eq!(extension["colorSpace"], "srgb_rec709_display");
    assert_eq!(json["extensionsUsed"], serde_json::json!(["KHR_gaussian_splatting", "SPECULA_shading"]));

    let blob = file.blob.as_deref().unwrap();
    let accessor = |name: &str| {
        let index = primitive["attributes"][name].as_u64().unwrap_or_else(|| panic!("no {name}"));
        file.accessors().nth(index as usize).unwrap()
    };
    let three =
        |name: &str| -> Vec<[f32; 3]> { gltf::accessor::Iter::new(accessor(name), |_| Some(blob)).unwrap().collect() };
    let four =
        |name: &str| -> Vec<[f32; 4]> { gltf::accessor::Iter::new(accessor(name), |_| Some(blob)).unwrap().collect() };
    let one = |name: &str| -> Vec<f32> { gltf::accessor::Iter::new(accessor(name), |_| Some(blob)).unwrap().collect() };
    let [means, scales, normals] = ["POSITION", "KHR_gaussian_splatting:SCALE", "SPECULA_shading:NORMAL"].map(three);
    let (rotations, opacities) = (four("KHR_gaussian_splatting:ROTATION"), one("KHR_gaussian_splatting:OPACITY"));
    let [diffuse, tint, albedo] =
        ["SPECULA_shading:DIFFUSE", "SPECULA_shading:TINT", "SPECULA_shading:ALBEDO"].map(three);
    let [roughness, metallic] = ["SPECULA_shading:ROUGHNESS", "SPECULA_shading:METALLIC"].map(one);
    assert_eq!(means.len(), COUNT);
    for (k, row) in rows.iter().enumerate() {
        assert_eq!(means[k], columns(row, ["x", "y", "z"]));
        let expected = columns(row, ["scale_0", "scale_1", "scale_2"]).map(f32::exp);
        assert_near(&scales[k], &expected, ROUNDED, "scales are linear");
        assert_same_turn(rotations[k], columns(row, ["rot_1", "rot_2", "rot_3", "rot_0"]), ROUNDED, "xyzw");
        assert_near(&[opacities[k]], &[sigmoid(row["opacity"])], ROUNDED, "opacities are linear");
        assert_eq!(normals[k], columns(row, ["nx", "ny", "nz"]));
        assert_near(&diffuse[k], &[0.3, 0.1, 0.05], ROUNDED, "diffuse");
        assert_near(&tint[k], &[0.6, 0.5, 0.4], ROUNDED, "tint");
        assert_near(&[roughness[k]], &[0.3], ROUNDED, "roughness");
        assert_near(&albedo[k], &[0.7, 0.5, 0.2], ROUNDED, "albedo");
        assert_near(&[metallic[k]], &[0.25], ROUNDED, "metalness");
    }
    for j in 0..16_usize {
        let degree = j.isqrt();
        let found = three(&format!("KHR_gaussian_splatting:SH_DEGREE_{degree}_COEF_{}", j - degree * degree));
        for (found, row) in found.iter().zip(&rows) {
            let rest = |c: usize| row[&format!("f_rest_{}", 15 * c + j.wrapping_sub(1))];
            let expected = if j == 0 { columns(row, ["f_dc_0", "f_dc_1", "f_dc_2"]) } else { [0, 1, 2].map(rest) };
            assert_eq!(*found, expected, "harmonic {j}");
        }
    }
    let light = &extension["extensions"]["SPECULA_shading"]["light"];
    let view = file.views().nth(light["bufferView"].as_u64().unwrap() as usize).unwrap();
    let picture = image::load_from_memory_with_format(
        &blob[view.offset()..view.offset() + view.length()],
        image::ImageFormat::OpenExr,
    );
    let picture = picture.unwrap().to_rgb32f();
    assert_eq!(picture.dimensions(), (LIGHT_RESOLUTION as u32, 6 * LIGHT_RESOLUTION as u32));
    // The face +Z lies fifth; its middle looks up, as far as half a texel.
    let above = picture.get_pixel(8, 4 * 16 + 8).0;
    assert_near(&above, &soft([0.0, 0.0, 1.0]), 0.05, "what comes from above");
}

#[test]
fn the_light_of_a_model_is_read_by_other_programs() {
    let ball = Ball::under(soft);
    // 2 % for RGBE, and what a pixel of 32 × 64 is wide.
    for (name, tolerance) in [("light.exr", 0.02), ("light.hdr", 0.03)] {
        let (path, said) = ball.export(name, &[]);
        let picture = image::open(path).unwrap().to_rgb32f();
        let (width, height) = picture.dimensions();
        assert_eq!((width, height), (64, 32), "{said}");
        for (x, y) in [(0, 0), (32, 16), (10, 20), (63, 31)] {
            let turn = ((x as f32 + 0.5) / width as f32 - 0.5) * TAU;
            let polar = (y as f32 + 0.5) / height as f32 * PI;
            // z is above, the middle is +x, and y decreases to the right.
            let direction = [polar.sin() * turn.cos(), -polar.sin() * turn.sin(), polar.cos()].map(f64::from);
            assert_near(&picture.get_pixel(x, y).0, &soft(direction), tolerance, name);
        }
    }
    let (path, _) = ball.export("light.ktx2", &[]);
    let file = ktx2::Reader::new(fs::read(path).unwrap()).unwrap();
    let sharpest = file.levels().next().unwrap().data.to_vec();
    let (n, face) = (LIGHT_RESOLUTION, 4);
    let at = 8 * (face * n * n + n / 2 * n + n / 2);
    let word = |at: usize| unpack2(u32::from_le_bytes(sharpest[at..at + 4].try_into().unwrap()));
    let above = specula_core::cubemap::texel_direction(face, n / 2, n / 2, n);
    assert_near(&[word(at)[0], word(at)[1], word(at + 4)[0]], &soft(above), HALVES, "what comes from above");
}

#[test]
fn a_mesh_of_a_ball_is_a_ball() {
    const VOXELS: usize = 48;
    /// The volume is 2.2 wide. A surface may be a voxel and a half off: half of one by its grid,
    /// the rest where flat Gaussians stand off the ball.
    const OFF: f32 = 1.5 * 2.3 / VOXELS as f32;
    let ball = Ball::of(|_| [0.0; 3], |normal| if normal.z > 0.0 { [0.8, 0.1, 0.1] } else { [0.1, 0.1, 0.8] }, 0.5);
    let voxels = VOXELS.to_string();
    let (path, said) = ball.export("ball.obj", &["--voxels", &voxels]);
    let (models, _) = tobj::load_obj(&path, &tobj::LoadOptions::default()).unwrap();
    let mesh = &models[0].mesh;
    let places: Vec<Vec3> = mesh.positions.chunks_exact(3).map(Vec3::from_slice).collect();
    let mut area = 0.0;
    for corners in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|k| places[corners[k] as usize]);
        let across = (b - a).cross(c - a);
        area += 0.5 * across.length();
        let outwards = across.normalize_or_zero().dot((a + b + c).normalize());
        assert!(outwards > -0.2, "a triangle at {a} faces inwards: {outwards}");
    }
    assert!(((area / (4.0 * PI)).sqrt() - 1.0).abs() < OFF, "the area of a unit ball is 4π, that of the mesh {area}");
    for (k, place) in places.iter().enumerate() {
        assert!((place.length() - 1.0).abs() < OFF, "{place} is not on the ball");
        let normal = Vec3::from_slice(&mesh.normals[3 * k..]);
        assert!(normal.dot(place.normalize()) > 0.8, "the normal {normal} at {place}");
        let [r, _, b] = core::array::from_fn(|c| mesh.vertex_color[3 * k + c]);
        if place.z.abs() > 0.2 {
            assert_eq!(r > b, place.z > 0.0, "red above, blue below");
        }
    }
    assert!(said.contains("triangles"), "{said}");

    #[derive(Deserialize)]
    struct Face {
        vertex_indices: Vec<u32>,
    }
    #[derive(Deserialize)]
    struct MeshRows {
        vertex: Vec<BTreeMap<String, f32>>,
        face: Vec<Face>,
    }
    let (path, _) = ball.export("mesh.ply", &["--mesh", "--voxels", &voxels]);
    let rows: MeshRows = serde_ply::from_reader(BufReader::new(fs::File::open(path).unwrap())).unwrap();
    assert_eq!((rows.vertex.len(), rows.face.len()), (places.len(), mesh.indices.len() / 3), "the same mesh");
    let indices = rows.face.iter().flat_map(|face| &face.vertex_indices);
    for (one, other) in indices.zip(&mesh.indices) {
        let place = columns(&rows.vertex[*one as usize], ["x", "y", "z"]);
        assert_near(&place, &places[*other as usize].to_array(), ROUNDED, "the corner of a triangle");
    }
}

#[test]
fn a_plain_scene_is_written_as_it_is() {
    let ball = Ball::under(soft);
    let (baked, _) = ball.export("ball.ply", &["--no-error"]);
    let again = ball.tiny.path("again.ply");
    let mut command = specula();
    let output = command.arg("export").arg(&baked).arg("-o").arg(&again).arg("--quiet").assert().success();
    let said = String::from_utf8(output.get_output().stdout.clone()).unwrap();
    assert!(said.contains("lossless") && said.contains("equal specula's own"), "{said}");
    assert_eq!(gaussian_ply::read(&again).unwrap().gaussians, gaussian_ply::read(&baked).unwrap().gaussians);
}

/// The command fails with one sentence that has these words, and writes nothing.
pub(crate) fn refuses(tiny: &Tiny, model: &Path, name: &str, extra: &[&str], words: &[&str]) {
    let mut command = specula();
    command.arg("export").arg(model).arg("-o").arg(tiny.path(name)).args(extra);
    let output = command.assert().code(2).get_output().clone();
    let stderr = String::from_utf8(output.stderr).unwrap();
    let last = stderr.lines().last().unwrap();
    for word in words {
        assert!(last.contains(word), "{word:?} is not in: {stderr}");
    }
    assert!(output.stdout.is_empty() && !tiny.path(name).exists(), "nothing is written of what failed");
}

#[test]
fn what_cannot_be_exported_is_refused_in_one_sentence() {
    let ball = Ball::under(soft);
    let (tiny, model) = (&ball.tiny, ball.model());
    refuses(tiny, &model, "ball.stl", &[], &["ball.stl", ".splat", ".obj"]);
    refuses(tiny, &tiny.path("nowhere"), "ball.ply", &[], &["nowhere"]);
    refuses(tiny, &model, "ball.ply", &["--min-opacity", "1", "--quiet"], &["ball", "lower --min-opacity"]);
    refuses(tiny, &model, "ball.ply", &["--sh-degree", "4"], &["--sh-degree"]);
    let (plain, _) = ball.export("plain.ply", &["--no-error"]);
    refuses(tiny, &plain, "light.hdr", &[], &["plain.ply", "light.hdr", "--env"]);
    // Files are independent of each other.
    let files = ["a.ply", "light.hdr", "c.splat"].map(|name| tiny.path(name));
    let mut command = specula();
    let output = command.arg("export").arg(&plain).arg("-o").args(&files).args(["--no-error", "--quiet"]).assert();
    let said = String::from_utf8(output.code(2).get_output().stderr.clone()).unwrap();
    assert!(said.lines().count() == 1 && said.contains("light.hdr"), "{said}");
    assert_eq!(files.map(|file| file.is_file()), [true, false, true]);
    let none = tiny.path("none.ply");
    let layout = Layout::radiance(0);
    gaussian_ply::write(&none, &Gaussians { count: 0, layout, values: Vec::new() }, &[]).unwrap();
    refuses(tiny, &none, "ball.ply", &["--quiet"], &["none.ply", "no Gaussian"]);
    refuses(tiny, &none, "ball.obj", &["--quiet"], &["none.ply", "no visible Gaussian"]);
}

#[test]
fn an_antialiased_scene_is_exported_with_its_filter_in_scales_and_opacities() {
    let tiny = Tiny::new();
    let (scene, layout) = (tiny.path("scene.ply"), Layout::radiance(0).antialiased());
    let plane = layout.filter_plane().unwrap();
    let mut gaussians = Gaussians { count: 20, layout, values: vec![0.0; len_of_values(20, layout)] };
    for k in 0..20 {
        gaussians.set(k, MEAN, on_sphere(k, 20).to_array());
        gaussians.set(k, LOG_SCALE, [-2.0, -2.5, -6.0]);
        gaussians.set(k, QUAT, [1.0, 0.0, 0.0, 0.0]);
        gaussians.set(k, OPACITY, [3.0]);
        gaussians.set(k, plane, [0.02]);
    }
    gaussian_ply::write(&scene, &gaussians, &[]).unwrap();

    let plain = tiny.path("plain.ply");
    let said = specula().arg("export").arg(&scene).arg("-o").arg(&plain).args(["--no-error", "--quiet"]).assert();
    let said = String::from_utf8(said.success().get_output().stdout.clone()).unwrap();
    assert!(said.contains("0.1 px²") && said.contains("compensates opacity"), "{said}");
    let rows = ply_rows(&plain);
    assert_eq!(rows.len(), 20);
    let scales = [-2.0_f32, -2.5, -6.0].map(f32::exp);
    let wider = scales.map(|scale| scale.hypot(0.02));
    let opacity = sigmoid(3.0) * scales.iter().zip(wider).map(|(scale, wider)| scale / wider).product::<f32>();
    for row in &rows {
        assert!(!row.contains_key("filter_3D"), "plain viewers know no filter");
        assert_near(&columns(row, ["scale_0", "scale_1", "scale_2"]), &wider.map(f32::ln), ROUNDED, "scales");
        assert_near(&[sigmoid(row["opacity"])], &[opacity], ROUNDED, "opacity");
    }

    // The file says that it is anti-aliased; another one is told by the option.
    refuses(&tiny, &scene, "other.ply", &["--antialiased"], &["scene.ply", "omit --antialiased"]);
    for option in ["--antialiased", "--antialiased=mip"] {
        let mut command = specula();
        command.arg("export").arg(&plain).arg("-o").arg(tiny.path("again.splat")).args([option, "--no-error"]);
        let said = command.arg("--quiet").assert().success().get_output().stdout.clone();
        assert!(String::from_utf8(said).unwrap().contains("compensates opacity"), "{option}");
    }
}

/// Up direction of the scenes that are rotated upright; its length is arbitrary.
const ABOVE: Vec3 = Vec3::new(0.9, -0.72, 0.96);
/// Harmonics and places that went through a rotation of `f64` and were rounded to `f32`.
const TURNED: f32 = 2e-6;

/// A ball under a soft light whose cameras are twice as far away as upright ones, and what turns it
/// upright, with y above.
fn lying_ball() -> (Ball, Mat3) {
    let ball = Ball::under(soft);
    let path = ball.model().join("cameras.json");
    let mut all = cameras::read(&path).unwrap();
    all.iter_mut().for_each(|(_, camera)| camera.position *= 2.0);
    cameras::write(&path, &all, [0.0; 3]).unwrap();
    let above = ABOVE.normalize();
    let front = all[0].1.position.reject_from_normalized(above).normalize();
    (ball, Mat3::from_cols(above.cross(front), above, front).transpose())
}

fn upright_words() -> String {
    format!("{},{},{}", ABOVE.x, ABOVE.y, ABOVE.z)
}

#[test]
fn an_upright_ply_has_y_down_and_towards_turned_directions_the_colours_that_it_had() {
    let (ball, y_up) = lying_ball();
    let turn = Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)) * y_up;
    let up = upright_words();
    let (lying, said) = ball.export("lying.ply", &[]);
    let (upright, said_upright) = ball.export("upright.ply", &["--upright", "--scene-up", &up]);
    let harmonics = |row: &BTreeMap<String, f32>| -> Vec<[f32; 3]> {
        let rest = |j: usize| [0, 1, 2].map(|c| row[&format!("f_rest_{}", 15 * c + j)]);
        [columns(row, ["f_dc_0", "f_dc_1", "f_dc_2"])].into_iter().chain((0..15).map(rest)).collect()
    };
    let color = |row: &BTreeMap<String, f32>, direction: Vec3| {
        let values = specula_core::sh::basis(direction.into(), 16);
        let colors = harmonics(row);
        core::array::from_fn::<f32, 3, _>(|c| values.iter().zip(&colors).map(|(value, color)| value * color[c]).sum())
    };
    let [before, after] = [lying, upright].map(|path| ply_rows(&path));
    assert_eq!(before.len(), after.len());
    for (k, (before, after)) in before.iter().zip(&after).enumerate() {
        let [place, normal] = [["x", "y", "z"], ["nx", "ny", "nz"]].map(|names| Vec3::from(columns(before, names)));
        // The middle of the cameras is the ball's but for rounding.
        assert_near(&columns(after, ["x", "y", "z"]), &(0.5 * (turn * place)).to_array(), 10.0 * TURNED, "place");
        assert_near(&columns(after, ["nx", "ny", "nz"]), &(turn * normal).to_array(), TURNED, "normal");
        let scales = columns(before, ["scale_0", "scale_1", "scale_2"]).map(|scale| scale - 2.0_f32.ln());
        assert_near(&columns(after, ["scale_0", "scale_1", "scale_2"]), &scales, 10.0 * TURNED, "scales");
        let [w, x, y, z] = columns(before, ["rot_0", "rot_1", "rot_2", "rot_3"]);
        let quat = Quat::from_mat3(&turn) * Quat::from_xyzw(x, y, z, w);
        let found = columns(after, ["rot_1", "rot_2", "rot_3", "rot_0"]);
        assert_same_turn(found, quat.to_array(), TURNED, "quat");
        let direction = on_sphere(k, COUNT);
        assert_near(&color(after, turn * direction), &color(before, direction), 10.0 * TURNED, "colour");
    }
    // Upright pictures are the same up to rounding, so a printed digit may be another.
    assert!((decibels(&said) - decibels(&said_upright)).abs() < 0.02, "{said} {said_upright}");
    let opened = OpenedModel::open(&ball.tiny.path("upright.ply")).unwrap();
    assert_eq!(opened.orientation(None).unwrap().up, [0.0, -1.0, 0.0], "it opens upright again");
    let mut meshes = specula();
    meshes.arg("export").arg(ball.model()).args(["--mesh", "-o"]).arg(ball.tiny.path("mesh.splat"));
    let refused = meshes.assert().code(2).get_output().clone();
    assert!(String::from_utf8(refused.stderr).unwrap().contains("--mesh writes .ply, .glb, .usda and .usdz files"));
}

#[test]
fn upright_files_have_above_what_their_readers_take_for_it() {
    let (ball, y_up) = lying_ball();
    let up = upright_words();
    let words = ["--upright", "--scene-up", &up, "--no-error"];
    let expected = |k: usize| 0.5 * (y_up * on_sphere(k, COUNT));
    let nearest = |place: Vec3| (0..COUNT).map(|k| expected(k).distance(place)).fold(f32::INFINITY, f32::min);

    let (path, _) = ball.export("ball.spz", &words);
    let read = spz::GaussianSplat::load_packed_from_file(&path, &spz::UnpackOptions::default()).unwrap();
    // A 65536th of the scene.
    assert!(
        read.positions.chunks_exact(3).all(|place| nearest(Vec3::from_slice(place)) < 2.0 / 65_536.0),
        "y is above"
    );

    let (path, _) = ball.export("ball.splat", &words);
    for record in fs::read(path).unwrap().chunks_exact(32) {
        let [x, y, z] = [0, 1, 2].map(|k| f32::from_le_bytes(record[4 * k..4 * k + 4].try_into().unwrap()));
        assert!(nearest(Vec3::new(x, -y, -z)) < 10.0 * TURNED, "y is below");
    }

    let (path, _) = ball.export("ball.glb", &words);
    let file = gltf::Gltf::from_slice_without_validation(&fs::read(&path).unwrap()).unwrap();
    let node = glam::Mat4::from_cols_array_2d(&file.nodes().next().unwrap().transform().matrix());
    for k in [0, 7, 1000, COUNT - 1] {
        let place = node.transform_point3(on_sphere(k, COUNT));
        assert!(place.distance(expected(k)) < 10.0 * TURNED, "{place}, not {}", expected(k));
    }
}

#[test]
fn upright_light_and_meshes_have_the_scenes_above_above() {
    /// Twice a pixel's or texel's width, along which the light changes by a third at most, and
    /// RGBE.
    const NEARLY: f32 = 0.06;
    /// Normals have four digits behind the point in a file.
    const WRITTEN: f32 = 2e-4;
    let above = ABOVE.normalize();
    let (ball, y_up) = lying_ball();
    let up = upright_words();
    let words = |more: &[&'static str]| [&["--upright", "--scene-up", up.as_str(), "--no-error"], more].concat();
    let coming_from = |direction: Vec3| soft((y_up.transpose() * direction).as_dvec3().to_array());
    // Of a file with y above the middle is −z and x lies to the right of it; of one with z above,
    // where −z is +y, the middle is +x and y lies to the left.
    for (name, axis, right) in [("y.exr", "y", Vec3::X), ("z.exr", "z", Vec3::Z)] {
        let (path, said) = ball.export(name, &words(&["--up", axis]));
        let picture = image::open(path).unwrap().to_rgb32f();
        let (width, height) = picture.dimensions();
        assert_near(&picture.get_pixel(5, 0).0, &coming_from(Vec3::Y), NEARLY, &said);
        assert_near(&picture.get_pixel(5, height - 1).0, &coming_from(Vec3::NEG_Y), NEARLY, &said);
        assert_near(&picture.get_pixel(3 * width / 4, height / 2).0, &coming_from(right), NEARLY, &said);
    }
    let (path, _) = ball.export("y.ktx2", &words(&["--up", "y"]));
    let sharpest = ktx2::Reader::new(fs::read(path).unwrap()).unwrap().levels().next().unwrap().data.to_vec();
    let n = LIGHT_RESOLUTION;
    // The face +Y lies third.
    let at = 8 * (2 * n * n + n / 2 * n + n / 2);
    let word = |at: usize| unpack2(u32::from_le_bytes(sharpest[at..at + 4].try_into().unwrap()));
    assert_near(&[word(at)[0], word(at)[1], word(at + 4)[0]], &coming_from(Vec3::Y), NEARLY, "what comes from above");
    assert!(above.dot(y_up.transpose() * Vec3::Y) > 0.999, "which is what was said");

    let load = |name: &str, words: &[&str]| {
        let (path, _) = ball.export(name, words);
        tobj::load_obj(&path, &tobj::LoadOptions::default()).unwrap().0.remove(0).mesh
    };
    let lying = load("lying.obj", &["--voxels", "32"]);
    let upright = load("upright.obj", &words(&["--voxels", "32"]));
    let vectors = |numbers: &[f32]| -> Vec<Vec3> { numbers.chunks_exact(3).map(Vec3::from_slice).collect() };
    assert_eq!((&lying.indices, &lying.vertex_color), (&upright.indices, &upright.vertex_color));
    assert!(lying.indices.len() > 1000, "there is a ball");
    for (before, after) in vectors(&lying.positions).into_iter().zip(vectors(&upright.positions)) {
        assert_near(&after.to_array(), &(0.5 * (y_up * before)).to_array(), 10.0 * TURNED, "place");
    }
    for (before, after) in vectors(&lying.normals).into_iter().zip(vectors(&upright.normals)) {
        assert_near(&after.to_array(), &(y_up * before).to_array(), WRITTEN, "normal");
    }
}

#[test]
fn a_glb_is_rendered_and_relit_like_a_model() {
    /// The file has one normal for each Gaussian, and no residuals to fit another light.
    const SAME: f64 = 32.0;
    let ball = Ball::under(soft);
    let (glb, _) = ball.export("ball.glb", &["--no-error"]);
    let picture = |command: &str, scene: &Path, words: &[&str], out: &str| {
        let mut program = specula();
        program.arg(command).arg(scene).args(words).args(["--executor", "cpu", "--quiet", "--cameras"]);
        program.arg(ball.model().join("cameras.json")).arg("-o").arg(ball.tiny.path(out)).assert().success();
        image::open(ball.tiny.path(out).join("rgb/00000.png")).unwrap().to_rgb8()
    };
    let model_picture = picture("render", &ball.model(), &["--layers", "rgb"], "model");
    let file_picture = picture("render", &glb, &["--layers", "rgb"], "file");
    assert!(psnr(&model_picture, &file_picture) > SAME, "{} dB", psnr(&model_picture, &file_picture));
    let sunny = picture("relight", &glb, &["--env", "none", "--sun", "0,60,3"], "sun");
    let apart = psnr(&file_picture, &sunny);
    assert!(apart < SAME, "a sun is another light: {apart} dB");

    let sky = two_colours(&ball);
    let (relit, _) = ball.export("relit.glb", &["--no-error", "--env", sky.to_str().unwrap()]);
    let model_picture = picture("relight", &ball.model(), &["--env", sky.to_str().unwrap()], "relit model");
    let file_picture = picture("render", &relit, &["--layers", "rgb"], "relit file");
    assert!(psnr(&model_picture, &file_picture) > SAME, "relit: {} dB", psnr(&model_picture, &file_picture));

    let refused = specula().arg("render").arg(&glb).args(["--profile", "paper"]).output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(2) && said.contains("omit --profile"), "{said}");
    fs::write(ball.tiny.path("cut.glb"), &fs::read(&glb).unwrap()[..500]).unwrap();
    let refused = specula().arg("info").arg(ball.tiny.path("cut.glb")).output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(2) && said.contains("cut.glb") && said.lines().count() == 1, "{said}");
}
