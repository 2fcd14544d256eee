//! LPIPS: how different two pictures look to a network that was trained to name what is in pictures (Zhang et al. 2018,
//! "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric").
//!
//! Both pictures go through the network. After some of its layers the features of every pixel, made unit vectors over
//! the channels, are subtracted, squared, weighted by channel and averaged over the pixels; the sum over these layers is
//! the distance. Which network it is, and which weights, a file says: safetensors with
//!
//! ```text
//! __metadata__: layers    words in order: conv:PADDING:STRIDE, relu, pool:SIZE:STRIDE, tap (features are compared here)
//!               inputs    0..1 (pictures go in as they are) or -1..1 (2 x - 1)
//!               network   what to call it beside results
//! shift, scale            [3], subtracted from colours and divided by
//! conv.K.weight, .bias    [out, in, size, size] and [out], of the K-th convolution
//! lin.K                   [channels], weights of the K-th tap
//! ```

use core::fmt;
use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};
use rayon::prelude::*;
use safetensors::{Dtype, SafeTensors};
use specula_core::scene::Image;
use std::collections::HashMap;

/// Pixels that are computed side by side: two of the widest usual vectors.
const ACROSS: usize = 16;
/// Channels that are computed side by side; with the pixels they fill the registers.
const DOWN: usize = 4;
/// Added to the length of features, so that none is divided by zero; the authors' number.
const LENGTH_MIN: f32 = 1e-10;

/// Why a file is no network: what to say behind its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unreadable(String);

impl fmt::Display for Unreadable {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(out)
    }
}

impl core::error::Error for Unreadable {}

/// A network with its weights.
#[derive(Clone, Debug)]
pub struct Network {
    name: String,
    /// What 0 and 1 become before they go in.
    inputs: [f32; 2],
    shift: [f32; 3],
    scale: [f32; 3],
    layers: Vec<Layer>,
}

#[derive(Clone, Debug)]
enum Layer {
    Convolution(Convolution),
    /// Negative numbers become zero.
    Rectify,
    /// The largest of a square.
    Pool {
        size: usize,
        stride: usize,
    },
    /// Features are compared, with these weights of the channels.
    Tap(Vec<f32>),
}

/// Square windows over all channels.
#[derive(Clone, Debug)]
struct Convolution {
    channels: [usize; 2],
    size: usize,
    padding: usize,
    stride: usize,
    /// For [`DOWN`] outputs at a time: for each number of a window their weights side by side.
    weights: Vec<f32>,
    bias: Vec<f32>,
}

/// Numbers of every pixel and channel: for each row and each channel of it the pixels from the left.
#[derive(Clone, Debug)]
struct Features {
    width: usize,
    height: usize,
    channels: usize,
    values: Vec<f32>,
}

