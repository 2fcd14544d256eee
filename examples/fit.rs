//! A picture as Gaussians, under a loss of one's own: `fit PICTURE OUT.png [STEPS]`.
//!
//! The loss is that of Charbonnier, √(d² + ε²) of the differences d, which no profile of a training
//! has: only its cotangent goes to the rasteriser.

use core::error::Error;
use specula_core::{activation::sigmoid, random};
use specula_io::{
    picture::{self, RgbImage},
    pixels::Pixels,
};
use specula_kit::{Colors, Cotangents, Images, Inputs, Options, PinholeView, Rasterizer};
use std::path::Path;

/// ε of the loss.
const EPSILON: f32 = 1e-3;
/// Gaussians.
const COUNT: usize = 1500;
/// Learning rate of all numbers.
const RATE: f32 = 0.02;

/// Adam's running means of a column.
#[derive(Default)]
struct Adam(Vec<[f32; 2]>);

impl Adam {
    /// Step `number`, from 1, of a column.
    fn step(&mut self, number: i32, values: &mut [f32], grads: impl IntoIterator<Item = f32>) {
        self.0.resize(values.len(), [0.0; 2]);
        for ((value, [mean, square]), grad) in values.iter_mut().zip(&mut self.0).zip(grads) {
            *mean += 0.1 * (grad - *mean);
            *square += 0.001 * (grad * grad - *square);
            let size = (*square / (1.0 - 0.999_f32.powi(number))).sqrt() + 1e-12;
            *value -= RATE * *mean / (1.0 - 0.9_f32.powi(number)) / size;
        }
    }
}

/// Fits Gaussians in a plane to a picture, three numbers a pixel; `progress` hears of the mean loss
/// of each step.
fn fit(
    target: &[f32],
    [width, height]: [u32; 2],
    count: usize,
    steps: i32,
    mut progress: impl FnMut(i32, f32),
) -> Result<Images, Box<dyn Error>> {
    let draw = |k: usize, index: u64| 2.0 * random::uniform(0, k as u64, index) - 1.0;
    let mut means: Vec<[f32; 3]> = (0..count).map(|k| [draw(k, 0), draw(k, 1), 2.0]).collect();
    let mut quats = vec![[1.0, 0.0, 0.0, 0.0]; count];
    let mut log_scales = vec![[-0.5 * (count as f32).ln(); 3]; count];
    let mut logits = vec![0.0; count];
    let mut colors = vec![[0.5; 3]; count];

    let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let [w, h] = [width as f32, height as f32];
    let intrinsics = [[w, 0.0, 0.5 * w], [0.0, h, 0.5 * h], [0.0, 0.0, 1.0]];
    let view = PinholeView { view_matrix: identity, intrinsics, width, height, background: [0.0; 3] };
    let mut rasterizer = Rasterizer::new(Options::default());
    let mut adam: [Adam; 5] = Default::default();
    for number in 1.. {
        let scales: Vec<[f32; 3]> = log_scales.iter().map(|row| row.map(f32::exp)).collect();
        let opacities: Vec<f32> = logits.iter().map(|x| sigmoid(*x)).collect();
        let inputs = Inputs {
            means: &means,
            quats: &quats,
            scales: &scales,
            opacities: &opacities,
            colors: Colors::Rgb(&colors),
        };
        let (mut images, context) = rasterizer.forward(&inputs, &[view])?;
        let image = images.remove(0);
        if number > steps {
            return Ok(image);
        }
        let loss = |d: f32| (d * d + EPSILON * EPSILON).sqrt();
        let differences = || image.rgb.iter().zip(target).map(|(drawn, wanted)| drawn - wanted);
        let share = 1.0 / target.len() as f32;
        progress(number, differences().map(loss).sum::<f32>() * share);
        let rgb: Vec<f32> = differences().map(|d| share * d / loss(d)).collect();
        let grad = rasterizer.backward(&context, &[Cotangents { rgb: &rgb, ..Cotangents::default() }])?;

        let grad_logits = grad.opacities.iter().zip(&opacities).map(|(grad, p)| grad * p * (1.0 - p));
        let grad_logs = grad.scales.as_flattened().iter().zip(scales.as_flattened()).map(|(grad, s)| grad * s);
        adam[0].step(number, means.as_flattened_mut(), grad.means.as_flattened().iter().copied());
        adam[1].step(number, quats.as_flattened_mut(), grad.quats.as_flattened().iter().copied());
        adam[2].step(number, log_scales.as_flattened_mut(), grad_logs);
        adam[3].step(number, &mut logits, grad_logits);
        adam[4].step(number, colors.as_flattened_mut(), grad.colors.as_flattened().iter().copied());
    }
    unreachable!("the last step returns")
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, place, rest @ ..] = arguments.as_slice() else {
        println!("fit PICTURE OUT.png [STEPS]");
        return Ok(());
    };
    let steps = rest.first().map_or(Ok(300), |number| number.parse())?;
    let picture = Pixels::read(Path::new(source))?;
    let rgb = picture.rgba.chunks_exact(4).flat_map(|pixel| &pixel[..3]);
    let target: Vec<f32> = rgb.map(|byte| f32::from(*byte) / 255.0).collect();
    let image = fit(&target, [picture.width, picture.height], COUNT, steps, |number, loss| {
        println!("{number} of {steps}: {loss:.4}");
    })?;
    let bytes = image.rgb.iter().map(|x| (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8).collect();
    let image = RgbImage::from_raw(picture.width, picture.height, bytes).ok_or("three bytes a pixel")?;
    picture::write(Path::new(place), &image)?;
    Ok(())
}

#[test]
fn a_disc_is_fitted() {
    let inside = |k: usize| (k % 24).abs_diff(12).pow(2) + (k / 24).abs_diff(12).pow(2) < 64;
    let target: Vec<f32> =
        (0..24 * 24).flat_map(|k| if inside(k) { [0.9, 0.4, 0.1] } else { [0.1, 0.2, 0.3] }).collect();
    let mut losses = Vec::new();
    fit(&target, [24; 2], 80, 80, |_, loss| losses.push(loss)).unwrap();
    assert!(losses[79] < 0.25 * losses[0], "{losses:?}");
}
