//! Checkpoints: what comes back, and that no file can make the reader panic or ask for memory in
//! vain.

use serde_json::{Value, json};
use specula_core::{
    expose::Exposure,
    light_network::WEIGHT_COUNT,
    near_field::{NearField, VERTEX_ALBEDO},
    random,
    scene::{Environment, Gaussians, Layout, RadianceActivation, len_of_values},
    state::{AdamMoments, ExposureState, SceneState, Statistics, TrainingState},
};
use specula_io::{
    Error,
    checkpoint::{self, Checkpoint, Facts},
};
use std::{fs, path::Path};
use tempfile::TempDir;

const COUNT: usize = 19;
const RESOLUTION: usize = 2;

/// Finite numbers of any bits: what is read is compared bit by bit.
fn numbers(stream: u64, len: usize) -> Vec<f32> {
    /// Without it no exponent is the largest.
    const HIGHEST_BIT_OF_EXPONENT: u32 = 1 << 30;
    let bits = |k| random::bits(1, stream, k) as u32;
    let number = |k| Some(f32::from_bits(bits(k))).filter(|number| number.is_finite());
    (0..len as u64).map(|k| number(k).unwrap_or(f32::from_bits(bits(k) & !HIGHEST_BIT_OF_EXPONENT))).collect()
}

/// Squares of any bits.
fn squares(stream: u64, len: usize) -> Vec<f32> {
    numbers(stream, len).into_iter().map(f32::abs).collect()
}

/// Of three photographs.
fn exposures(numbers: &[f32]) -> Vec<Exposure<f32>> {
    numbers.as_chunks::<4>().0.as_chunks::<3>().0.to_vec()
}

fn example(layout: Layout) -> Checkpoint {
    let len = len_of_values(COUNT, layout);
    let moments =
        |stream: u64, len: usize| AdamMoments { mean: numbers(stream, len), square: squares(stream + 1, len) };
    let light = layout.is_shaded().then(|| {
        let len = 6 * RESOLUTION * RESOLUTION * 3;
        let activation = RadianceActivation::Exponential;
        (Environment { resolution: RESOLUTION, activation, values: numbers(10, len) }, moments(11, len))
    });
    let scene = SceneState {
        gaussians: Gaussians { count: COUNT, layout, values: numbers(1, len) },
        moments: moments(2, len),
        statistics: Statistics { grad_sum: numbers(4, COUNT), view_count: numbers(5, COUNT) },
        light,
    };
    let moments = AdamMoments { mean: exposures(&numbers(14, 36)), square: exposures(&squares(15, 36)) };
    Checkpoint {
        state: TrainingState {
            scene,
            other_lights: Vec::new(),
            near_field: Some(near_field()),
            exposures: Some(ExposureState { maps: exposures(&numbers(13, 36)), moments }),
            order: vec![3, 0, 7],
            iteration: 40,
            psnr: Some(21.0 / 0.7),
            nonfinite: 0,
        },
        facts: Facts { iterations: 40, seconds: 0.1 + 0.2, seed: u64::MAX, ..Facts::default() },
    }
}

/// One triangle in one leaf.
fn near_field() -> NearField<Vec<f32>> {
    let node = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0];
    let number = |(k, x): (usize, f32)| if k % 16 < VERTEX_ALBEDO { x.clamp(-1e30, 1e30) } else { x.clamp(0.0, 1.0) };
    let vertices = numbers(16, 48).into_iter().enumerate().map(number);
    NearField::of_sizes([1, 1, 3], 0.125, node.into_iter().chain([0.0, 1.0, 2.0, 0.0]).chain(vertices).collect())
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// All numbers as bits, in order.
fn all_bits(checkpoint: &Checkpoint) -> Vec<u32> {
    let TrainingState { scene, near_field, exposures, .. } = &checkpoint.state;
    let SceneState { gaussians, moments, statistics, light } = scene;
    let exposures = exposures.iter().flat_map(|ExposureState { maps, moments }| [maps, &moments.mean, &moments.square]);
    let exposures = exposures.map(|maps| maps.as_flattened().as_flattened());
    let light = light.iter().flat_map(|(light, moments)| [&light.values, &moments.mean, &moments.square]);
    [&gaussians.values, &moments.mean, &moments.square, &statistics.grad_sum, &statistics.view_count]
        .into_iter()
        .chain(light)
        .chain(near_field.iter().map(|near_field| &near_field.values))
        .map(Vec::as_slice)
        .chain(exposures)
        .flat_map(bits)
        .collect()
}