impl Network {
    /// Reads a network from the bytes of its file.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Unreadable> {
        let wrong = |what: String| Unreadable(what);
        let file = SafeTensors::deserialize(bytes).map_err(|error| wrong(format!("it is no safetensors: {error}")))?;
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| wrong(error.to_string()))?;
        let said: HashMap<String, String> = header.metadata().clone().unwrap_or_default();
        let word = |key: &str| said.get(key).ok_or_else(|| wrong(format!("its metadata have no {key:?}")));
        let inputs = match word("inputs")?.as_str() {
            "0..1" => [0.0, 1.0],
            "-1..1" => [-1.0, 1.0],
            other => return Err(wrong(format!("inputs {other:?} are neither 0..1 nor -1..1"))),
        };
        let [shift, scale] = ["shift", "scale"].map(|name| {
            let (_, values) = tensor(&file, name)?;
            <[f32; 3]>::try_from(values).map_err(|_| wrong(format!("{name} has not three numbers")))
        });
        let name = format!("{}, inputs {}", word("network")?, word("inputs")?);
        Ok(Self { name, inputs, shift: shift?, scale: scale?, layers: layers_of(&file, word("layers")?)? })
    }

    /// Which network it is, and what goes in.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Distance of two pictures of equal size, three planes of sRGB in \[0, 1\] each: 0 for equal ones, about 1 for those
    /// that have nothing in common. None where pictures are so small that nothing of them reaches the last layer.
    pub fn distance(&self, one: &Image<Vec<f32>>, other: &Image<Vec<f32>>) -> Option<f64> {
        assert_eq!([one.width, one.height], [other.width, other.height], "pictures of equal size are compared");
        let mut both = [one, other].map(|image| self.input(image));
        let mut sum = 0.0;
        for layer in &self.layers {
            if let Layer::Tap(weights) = layer {
                let [one, other] = &both;
                sum += distance_of_features(one, other, weights);
            } else {
                let [one, other] = both;
                both = [layer.apply(one)?, layer.apply(other)?];
            }
        }
        Some(sum)
    }

    fn input(&self, image: &Image<Vec<f32>>) -> Features {
        let Image { width, height, .. } = *image;
        let [low, high] = self.inputs;
        let mut values = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            for channel in 0..3 {
                let colors = &image.plane(channel)[row * width..(row + 1) * width];
                let [shift, scale] = [self.shift[channel], self.scale[channel]];
                values.extend(colors.iter().map(|color| (low + (high - low) * color - shift) / scale));
            }
        }
        Features { width, height, channels: 3, values }
    }
}

/// Numbers of a tensor, and its shape.
fn tensor(file: &SafeTensors<'_>, name: &str) -> Result<(Vec<usize>, Vec<f32>), Unreadable> {
    let view = file.tensor(name).map_err(|_| Unreadable(format!("it has no tensor {name:?}")))?;
    if view.dtype() != Dtype::F32 {
        return Err(Unreadable(format!("{name} is not of 32-bit floats")));
    }
    let (numbers, _) = view.data().as_chunks::<4>();
    Ok((view.shape().to_vec(), numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()))
}

/// The layers that the words name; each has as many channels as the one before gives.
fn layers_of(file: &SafeTensors<'_>, words: &str) -> Result<Vec<Layer>, Unreadable> {
    let (mut channels, mut convolutions, mut taps) = (3, 0, 0);
    let mut layers = Vec::new();
    for word in words.split_whitespace() {
        let wrong = |what: &str| Unreadable(format!("layer {word:?} {what}"));
        let mut parts = word.split(':');
        let kind = parts.next().unwrap_or_default();
        let numbers: Option<Vec<usize>> = parts.map(|part| part.parse().ok()).collect();
        layers.push(match (kind, numbers.as_deref()) {
            ("conv", Some([padding, stride])) if *stride > 0 => {
                let convolution = Convolution::read(file, convolutions, [*padding, *stride])?;
                if convolution.channels[0] != channels {
                    return Err(wrong("does not take what the one before gives"));
                }
                channels = convolution.channels[1];
                convolutions += 1;
                Layer::Convolution(convolution)
            }
            ("relu", Some([])) => Layer::Rectify,
            ("pool", Some([size, stride])) if *size > 0 && *stride > 0 => Layer::Pool { size: *size, stride: *stride },
            ("tap", Some([])) => {
                let (_, weights) = tensor(file, &format!("lin.{taps}"))?;
                if weights.len() != channels {
                    return Err(wrong("has not a weight for each channel"));
                }
                taps += 1;
                Layer::Tap(weights)
            }
            _ => return Err(wrong("is none of conv:PADDING:STRIDE, relu, pool:SIZE:STRIDE, tap")),
        });
    }
    if taps == 0 { Err(Unreadable("nothing is compared in it".into())) } else { Ok(layers) }
}

impl Layer {
    /// What comes out; none where nothing is left of a picture.
    fn apply(&self, features: Features) -> Option<Features> {
        match self {
            Self::Convolution(convolution) => convolution.apply(&features),
            Self::Rectify => Some(features.rectified()),
            Self::Pool { size, stride } => features.pooled(*size, *stride),
            Self::Tap(_) => Some(features),
        }
    }
}

