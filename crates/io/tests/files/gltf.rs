//! Gaussians in glTF of other programs: places, words of the extension, buffers, quantisation.

use base64::{Engine, engine::general_purpose::STANDARD};
use glam::{DMat3, DQuat, DVec3, EulerRot};
use serde_json::{Value, json};
use specula_core::{
    double::Double,
    scene::{Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT},
    sh::{Y0, basis},
    vector::vec3,
};
use specula_io::{
    Input,
    glb::{self, GlbScene},
};
use std::fs;

const S: &str = "KHR_gaussian_splatting";
const COUNT: usize = 3;
/// Rounding of exp, ln, sigmoid and logit, one after the other.
const ROUNDING: f32 = 1e-4;

/// Accessors of some Gaussians of degree 1, in one buffer.
struct Arrays {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    attributes: Value,
}

impl Arrays {
    fn new() -> Self {
        let mut arrays = Self { bytes: vec![], views: vec![], accessors: vec![], attributes: json!({}) };
        let wave = |start: f32, width: usize| -> Vec<f32> {
            (0..COUNT * width).map(|k| (start + 1.7 * k as f32).sin()).collect()
        };
        let quats: Vec<f32> = wave(1.0, 4)
            .chunks(4)
            .flat_map(|q| {
                let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
                q.iter().map(|x| x / length).collect::<Vec<f32>>()
            })
            .collect();
        arrays.floats("POSITION", 3, &wave(0.0, 3));
        arrays.floats(&format!("{S}:ROTATION"), 4, &quats);
        arrays.floats(&format!("{S}:SCALE"), 3, &wave(2.0, 3).iter().map(|x| 0.2 + 0.1 * x).collect::<Vec<_>>());
        arrays.floats(&format!("{S}:OPACITY"), 1, &[0.2, 0.5, 0.9]);
        for (k, name) in ["0_COEF_0", "1_COEF_0", "1_COEF_1", "1_COEF_2"].iter().enumerate() {
            let harmonics: Vec<f32> = wave(3.0 + k as f32, 3).iter().map(|x| 0.2 * x).collect();
            arrays.floats(&format!("{S}:SH_DEGREE_{name}"), 3, &harmonics);
        }
        arrays
    }

    fn floats(&mut self, name: &str, width: usize, numbers: &[f32]) {
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        self.add(name, width, 5126, false, &bytes);
    }

    fn add(&mut self, name: &str, width: usize, of: u32, is_normalized: bool, bytes: &[u8]) {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        self.attributes[name] = self.accessors.len().into();
        self.accessors.push(json!({"bufferView": self.views.len(), "componentType": of, "type": kind, "count": COUNT,
            "normalized": is_normalized}));
        self.views.push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()}));
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }

    /// Document of a scene of one node.
    fn document(&self) -> Value {
        let extension = json!({"kernel": "ellipse", "colorSpace": "srgb_rec709_display"});
        let list = json!({"mode": 0, "attributes": self.attributes, "extensions": {S: extension}});
        let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&self.bytes));
        json!({
            "asset": {"version": "2.0", "generator": "another"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}], "meshes": [{"primitives": [list]}], "accessors": self.accessors,
            "bufferViews": self.views, "buffers": [{"uri": uri, "byteLength": self.bytes.len()}],
        })
    }
}

fn read(document: &Value) -> Result<GlbScene, String> {
    glb::read(Input::memory("a.gltf", document.to_string().as_bytes())).map_err(|error| error.to_string())
}

/// Scene of the Gaussians after a change of their document.
fn changed(change: impl FnOnce(&mut Value)) -> Result<GlbScene, String> {
    let mut document = Arrays::new().document();
    change(&mut document);
    read(&document)
}

fn placed(nodes: Value) -> GlbScene {
    changed(|document| document["nodes"] = nodes).unwrap()
}

/// Extension of the one list.
fn extension(document: &mut Value) -> &mut Value {
    &mut document["meshes"][0]["primitives"][0]["extensions"][S]
}

fn vector(gaussians: &Gaussians<Vec<f32>>, index: usize, plane: usize) -> DVec3 {
    DVec3::from(gaussians.get::<3>(index, plane).map(f64::from))
}

