//! A view as it is measured, and as a page shows it.

use crate::{
    background::Background,
    quality::{FLIP, Measured},
};
use specula_accuracy::flip::flip_map;
use specula_core::{metrics::quantize, scene::Image};
use specula_io::picture::{self, RgbImage};
use specula_train::{
    evaluate::{Pair, measure_pair},
    view::View,
};

/// Mean error of a pixel, of 0 to 1, that is shown in the brightest colour.
pub(super) const ERROR_SHOWN: f32 = 0.25;
/// Pixels along the longer edge of a picture on the page, at most.
pub(super) const EDGE: u32 = 320;
/// Of JPEGs on the page.
const JPEG_QUALITY: u8 = 88;

/// A view, measured.
#[derive(Debug)]
pub(super) struct Seen {
    pub(super) measured: Measured,
    /// Pixels of the view.
    pub(super) size: [u32; 2],
    /// Truth, picture and error as JPEGs for the page; none where there is none.
    pub(super) pictures: Option<[Vec<u8>; 3]>,
}

impl Seen {
    pub(super) fn new(view: &View, image: &Image<Vec<f32>>, background: Background, with_pictures: bool) -> Self {
        let pair = Pair::new(image, view, background.0);
        let mut measured: Measured = measure_pair(&pair, image, view).into();
        measured.values[FLIP] = Some(flip_of_known(&pair));
        let size = [view.camera.width, view.camera.height];
        Self { measured, size, pictures: with_pictures.then(|| pictures_of(&pair, size)) }
    }
}

/// Mean ꟻLIP of 8-bit pictures over the pixels that are known.
fn flip_of_known(pair: &Pair) -> f64 {
    let shown = |planes: &[f32]| {
        let values = planes.iter().map(|value| f64::from(quantize(*value)) / 255.0).collect();
        Image { width: pair.width, height: planes.len() / (3 * pair.width.max(1)), channels: 3, values }
    };
    let map = flip_map(&shown(&pair.truth), &shown(&pair.rendered));
    let is_known = |pixel: usize| pair.known.as_ref().is_none_or(|known| known[pixel]);
    let known: Vec<f64> = (0..map.len()).filter(|pixel| is_known(*pixel)).map(|pixel| map[pixel]).collect();
    known.iter().sum::<f64>() / known.len().max(1) as f64
}

fn pictures_of(pair: &Pair, [width, height]: [u32; 2]) -> [Vec<u8>; 3] {
    let [truth, ours] =
        [&pair.truth, &pair.rendered].map(|planes| picture::rgb(width as usize, height as usize, planes));
    let error = picture::error_map(&ours, &truth, ERROR_SHOWN);
    [truth, ours, error].map(|image: RgbImage| picture::to_jpeg(&picture::within(&image, EDGE), JPEG_QUALITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_does_not_flip() {
        /// So far that no window reaches from one half to the other.
        const WIDTH: usize = 96;
        let planes = |right: f32| -> Vec<f32> {
            (0..3 * WIDTH * 4).map(|k| if k % WIDTH < WIDTH / 4 { 0.5 } else { right }).collect()
        };
        let pair = |known| Pair { width: WIDTH, rendered: planes(1.0), truth: planes(0.0), known };
        let left = (0..WIDTH * 4).map(|k| k % WIDTH < WIDTH / 8).collect();
        assert!(flip_of_known(&pair(None)) > 0.5);
        assert!(flip_of_known(&pair(Some(left))) < 1e-3);
    }
}