/// How many windows of a size fit side by side.
fn windows(length: usize, size: usize, stride: usize) -> Option<usize> {
    Some(length.checked_sub(size)? / stride + 1)
}

impl Features {
    fn row(&self, row: usize) -> &[f32] {
        let len = self.channels * self.width;
        &self.values[row * len..(row + 1) * len]
    }

    fn rectified(mut self) -> Self {
        self.values.par_iter_mut().for_each(|value| *value = value.max(0.0));
        self
    }

    fn pooled(&self, size: usize, stride: usize) -> Option<Self> {
        let [width, height] = [windows(self.width, size, stride)?, windows(self.height, size, stride)?];
        let mut values = vec![f32::NEG_INFINITY; self.channels * width * height];
        values.par_chunks_mut(self.channels * width).enumerate().for_each(|(row, out)| {
            for line in row * stride..row * stride + size {
                for (source, out) in self.row(line).chunks(self.width).zip(out.chunks_mut(width)) {
                    for (column, out) in out.iter_mut().enumerate() {
                        let window = &source[column * stride..column * stride + size];
                        *out = window.iter().copied().fold(*out, f32::max);
                    }
                }
            }
        });
        Some(Self { width, height, channels: self.channels, values })
    }

    /// With zeros around, and on the right so many more that windows of [`ACROSS`] pixels stay within.
    fn padded(&self, padding: usize, width: usize) -> Self {
        let height = self.height + 2 * padding;
        let mut values = vec![0.0; self.channels * width * height];
        let rows = values.par_chunks_mut((self.channels * width).max(1)).skip(padding).take(self.height).enumerate();
        rows.for_each(|(row, out)| {
            for (source, out) in self.row(row).chunks(self.width).zip(out.chunks_mut(width)) {
                out[padding..padding + self.width].copy_from_slice(source);
            }
        });
        Self { width, height, channels: self.channels, values }
    }

    /// Reciprocal lengths of the features of a row's pixels.
    fn shares_of_row(&self, row: usize) -> Vec<f32> {
        let mut squares = vec![0.0_f32; self.width];
        for plane in self.row(row).chunks(self.width) {
            squares.iter_mut().zip(plane).for_each(|(sum, value)| *sum += value * value);
        }
        squares.iter().map(|square| 1.0 / (square.sqrt() + LENGTH_MIN)).collect()
    }
}

/// Mean over the pixels of Σ weight · (unit feature − unit feature)², row after row.
fn distance_of_features(one: &Features, other: &Features, weights: &[f32]) -> f64 {
    let of_row = |row: usize| {
        let shares = [one, other].map(|features| features.shares_of_row(row));
        let planes = one.row(row).chunks(one.width).zip(other.row(row).chunks(one.width));
        let of_plane = |((one, other), weight): ((&[f32], &[f32]), &f32)| {
            let pixels = one.iter().zip(&shares[0]).zip(other.iter().zip(&shares[1]));
            let squares = pixels.map(|((a, p), (b, q))| f64::from(a * p - b * q).powi(2));
            f64::from(*weight) * squares.sum::<f64>()
        };
        planes.zip(weights).map(of_plane).sum::<f64>()
    };
    let rows: Vec<f64> = (0..one.height).into_par_iter().map(of_row).collect();
    rows.iter().sum::<f64>() / (one.width * one.height).max(1) as f64
}

