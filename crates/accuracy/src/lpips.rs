//! LPIPS: perceptual distance of two pictures by a network trained for image classification (Zhang
//! et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric").
//!
//! The network is an ONNX file with its weights. Its inputs are two pictures as floats of shape (1,
//! 3, height, width) in sRGB from 0 to 1, its output is one number. Normalisation is part of the
//! file: published tables use networks for colours from −1 to 1 with inputs from 0 to 1.
//! `scripts/lpips-onnx.py` exports such files from the reference package. Their metadata contains
//! the name of the `network` and, as `check`, the distance of the pictures of [`check_pictures`],
//! which is verified on reading.
//!
//! The runtime is rten: a dozen crates that compile in half a minute of a core (one of tract's
//! needs more than three minutes). Tests compare it with values of the reference package, for
//! networks of few channels and random weights. Runtimes also have bugs: rten 0.24 rounded the
//! windows of SqueezeNet wrongly, an error of 1 %. Network files therefore contain a check that is
//! computed on loading.

use crate::wire;
use core::fmt;
use rten::{Dimension, Model, NodeId};
use rten_tensor::{AsView, NdTensorView, Tensor};
use specula_core::scene::Image;

/// Fault of a network file or of its output, as the end of a sentence about the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unfit(String);

impl fmt::Display for Unfit {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(out)
    }
}

impl core::error::Error for Unfit {}

/// Tolerance of the check: summation in another order has a hundredth of this error, a window
/// rounded the wrong way ten times as much.
const CHECK: f64 = 1e-3;

/// A network with its weights.
#[derive(Debug)]
pub struct Network {
    model: Model,
    pictures: [NodeId; 2],
    distance: NodeId,
}

impl Network {
    /// Reads a network from the bytes of a file.
    ///
    /// # Errors
    ///
    /// The fault of the file.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Self, Unfit> {
        wire::check(&bytes).map_err(|what| Unfit(format!("it is not an ONNX model: {what}")))?;
        let model = Model::load(bytes).map_err(|error| Unfit(format!("it is not an ONNX model: {error}")))?;
        let (&[one, other], &[distance]) = (model.input_ids(), model.output_ids()) else {
            let [pictures, numbers] = [model.input_ids().len(), model.output_ids().len()];
            return Err(Unfit(format!(
                "it has {pictures} inputs and {numbers} outputs, not two pictures and a distance"
            )));
        };
        for input in 0..2 {
            let shape = model.input_shape(input);
            if let Some(shape) = shape.filter(|shape| !takes_colors(shape)) {
                return Err(Unfit(format!("an input has the shape {}, not (1, 3, height, width)", words_of(&shape))));
            }
        }
        let network = Self { model, pictures: [one, other], distance };
        network.check()?;
        Ok(network)
    }

    /// Compares the network's distance of the check pictures with the file's.
    fn check(&self) -> Result<(), Unfit> {
        let Some(word) = self.model.metadata().get("check") else { return Ok(()) };
        let expected: f64 = word.parse().map_err(|_| Unfit(format!("its check {word:?} is not a number")))?;
        let [one, other] = check_pictures();
        let distance = self.distance(&one, &other)?;
        if (distance - expected).abs() <= CHECK * expected.abs() {
            return Ok(());
        }
        Err(Unfit(format!("it returns {distance} for its check pictures instead of {expected}")))
    }

    /// Name and input range of the network, if the file states them.
    pub fn name(&self) -> Option<&str> {
        self.model.metadata().get("network")
    }

    /// Distance of two pictures of equal size, three sRGB planes in \[0, 1\] each: 0 for equal
    /// pictures, about 1 for unrelated ones.
    ///
    /// # Errors
    ///
    /// Pictures that are too small for the last layer, have a size that the network does not
    /// accept, or numbers that are not finite; output other than one finite number.
    pub fn distance(&self, one: &Image<Vec<f32>>, other: &Image<Vec<f32>>) -> Result<f64, Unfit> {
        assert_eq!([one.width, one.height], [other.width, other.height], "pictures of equal size are compared");
        // Max-pooling layers drop NaN.
        if !one.values.iter().chain(&other.values).all(|value| value.is_finite()) {
            return Err(Unfit("a picture has colours that are not finite".into()));
        }
        let [one, other] = [one, other]
            .map(|image| NdTensorView::from_data([1, 3, image.height, image.width], &image.values[..]).into());
        let inputs = vec![(self.pictures[0], one), (self.pictures[1], other)];
        let [distance] =
            self.model.run_n(inputs, [self.distance], None).map_err(|error| Unfit(format!("it fails: {error}")))?;
        let numbers = Tensor::<f32>::try_from(distance).map(|tensor| tensor.to_vec()).unwrap_or_default();
        match numbers[..] {
            [number] if number.is_finite() => Ok(f64::from(number)),
            [number] => Err(Unfit(format!("it returns {number} for two pictures"))),
            _ => Err(Unfit(format!("it returns {} numbers for two pictures, not one", numbers.len()))),
        }
    }
}

/// Two test pictures of odd sizes, so that pooling windows have remainders: with x, y and channel c
/// from 0, (7 x + 13 y + 29 c mod 64) / 63 and (11 x + 5 y + 17 c mod 64) / 63.
pub fn check_pictures() -> [Image<Vec<f32>>; 2] {
    let [width, height, channels] = [67, 51, 3];
    [[7, 13, 29], [11, 5, 17]].map(|[by_x, by_y, by_channel]| {
        let value = |place: usize| {
            let [x, y, channel] = [place % width, place / width % height, place / width / height];
            ((by_x * x + by_y * y + by_channel * channel) % 64) as f32 / 63.0
        };
        Image { width, height, channels, values: (0..width * height * channels).map(value).collect() }
    })
}

/// Returns whether the network accepts pictures of three channels.
fn takes_colors(shape: &[Dimension]) -> bool {
    let may_be = |size: &Dimension, wanted: usize| match size {
        Dimension::Fixed(size) => *size == wanted,
        Dimension::Symbolic(_) => true,
    };
    matches!(shape, [count, colors, _, _] if may_be(count, 1) && may_be(colors, 3))
}

fn words_of(shape: &[Dimension]) -> String {
    let words = shape.iter().map(|size| match size {
        Dimension::Fixed(size) => size.to_string(),
        Dimension::Symbolic(name) => name.clone(),
    });
    format!("({})", words.collect::<Vec<_>>().join(", "))
}