#[test]
fn every_bit_comes_back() {
    let layouts = [Layout::shaded(Some(3)), Layout::shaded(None), Layout::radiance(0)];
    for layout in layouts.into_iter().chain([Layout::shaded(Some(1)).antialiased()]) {
        let folder = tempfile::tempdir().unwrap();
        let written = example(layout);
        checkpoint::write(folder.path(), &written).unwrap();
        let read = checkpoint::read(folder.path()).unwrap();
        assert_eq!(all_bits(&read), all_bits(&written));
        assert_eq!((&read.state.order, &read.facts), (&written.state.order, &written.facts));
        let counters = |state: &TrainingState<Vec<f32>>| (state.iteration, state.psnr, state.nonfinite);
        assert_eq!(counters(&read.state), counters(&written.state));
        let gaussians = &read.state.scene.gaussians;
        assert_eq!((gaussians.count, gaussians.layout), (COUNT, layout));
        let kinds = |checkpoint: &Checkpoint| {
            checkpoint.state.scene.light.as_ref().map(|(light, _)| (light.resolution, light.activation))
        };
        assert_eq!(kinds(&read), kinds(&written));
    }
}

#[test]
fn lights_of_other_groups_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut written = example(Layout::shaded(Some(1)));
    let (light, moments) = written.state.scene.light.clone().unwrap();
    let other = |seed: u64| (light.with_values(numbers(seed, light.values.len())), moments.clone());
    written.state.other_lights = vec![other(31), other(32)];
    checkpoint::write(folder.path(), &written).unwrap();
    let read = checkpoint::read(folder.path()).unwrap();
    assert!(read.state.other_lights == written.state.other_lights);
    assert_eq!(read.state.scene.light, written.state.scene.light);
}

#[test]
fn the_weights_of_a_light_that_is_a_network_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut written = example(Layout::shaded(Some(1)));
    let network =
        Environment { resolution: 64, activation: RadianceActivation::Network, values: numbers(20, WEIGHT_COUNT) };
    let moments = AdamMoments { mean: numbers(21, WEIGHT_COUNT), square: squares(22, WEIGHT_COUNT) };
    written.state.scene.light = Some((network, moments));
    checkpoint::write(folder.path(), &written).unwrap();
    let read = checkpoint::read(folder.path()).unwrap();
    assert_eq!(read.state.scene.light, written.state.scene.light);
}

#[test]
fn equal_trainings_are_equal_files() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = || {
        checkpoint::write(folder.path(), &example(Layout::shaded(Some(1)))).unwrap();
        fs::read(checkpoint::path_in(folder.path())).unwrap()
    };
    assert!(bytes() == bytes(), "two files of the same training differ");
}

/// A checkpoint on disk, to be spoilt.
struct Spoilt {
    folder: TempDir,
    bytes: Vec<u8>,
}

impl Spoilt {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        checkpoint::write(folder.path(), &example(Layout::shaded(Some(1)))).unwrap();
        let bytes = fs::read(checkpoint::path_in(folder.path())).unwrap();
        Self { folder, bytes }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn read(&self, bytes: &[u8]) -> Result<Checkpoint, Error> {
        fs::write(checkpoint::path_in(self.path()), bytes).unwrap();
        checkpoint::read(self.path())
    }

    /// Refuses the file in a sentence with these words and its path.
    fn refuses(&self, bytes: &[u8], words: &[&str]) {
        let sentence = self.read(bytes).expect_err("it is spoilt").to_string();
        for word in [words, &["checkpoint.safetensors"]].concat() {
            assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
        }
    }

