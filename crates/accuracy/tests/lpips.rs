//! LPIPS against the reference package: networks of a few channels with random weights, exported by
//! `scripts/lpips-onnx.py --test`, and the package's distances of two pictures.

use safetensors::SafeTensors;
use specula_accuracy::lpips::Network;
use specula_core::scene::Image;

/// Relative tolerance: sums of at most 288 products in another order, thirteen layers deep.
const ROUNDING: f64 = 1e-5;

const VGG: &[u8] = include_bytes!("data/lpips-vgg.onnx");
/// Networks for colours from −1 to 1, and networks that convert from 0 to 1 themselves.
const ALEX: &[u8] = include_bytes!("data/lpips-alex.onnx");
const KNOWN: &[u8] = include_bytes!("data/lpips-known.safetensors");

fn known(name: &str) -> (Vec<usize>, Vec<f32>) {
    let file = SafeTensors::deserialize(KNOWN).unwrap();
    let tensor = file.tensor(name).unwrap();
    let (numbers, _) = tensor.data().as_chunks::<4>();
    (tensor.shape().to_vec(), numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
}

fn pictures() -> [Image<Vec<f32>>; 2] {
    ["one", "other"].map(|name| {
        let (shape, values) = known(name);
        let [channels, height, width] = *shape else { panic!("three planes") };
        Image { width, height, channels, values }
    })
}

fn network(bytes: &[u8]) -> Network {
    Network::from_bytes(bytes.to_vec()).unwrap()
}

fn is_close(distance: f64, expected: f64) -> bool {
    (distance - expected).abs() < ROUNDING * expected
}

/// The file with one word replaced by another of equal length.
fn with(bytes: &[u8], word: &str, other: &str) -> Vec<u8> {
    assert_eq!(word.len(), other.len(), "lengths within the file stay as they are");
    let places: Vec<usize> =
        (0..bytes.len() - word.len()).filter(|&place| bytes[place..].starts_with(word.as_bytes())).collect();
    assert!(!places.is_empty(), "{word} is in the file");
    let mut changed = bytes.to_vec();
    places.iter().for_each(|&place| changed[place..place + other.len()].copy_from_slice(other.as_bytes()));
    changed
}

#[test]
fn distances_are_those_of_the_reference_package() {
    let [one, other] = pictures();
    for (bytes, name) in [(VGG, "vgg"), (ALEX, "alex")] {
        let network = network(bytes);
        let expected = f64::from(known(name).1[0]);
        let distance = network.distance(&one, &other).unwrap();
        assert!(is_close(distance, expected), "{name}: {distance}, not {expected}");
        assert!(expected > 1e-3, "the pictures differ");
        assert_eq!(network.distance(&one, &one), Ok(0.0));
    }
}

#[test]
fn distances_depend_on_the_input_range() {
    let [one, other] = pictures();
    let doubled = |image: &Image<Vec<f32>>| Image {
        values: image.values.iter().map(|value| 2.0 * value - 1.0).collect(),
        ..image.clone()
    };
    for (bytes, name) in [(VGG, "vgg"), (ALEX, "alex")] {
        let distance = network(bytes).distance(&doubled(&one), &doubled(&other)).unwrap();
        assert!(!is_close(distance, f64::from(known(name).1[0])), "{name}");
    }
}

#[test]
fn distances_are_symmetric() {
    let network = network(VGG);
    let [one, other] = pictures();
    assert_eq!(network.distance(&one, &other), network.distance(&other, &one));
}

#[test]
fn files_say_which_network_they_hold() {
    assert_eq!(network(VGG).name(), Some("vgg with random weights, lpips 0.1.4, inputs 0..1"));
    assert_eq!(network(ALEX).name(), Some("alex with random weights, lpips 0.1.4, inputs -1..1"));
    assert_eq!(network(&with(VGG, "network", "notwork")).name(), None);
}

#[test]
fn too_small_pictures_have_no_distance() {
    let network = network(VGG);
    let grey = |size: usize| Image { width: size, height: size, channels: 3, values: vec![0.5; 3 * size * size] };
    let refused = network.distance(&grey(15), &grey(15)).unwrap_err().to_string();
    assert!(refused.contains("too small"), "four times half of it is nothing: {refused}");
    assert_eq!(network.distance(&grey(16), &grey(16)), Ok(0.0));
}

#[test]
fn pictures_with_nan_are_refused() {
    let [one, mut other] = pictures();
    other.values[0] = f32::NAN;
    let refused = network(VGG).distance(&one, &other).unwrap_err().to_string();
    assert!(refused.contains("not finite"), "{refused}");
}

/// A file whose layers were altered after export.
fn run_otherwise() -> Vec<u8> {
    with(VGG, "ReduceMean", "ReduceProd")
}

#[test]
fn invalid_network_files_are_refused_with_their_fault() {
    let [no_model, other_layer] = [b"no network".to_vec(), with(VGG, "MaxPool", "MinPool")];
    for (bytes, word) in [(no_model, "not an ONNX model"), (other_layer, "MinPool"), (run_otherwise(), "its check")] {
        let refused = Network::from_bytes(bytes).unwrap_err().to_string();
        assert!(refused.contains(word), "{refused}");
    }
}