fn covariance(gaussians: &Gaussians<Vec<f32>>, index: usize) -> DMat3 {
    let [w, x, y, z] = gaussians.get::<4>(index, QUAT).map(f64::from);
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let axes = axes * DMat3::from_diagonal(DVec3::from(vector(gaussians, index, LOG_SCALE).to_array().map(f64::exp)));
    axes * axes.transpose()
}

/// Red that a Gaussian shows along a direction.
fn red(gaussians: &Gaussians<Vec<f32>>, index: usize, direction: DVec3) -> f64 {
    let [x, y, z] = direction.normalize().to_array().map(Double);
    let count = gaussians.layout.sh_count();
    let basis = basis(vec3(x, y, z), count);
    let term = |k: usize| f64::from(gaussians.get::<1>(index, gaussians.layout.sh_start() + 3 * k)[0]) * basis[k].0;
    (0..count).map(term).sum()
}

#[test]
fn text_with_buffers_inside_or_beside_it_is_read_as_the_binary_form() {
    let arrays = Arrays::new();
    let inside = read(&arrays.document()).unwrap();
    assert_eq!((inside.gaussians.count, inside.up, inside.notes.len()), (COUNT, [0.0, 1.0, 0.0], 0));
    let folder = tempfile::tempdir().unwrap();
    let (path, beside) = (folder.path().join("a.gltf"), folder.path().join("my data/a.bin"));
    fs::create_dir(beside.parent().unwrap()).unwrap();
    fs::write(&beside, &arrays.bytes).unwrap();
    let with = |uri: &str| {
        let mut document = arrays.document();
        document["buffers"][0]["uri"] = uri.into();
        fs::write(&path, format!("\u{feff}{document}")).unwrap();
        glb::read(Input::file(&path)).map_err(|error| error.to_string())
    };
    assert_eq!(with("my%20data/a.bin").unwrap(), inside);
    assert!(glb::is_gltf(&path));
    for (uri, words) in [
        ("../a.bin", "outside of its folder"),
        ("/etc/hosts", "outside of its folder"),
        ("https://localhost/a.bin", "outside of its folder"),
        ("none.bin", "none.bin"),
        ("data:text/plain,abc", "base64"),
    ] {
        assert!(with(uri).unwrap_err().contains(words), "{uri}");
    }
    assert!(changed(|document| document["buffers"][0]["uri"] = "a.bin".into()).unwrap_err().contains(".glb"));
}

#[test]
fn words_of_the_extension_that_are_not_known_are_refused_by_name() {
    for key in ["kernel", "colorSpace", "projection", "sortingMethod"] {
        let sentence = changed(|document| extension(document)[key] = "of_another".into()).unwrap_err();
        assert!(sentence.contains(key) && sentence.contains("of_another"), "{sentence}");
    }
    let noted = changed(|document| extension(document)["shadows"] = true.into()).unwrap().notes.concat();
    assert!(noted.contains("shadows"), "{noted}");
    let packed = changed(|document| {
        extension(document)["extensions"] = json!({"KHR_gaussian_splatting_compression_spz_2": {}});
        document["meshes"][0]["primitives"][0]["attributes"] = json!({});
    });
    assert!(packed.unwrap_err().contains("KHR_gaussian_splatting_compression_spz_2"));
    let required = changed(|document| document["extensionsRequired"] = json!(["EXT_meshopt_compression"]));
    assert!(required.unwrap_err().contains("EXT_meshopt_compression"));
    let view = changed(|document| document["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": {}}));
    assert!(view.unwrap_err().contains("EXT_meshopt_compression"));
    assert!(changed(|document| document["accessors"][2]["sparse"] = json!({})).unwrap_err().contains("sparse"));
}