    /// The file with another header.
    fn with_header(&self, edit: impl FnOnce(&mut Value)) -> Vec<u8> {
        let length = 8 + u64::from_le_bytes(self.bytes[..8].try_into().unwrap()) as usize;
        let mut header: Value = serde_json::from_slice(&self.bytes[8..length]).unwrap();
        edit(&mut header);
        let header = serde_json::to_vec(&header).unwrap();
        [&(header.len() as u64).to_le_bytes()[..], &header, &self.bytes[length..]].concat()
    }

    /// The file with another entry of ours in its header.
    fn with_ours(&self, key: &str, value: Value) -> Vec<u8> {
        self.with_header(|header| {
            let text = &mut header["__metadata__"]["specula"];
            let mut ours: Value = serde_json::from_str(text.as_str().unwrap()).unwrap();
            ours[key] = value;
            *text = ours.to_string().into();
        })
    }
}

#[test]
fn a_folder_without_a_checkpoint_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let sentence = checkpoint::read(folder.path()).unwrap_err().to_string();
    assert!(sentence.contains(folder.path().to_str().unwrap()) && sentence.contains("no checkpoint"), "{sentence}");
}

#[test]
fn a_file_that_is_cut_short_anywhere_is_refused() {
    let spoilt = Spoilt::new();
    for len in (0..spoilt.bytes.len()).step_by(13) {
        spoilt.refuses(&spoilt.bytes[..len], &[]);
    }
    spoilt.refuses(&[&spoilt.bytes[..], &[0]].concat(), &["the tensors"]);
}

#[test]
fn random_bytes_are_refused_and_random_changes_harm_nobody() {
    const TRIES: u64 = 400;
    let spoilt = Spoilt::new();
    for k in 0..TRIES {
        let len = random::bits(2, k, 0) % 3000;
        let bytes: Vec<u8> = (1..=len).map(|byte| random::bits(2, k, byte) as u8).collect();
        spoilt.refuses(&bytes, &[]);
        // With a header that is short enough to be looked at.
        let short = [&(len / 2).to_le_bytes()[..], &bytes].concat();
        spoilt.refuses(&short, &["the header"]);

        let mut changed = spoilt.bytes.clone();
        let place = random::bits(3, k, 0) as usize % changed.len();
        changed[place] ^= 1 << (random::bits(3, k, 1) % 8);
        // A bit of a number is another number; anything else is refused. Neither panics.
        let _ = spoilt.read(&changed);
    }
}

#[test]
fn headers_that_promise_too_much_ask_for_no_memory() {
    let spoilt = Spoilt::new();
    for length in [u64::MAX, u64::MAX - 7, 1 << 40, spoilt.bytes.len() as u64] {
        let mut bytes = spoilt.bytes.clone();
        bytes[..8].copy_from_slice(&length.to_le_bytes());
        spoilt.refuses(&bytes, &["the header"]);
    }
    for count in [json!(1_u64 << 60), json!(u64::MAX), json!(COUNT + 1), json!(COUNT + 32), json!(0), json!(-1)] {
        spoilt.refuses(&spoilt.with_ours("gaussians", count), &[]);
    }
    for resolution in [json!(u64::MAX), json!(1_u64 << 40), json!(3), json!(0)] {
        let light = json!({"resolution": resolution, "is_exponential": true});
        spoilt.refuses(&spoilt.with_ours("light", light), &["\"light\""]);
    }
    for count in [json!(1_u64 << 60), json!(u64::MAX), json!(4), json!(0)] {
        spoilt.refuses(&spoilt.with_ours("exposures", count), &[]);
    }
    let huge = json!({"dtype": "F32", "shape": [1_u64 << 62, 1_u64 << 62], "data_offsets": [0, 8]});
    spoilt.refuses(&spoilt.with_header(|header| header["grad_sum"] = huge), &["the header"]);
}

