//! Measures of a view, and its pictures on a page.

use crate::measure::{FLIP, MAE_WEIGHTED, ViewMeasures};
use specula_accuracy::flip::flip_map;
use specula_core::{metrics::quantize, scene::Image};
use specula_io::picture::{self, RgbImage};
use specula_train::{
    evaluate::{Pair, measure_pair, weighted_normal_error},
    view::View,
};

/// Mean error that maps to the brightest colour, on a scale from 0 to 1.
pub(super) const ERROR_MAX: f32 = 0.25;
/// Maximum pixels along the longer edge of a picture on the page.
pub(super) const EDGE_MAX: u32 = 320;
/// Quality of JPEGs on the page.
const JPEG_QUALITY: u8 = 88;

/// View with its measures.
#[derive(Debug)]
pub struct EvaluatedView {
    /// Measures of the view.
    pub measures: ViewMeasures,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// JPEGs of ground truth, rendering and error for the page.
    pub pictures: Option<[Vec<u8>; 3]>,
}

impl EvaluatedView {
    /// Measures a rendered view over a background: PSNR, SSIM, ꟻLIP, and normals in two ways where
    /// they are known.
    pub fn new(view: &View, image: &Image<Vec<f32>>, background: [f32; 3], with_pictures: bool) -> Self {
        let pair = Pair::new(image, view, background);
        let mut measures: ViewMeasures = measure_pair(&pair, image, view).into();
        measures.values[FLIP] = Some(mean_flip(&pair));
        measures.values[MAE_WEIGHTED] = weighted_normal_error(image, view);
        let size = [view.camera.width, view.camera.height];
        Self { measures, size, pictures: with_pictures.then(|| jpegs(&pair, size)) }
    }
}

/// Mean ꟻLIP of 8-bit pictures over known pixels.
fn mean_flip(pair: &Pair) -> f64 {
    let quantized = |planes: &[f32]| {
        let values = planes.iter().map(|value| f64::from(quantize(*value)) / 255.0).collect();
        Image { width: pair.width, height: planes.len() / (3 * pair.width.max(1)), channels: 3, values }
    };
    let map = flip_map(&quantized(&pair.truth), &quantized(&pair.rendered));
    let is_known = |pixel: usize| pair.known.as_ref().is_none_or(|known| known[pixel]);
    let known: Vec<f64> = (0..map.len()).filter(|pixel| is_known(*pixel)).map(|pixel| map[pixel]).collect();
    known.iter().sum::<f64>() / known.len().max(1) as f64
}

fn jpegs(pair: &Pair, [width, height]: [u32; 2]) -> [Vec<u8>; 3] {
    let [truth, rendered] =
        [&pair.truth, &pair.rendered].map(|planes| picture::rgb(width as usize, height as usize, planes));
    let error = picture::error_map(&rendered, &truth, ERROR_MAX);
    [truth, rendered, error].map(|image: RgbImage| picture::to_jpeg(&picture::within(&image, EDGE_MAX), JPEG_QUALITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_pixels_do_not_count_in_flip() {
        /// Distance beyond which no window spans both halves.
        const WIDTH: usize = 96;
        let planes = |right: f32| -> Vec<f32> {
            (0..3 * WIDTH * 4).map(|k| if k % WIDTH < WIDTH / 4 { 0.5 } else { right }).collect()
        };
        let pair = |known| Pair { width: WIDTH, rendered: planes(1.0), truth: planes(0.0), known };
        let left = (0..WIDTH * 4).map(|k| k % WIDTH < WIDTH / 8).collect();
        assert!(mean_flip(&pair(None)) > 0.5);
        assert!(mean_flip(&pair(Some(left))) < 1e-3);
    }
}