#[test]
fn linear_colours_are_encoded() {
    let mut arrays = Arrays::new();
    for degree_0 in [true, false] {
        if degree_0 {
            arrays.floats(&format!("{S}:SH_DEGREE_0_COEF_0"), 3, &[(0.2 - 0.5) / Y0; 9]);
        }
        let mut document = arrays.document();
        if degree_0 {
            let attributes = document["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
            attributes.retain(|name, _| !name.contains("DEGREE_1"));
        } else {
            for k in 0..3 {
                arrays.floats(&format!("{S}:SH_DEGREE_1_COEF_{k}"), 3, &[0.02; 9]);
            }
            document = arrays.document();
        }
        extension(&mut document)["colorSpace"] = "lin_rec709_display".into();
        let GlbScene { gaussians, notes, .. } = read(&document).unwrap();
        assert!(notes.concat().contains("lin_rec709_display"), "{notes:?}");
        for direction in [DVec3::X, DVec3::new(0.6, -0.8, 0.0), DVec3::NEG_Z] {
            let linear =
                0.2 + if degree_0 { 0.0 } else { 0.02 * 0.488_602_5 * (direction.z - direction.x - direction.y) };
            let expected = 1.055 * linear.powf(1.0 / 2.4) - 0.055;
            let found = 0.5 + red(&gaussians, 1, direction);
            assert!((found - expected).abs() < 2e-3, "{degree_0}: {found}, {expected} expected");
        }
    }
}

#[test]
fn scales_of_drafts_are_logarithms_and_logits_are_refused() {
    let plain = changed(|_| ()).unwrap().gaussians;
    let mut arrays = Arrays::new();
    let logarithms: Vec<f32> = (0..COUNT).flat_map(|index| plain.get::<3>(index, LOG_SCALE)).collect();
    arrays.floats(&format!("{S}:SCALE"), 3, &logarithms);
    let read_again = read(&arrays.document()).unwrap();
    assert_eq!(read_again.gaussians, plain);
    assert!(read_again.notes.concat().contains("negative scales"));
    arrays.floats(&format!("{S}:OPACITY"), 1, &[-1.4, 0.0, 2.2]);
    assert!(read(&arrays.document()).unwrap_err().contains("opacities are not in 0 to 1 (-1.4)"));
}

#[test]
fn one_list_stays_in_its_world_and_turns_with_the_nodes_above_it() {
    let plain = placed(json!([{"mesh": 0}]));
    let turn = DQuat::from_euler(EulerRot::XYZ, 0.3, -0.8, 1.1);
    let turned = placed(json!([{"mesh": 0, "rotation": turn.to_array()}]));
    assert_eq!(turned.gaussians, plain.gaussians);
    assert!((DVec3::from(turned.up) - turn.inverse() * DVec3::Y).length() < 1e-12);
    let matrix = |matrix: DMat3| glam::DMat4::from_mat3(matrix).to_cols_array();
    for nodes in [
        json!([{"children": [1], "rotation": turn.to_array(), "scale": [2, 2, 2]}, {"mesh": 0, "translation": [1, 2, 3]}]),
        json!([{"children": [1], "matrix": matrix(DMat3::from_quat(turn))}, {"mesh": 0}]),
        json!([{"mesh": 0, "matrix": matrix(DMat3::from_quat(turn) * 3.0)}]),
    ] {
        let again = placed(nodes);
        assert_eq!(again.gaussians, turned.gaussians);
        assert!((DVec3::from(again.up) - DVec3::from(turned.up)).length() < 1e-9, "{:?}", again.up);
        assert_eq!(again.notes, [""; 0]);
    }
}

#[test]
fn lists_that_are_stretched_mirrored_or_several_are_mapped_exactly() {
    let plain = placed(json!([{"mesh": 0}])).gaussians;
    let turn = DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, 0.3, -0.8, 1.1));
    let shear = DMat3::from_cols(DVec3::new(1.0, 0.2, 0.0), DVec3::new(-0.3, 1.5, 0.4), DVec3::new(0.0, 0.0, 0.7));
    for (matrix, is_turn) in [(2.0 * turn, true), (-turn, true), (shear, false)] {
        let mut columns = glam::DMat4::from_mat3(matrix);
        columns.w_axis = glam::DVec4::new(1.0, -2.0, 0.5, 1.0);
        // Twice the same mesh: once below a parent, once as it is.
        let nodes = json!([{"children": [1, 2]}, {"mesh": 0, "matrix": columns.to_cols_array()}, {"mesh": 0}]);
        let GlbScene { gaussians, up, notes, .. } = placed(nodes);
        assert_eq!((gaussians.count, up), (2 * COUNT, [0.0, 1.0, 0.0]));
        assert_eq!(notes.concat().contains("stretches or shears"), !is_turn, "{notes:?}");
        for index in 0..COUNT {
            let mean = matrix * vector(&plain, index, MEAN) + DVec3::new(1.0, -2.0, 0.5);
            assert!((vector(&gaussians, index, MEAN) - mean).length() < 1e-5);
            let expected = matrix * covariance(&plain, index) * matrix.transpose();
            let apart = covariance(&gaussians, index) - expected;
            assert!(apart.to_cols_array().iter().all(|x| x.abs() < 1e-5), "{apart}");
            assert_eq!(gaussians.get::<1>(index, OPACITY), plain.get::<1>(index, OPACITY));
            for direction in [DVec3::X, DVec3::new(0.6, -0.8, 0.0), DVec3::NEG_Z] {
                let [before, after] = [red(&plain, index, direction), red(&gaussians, index, matrix * direction)];
                assert!(!is_turn || (before - after).abs() < 1e-5, "{before} became {after}");
            }
            let same = covariance(&gaussians, COUNT + index) - covariance(&plain, index);
            assert!(same.to_cols_array().iter().all(|x| x.abs() < 1e-5), "the other instance is moved");
        }
    }
}