#[test]
fn tensors_that_are_missing_or_odd_are_named() {
    let spoilt = Spoilt::new();
    let names = ["gaussians", "gaussians.mean", "gaussians.square", "grad_sum", "view_count", "light", "light.mean"];
    let names = [&names[..], &["exposure", "exposure.mean"]].concat();
    for name in [&names[..], &["light.square", "exposure.square", "order"]].concat() {
        let renamed = spoilt.with_header(|header| {
            let info = header[name].take();
            header.as_object_mut().unwrap().remove(name);
            header["another"] = info;
        });
        spoilt.refuses(&renamed, &[&format!("{name:?}"), "missing"]);
        let other_kind = if name == "order" { "F32" } else { "I32" };
        spoilt.refuses(&spoilt.with_header(|header| header[name]["dtype"] = other_kind.into()), &[name, other_kind]);
    }
    for name in names {
        let len = |header: &Value| header[name]["shape"].as_array().unwrap().iter().filter_map(Value::as_u64).product();
        let flat = spoilt.with_header(|header| {
            let len: u64 = len(header);
            header[name]["shape"] = json!([1, len]);
        });
        spoilt.refuses(&flat, &[&format!("{name:?}"), "shape"]);
    }
}

#[test]
fn numbers_that_are_not_finite_are_counted_by_tensor() {
    let mut written = example(Layout::shaded(Some(1)));
    let folder = tempfile::tempdir().unwrap();
    let light = &mut written.state.scene.light.as_mut().unwrap().1;
    light.square[..3].copy_from_slice(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
    checkpoint::write(folder.path(), &written).unwrap();
    let sentence = checkpoint::read(folder.path()).unwrap_err().to_string();
    for word in ["checkpoint.safetensors", "\"light.square\"", "3 of its 72 numbers are NaN or infinite"] {
        assert!(sentence.contains(word), "{word:?} is not in: {sentence}");
    }
}

#[test]
fn squares_that_have_no_root_are_refused() {
    let mut written = example(Layout::shaded(Some(1)));
    let folder = tempfile::tempdir().unwrap();
    written.state.exposures.as_mut().unwrap().moments.square[1][2][0] = -1.0;
    checkpoint::write(folder.path(), &written).unwrap();
    let sentence = checkpoint::read(folder.path()).unwrap_err().to_string();
    assert!(sentence.contains("\"exposure.square\"") && sentence.contains("not negative"), "{sentence}");
}

#[test]
fn facts_that_no_training_comes_to_are_refused() {
    let spoilt = Spoilt::new();
    let facts = json!({"program": "", "iteration": 40, "iterations": 40, "seconds": 1.0, "psnr": null, "nonfinite": 0,
        "seed": 0, "config": "", "settings": "", "views": 3, "pictures": ""});
    let with = |key: &str, value: Value| {
        let mut facts = facts.clone();
        facts[key] = value;
        spoilt.with_ours("facts", facts)
    };
    assert!(spoilt.read(&with("seconds", json!(3e9))).is_ok());
    for (key, value, word) in [
        ("seconds", json!(1e20), "100000000000000000000 seconds"),
        ("seconds", json!(-0.5), "-0.5 seconds"),
        ("iteration", json!(41), "iteration 41 of 40"),
        ("nonfinite", json!(u64::MAX), "gradients"),
    ] {
        spoilt.refuses(&with(key, value), &["the header", word]);
    }
}

#[test]
fn headers_that_are_not_ours_are_refused() {
    let spoilt = Spoilt::new();
    spoilt.refuses(&spoilt.with_header(|header| header["__metadata__"] = json!({})), &["not written by specula"]);
    spoilt.refuses(&spoilt.with_header(|header| header["__metadata__"]["specula"] = json!("?")), &["the header"]);
    spoilt.refuses(&spoilt.with_ours("format", json!(2)), &["format 2", "format 1"]);
    spoilt.refuses(&spoilt.with_ours("format", json!("one")), &["the header"]);
    spoilt.refuses(&spoilt.with_ours("facts", json!({})), &["the header"]);
    spoilt.refuses(&spoilt.with_ours("sh_degree", json!(9)), &["degree"]);
    let mut bytes = spoilt.bytes.clone();
    bytes[12] = 0xff;
    spoilt.refuses(&bytes, &["the header"]);
}