impl Convolution {
    fn read(file: &SafeTensors<'_>, number: usize, [padding, stride]: [usize; 2]) -> Result<Self, Unreadable> {
        let name = |what: &str| format!("conv.{number}.{what}");
        let (shape, weights) = tensor(file, &name("weight"))?;
        let (_, bias) = tensor(file, &name("bias"))?;
        let wrong = || Unreadable(format!("{} is not of square windows with a bias for each", name("weight")));
        let [out, into, size, same] = <[usize; 4]>::try_from(shape).map_err(|_| wrong())?;
        if size != same || size == 0 || bias.len() != out {
            return Err(wrong());
        }
        let window = into * size * size;
        let group = |first: usize| {
            let weight = |tap: usize, down: usize| weights.get((first + down) * window + tap).copied();
            let weights = &weight;
            (0..window).flat_map(move |tap| (0..DOWN).map(move |down| weights(tap, down).unwrap_or(0.0))).collect()
        };
        let groups: Vec<Vec<f32>> = (0..out).step_by(DOWN).map(group).collect();
        Ok(Self { channels: [into, out], size, padding, stride, weights: groups.concat(), bias })
    }

    fn apply(&self, features: &Features) -> Option<Features> {
        let Self { size, padding, stride, channels: [_, channels], .. } = *self;
        let [width, height] =
            [features.width, features.height].map(|length| windows(length + 2 * padding, size, stride));
        let (width, height) = (width?, height?);
        let reach = (width.next_multiple_of(ACROSS) - 1) * stride + size;
        let padded = features.padded(padding, reach.max(features.width + 2 * padding));
        let mut values = vec![0.0; channels * width * height];
        let level = Level::new();
        values.par_chunks_mut(channels * width).enumerate().for_each(|(row, out)| {
            dispatch!(level, simd => self.row(simd, &padded, row, width, out));
        });
        Some(Features { width, height, channels, values })
    }

    /// A row of results, [`ACROSS`] pixels at a time.
    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, padded: &Features, row: usize, width: usize, out: &mut [f32]) {
        let window = self.channels[0] * self.size * self.size;
        let mut patch = vec![[0.0; ACROSS]; window];
        for first in (0..width).step_by(ACROSS) {
            self.gather(padded, row, first, &mut patch);
            let kept = (width - first).min(ACROSS);
            for (group, weights) in self.weights.chunks_exact(DOWN * window).enumerate() {
                let sums = products(simd, weights, &patch);
                let channels = (DOWN * group..self.channels[1]).zip(&sums);
                for (channel, sums) in channels {
                    let place = channel * width + first;
                    for (out, sum) in out[place..place + kept].iter_mut().zip(sums) {
                        *out = sum + self.bias[channel];
                    }
                }
            }
        }
    }

    /// What windows of neighbouring pixels see: each number of a window of all of them side by side.
    fn gather(&self, padded: &Features, row: usize, first: usize, patch: &mut [[f32; ACROSS]]) {
        let square = self.size * self.size;
        for (tap, out) in patch.iter_mut().enumerate() {
            let (channel, y, x) = (tap / square, tap % square / self.size, tap % self.size);
            let line = padded.row(row * self.stride + y);
            let source = &line[channel * padded.width + first * self.stride + x..];
            match self.stride {
                1 => out.copy_from_slice(&source[..ACROSS]),
                stride => out.iter_mut().zip(source.iter().step_by(stride)).for_each(|(out, value)| *out = *value),
            }
        }
    }
}

/// Σ weight · number over a window, for some channels and pixels at once.
#[inline(always)]
fn products<S: Simd>(simd: S, weights: &[f32], patch: &[[f32; ACROSS]]) -> [[f32; ACROSS]; DOWN] {
    let zero = f32x16::splat(simd, 0.0);
    let (mut a, mut b, mut c, mut d) = (zero, zero, zero, zero);
    let (weights, _) = weights.as_chunks::<DOWN>();
    for (weights, numbers) in weights.iter().zip(patch) {
        let numbers = f32x16::simd_from(simd, *numbers);
        a = numbers.mul_add(f32x16::splat(simd, weights[0]), a);
        b = numbers.mul_add(f32x16::splat(simd, weights[1]), b);
        c = numbers.mul_add(f32x16::splat(simd, weights[2]), c);
        d = numbers.mul_add(f32x16::splat(simd, weights[3]), d);
    }
    [a.into(), b.into(), c.into(), d.into()]
}