#[test]
fn what_is_beside_the_gaussians_is_named() {
    let plain = changed(|_| ()).unwrap().gaussians;
    let mesh = json!({"primitives": [{"attributes": {"POSITION": 0}}]});
    let list = Arrays::new().document()["meshes"][0].clone();
    let with = |meshes: Value, nodes: Value| {
        changed(|document| {
            document["meshes"] = meshes;
            document["nodes"] = nodes;
        })
    };
    // A mesh whose node no Gaussians could have, before them, and outside of the scene.
    let flat = json!({"mesh": 0, "scale": [1, 0, 1]});
    let read = with(json!([mesh, list]), json!([{"children": [1, 2]}, flat, {"mesh": 1}])).unwrap();
    assert_eq!(read.gaussians, plain);
    assert!(read.notes.concat().contains("1 meshes"), "{:?}", read.notes);
    let outside = with(json!([mesh, list]), json!([flat, {"mesh": 1}])).unwrap();
    assert!(outside.gaussians == plain && outside.notes.concat().contains("outside of its scene"));
    let hidden = with(json!([list, list]), json!([{"mesh": 0}, {"mesh": 1}])).unwrap();
    assert!(hidden.gaussians == plain && hidden.notes.concat().contains("1 lists of Gaussians outside"));
    assert!(with(json!([mesh]), json!([{"mesh": 0}])).unwrap_err().contains("is a mesh, without Gaussians"));
    for (nodes, words) in [
        (json!([{"children": [1]}, {"mesh": 0, "children": [0]}]), "more than once"),
        (json!([{"children": [7]}]), "no node 7"),
        (json!([{"mesh": 0, "matrix": vec![0; 16]}]), "no inverse"),
        (json!([{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {}}}]), "EXT_mesh_gpu_instancing"),
    ] {
        assert!(with(json!([list]), nodes).unwrap_err().contains(words), "{words}");
    }
}

#[test]
fn quantised_and_interleaved_numbers_are_read() {
    let plain = changed(|_| ()).unwrap().gaussians;
    let mut arrays = Arrays::new();
    // Shorts that are no fractions, as with KHR_mesh_quantization, four of each for alignment.
    let places: Vec<u8> = [[1, -2, 3, 0], [40, 50, -60, 0], [7, 8, 9, 0]]
        .as_flattened()
        .iter()
        .flat_map(|x: &i16| x.to_le_bytes())
        .collect();
    arrays.add("POSITION", 3, 5122, false, &places);
    arrays.add(&format!("{S}:OPACITY"), 1, 5121, true, &[51, 0, 0, 0, 128, 0, 0, 0, 230, 0, 0, 0]);
    let mut document = arrays.document();
    for (name, stride) in [("POSITION", 8), ("KHR_gaussian_splatting:OPACITY", 4)] {
        let accessor = arrays.attributes[name].as_u64().unwrap() as usize;
        document["bufferViews"][accessor]["byteStride"] = stride.into();
    }
    document["extensionsRequired"] = json!(["KHR_mesh_quantization", S]);
    let read = read(&document).unwrap().gaussians;
    assert_eq!(read.get::<3>(1, MEAN), [40.0, 50.0, -60.0]);
    let [opaque]: [f32; 1] = read.get(0, OPACITY);
    assert!((opaque - plain.get::<1>(0, OPACITY)[0]).abs() < ROUNDING);
}
