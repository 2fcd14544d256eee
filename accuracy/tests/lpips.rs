//! LPIPS against the reference package, with networks of a few channels and random weights that
//! `scripts/lpips-weights.py --test` made of it, and what the package makes of two pictures.

use safetensors::SafeTensors;
use specula_accuracy::lpips::Network;
use specula_core::scene::Image;

/// Sums of at most 288 products in another order, thirteen layers deep, as a share of the distance.
const ROUNDING: f64 = 1e-5;

const VGG: &[u8] = include_bytes!("data/lpips-vgg.safetensors");
const ALEX: &[u8] = include_bytes!("data/lpips-alex.safetensors");

fn numbers(bytes: &[u8], name: &str) -> Vec<f32> {
    let file = SafeTensors::deserialize(bytes).unwrap();
    let (numbers, _) = file.tensor(name).unwrap().data().as_chunks::<4>();
    numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

fn picture(bytes: &[u8], name: &str) -> Image<Vec<f32>> {
    let file = SafeTensors::deserialize(bytes).unwrap();
    let [channels, height, width] = *file.tensor(name).unwrap().shape() else { panic!("three planes") };
    Image { width, height, channels, values: numbers(bytes, name) }
}

/// The same file with other words in its header, which stay as long as they were.
fn with(bytes: &[u8], words: &str, others: &str) -> Vec<u8> {
    assert_eq!(words.len(), others.len(), "lengths of the header stay as they are");
    let place = bytes.windows(words.len()).position(|window| window == words.as_bytes()).unwrap();
    [&bytes[..place], others.as_bytes(), &bytes[place + words.len()..]].concat()
}

#[test]
fn distances_are_those_of_the_reference_package() {
    for bytes in [VGG, ALEX] {
        let [one, other] = ["test.one", "test.other"].map(|name| picture(bytes, name));
        let as_it_is = with(bytes, "\"inputs\": \"0..1\", ", "\"inputs\":\"0..1\",  ");
        let doubled = with(bytes, "\"inputs\": \"0..1\", ", "\"inputs\":\"-1..1\", ");
        for (file, name) in [(as_it_is, "test.0..1"), (doubled, "test.-1..1")] {
            let network = Network::from_bytes(&file).unwrap();
            let expected = f64::from(numbers(bytes, name)[0]);
            let distance = network.distance(&one, &other).unwrap();
            assert!(
                (distance - expected).abs() < ROUNDING * expected,
                "{}: {distance}, not {expected}",
                network.name()
            );
            assert!(expected > 1e-3, "the pictures differ");
            assert_eq!(network.distance(&one, &one), Some(0.0));
        }
        let [as_it_is, doubled] = ["test.0..1", "test.-1..1"].map(|name| f64::from(numbers(bytes, name)[0]));
        assert!((as_it_is - doubled).abs() > 100.0 * ROUNDING * doubled, "what goes in matters");
    }
}

#[test]
fn it_is_the_same_whichever_picture_comes_first() {
    let network = Network::from_bytes(VGG).unwrap();
    let [one, other] = ["test.one", "test.other"].map(|name| picture(VGG, name));
    assert_eq!(network.distance(&one, &other), network.distance(&other, &one));
}

#[test]
fn what_is_too_small_has_no_distance() {
    let network = Network::from_bytes(VGG).unwrap();
    let grey = |size: usize| Image { width: size, height: size, channels: 3, values: vec![0.5; 3 * size * size] };
    assert_eq!(network.distance(&grey(15), &grey(15)), None, "four times half of it is nothing");
    assert_eq!(network.distance(&grey(16), &grey(16)), Some(0.0));
}

#[test]
fn what_is_no_network_is_refused_with_what_is_wrong() {
    for (bytes, word) in [
        (b"no network".to_vec(), "safetensors"),
        (with(VGG, "\"inputs\": \"0..1\"", "\"inputs\": \"0..2\""), "0..2"),
        (with(VGG, "conv:1:1 relu tap pool:2:2", "conv:1:0 relu tap pool:2:2"), "conv:1:0"),
        (with(VGG, "\"lin.4\"", "\"lin.9\""), "lin.4"),
        (with(VGG, "\"conv.0.bias\"", "\"conv.x.bias\""), "conv.0.bias"),
        (with(VGG, "relu tap pool", "relu top pool"), "top"),
    ] {
        let refused = Network::from_bytes(&bytes).unwrap_err().to_string();
        assert!(refused.contains(word), "{refused}");
    }
}
