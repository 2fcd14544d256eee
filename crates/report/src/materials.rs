//! Albedo, roughness and metalness of physical materials against ground truth.
//!
//! Light and albedo are known only up to a factor per colour channel: the albedo is compared after
//! the factors of linear red, green and blue that fit the ground truth best in the least-squares
//! sense, over all views together:
//!
//! ```text
//! f_c = Σ a_c t_c / Σ a_c²          a rendered, t true, linear, over pixels with a true albedo
//! ```
//!
//! The PSNR is that of sRGB-encoded colours of 8 bits, after scaling and clipping in linear light.
//! Roughness is perceptual on both sides, the square root of α of GGX.

use crate::measure::{ALBEDO_PSNR, METALNESS_ERROR, ROUGHNESS_ERROR, Values, ViewMeasures};
use core::borrow::Borrow;
use specula_core::{
    camera::Camera,
    color::{linear_from_srgb, srgb_from_linear},
    metrics::{psnr, quantize},
    rules::{Channels, channel},
    scene::Image,
    shade_pixels::COVERAGE_MIN,
};
use specula_io::{
    materials::{ALPHA_MIN, Materials},
    pixels::Pixels,
};
use specula_scene::{RenderOptions, Scene, SceneError, SceneRenderer, Shading};

/// Error of roughness and metalness in pixels without a rendered surface: the maximum.
const NOTHING_RENDERED: f64 = 1.0;

/// Agreement of the materials of some views with ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialQuality {
    /// Factors of linear red, green and blue albedo that fit the ground truth best, the same for
    /// all views; none without a true albedo.
    pub albedo_scale: Option<[f32; 3]>,
    /// Errors of each view.
    pub views: Vec<MaterialErrors>,
}

/// Errors of the materials of one view, `None` without ground truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MaterialErrors {
    /// PSNR in dB of the albedo after scaling, 8-bit sRGB.
    pub albedo_psnr: Option<f64>,
    /// Mean absolute error of perceptual roughness.
    pub roughness: Option<f64>,
    /// Mean absolute error of metalness.
    pub metalness: Option<f64>,
}

impl MaterialQuality {
    /// Renders the materials of each view with ground truth and measures them; `None` if the scene
    /// has no physical materials, or no view has ground truth. `truth` returns the ground truth of
    /// a view by its index; `progress` receives the number of views so far.
    ///
    /// # Errors
    ///
    /// Those of [`SceneRenderer::render`] and of `truth`.
    pub fn measure<T: Borrow<Materials>>(
        scene: &Scene,
        options: &RenderOptions,
        cameras: &[Camera],
        mut truth: impl FnMut(usize) -> Result<T, SceneError>,
        mut progress: impl FnMut(usize),
    ) -> Result<Option<Self>, SceneError> {
        if !scene.gaussians.layout.is_physical {
            return Ok(None);
        }
        let unlit = Scene { light: None, near_field: None, lamps: None, ..scene.clone() };
        let unlit = unlit.shaded(Shading::Physical)?;
        let mut renderer = None;
        let mut pairs = Vec::with_capacity(cameras.len());
        for (index, camera) in cameras.iter().enumerate() {
            let truth = truth(index)?;
            pairs.push(match truth.borrow() {
                truth if truth.is_empty() => ViewMaterials::default(),
                truth => {
                    let renderer = match &mut renderer {
                        Some(renderer) => renderer,
                        none => none.insert(SceneRenderer::without_light(unlit.clone(), Channels::Layers, options)?),
                    };
                    ViewMaterials::new(&renderer.render(camera)?, truth)
                }
            });
            progress(index + 1);
        }
        Ok(renderer.map(|_| Self::of(&pairs)))
    }

    /// Measures views that are paired with their ground truth.
    pub fn of(views: &[ViewMaterials]) -> Self {
        let scale = best_scale(views);
        let errors = |view: &ViewMaterials| MaterialErrors {
            albedo_psnr: scale.and_then(|scale| view.albedo_psnr(scale)),
            roughness: mean(view.surfaces[0]),
            metalness: mean(view.surfaces[1]),
        };
        Self { albedo_scale: scale, views: views.iter().map(errors).collect() }
    }

    /// Adds the errors of each view to its measures.
    pub fn add_to<'a>(&self, measures: impl IntoIterator<Item = &'a mut ViewMeasures>) {
        measures.into_iter().zip(&self.views).for_each(|(measures, errors)| errors.write(&mut measures.values));
    }
}

impl MaterialErrors {
    fn write(&self, values: &mut Values) {
        values[ALBEDO_PSNR] = self.albedo_psnr;
        values[ROUGHNESS_ERROR] = self.roughness;
        values[METALNESS_ERROR] = self.metalness;
    }
}

/// Rendered materials of a view with their ground truth.
#[derive(Clone, Debug, Default)]
pub struct ViewMaterials {
    /// Rendered albedo, linear, and true albedo, 8-bit sRGB, of each pixel with a true one.
    albedo: Vec<([f32; 3], [u8; 3])>,
    /// Sums of the errors of roughness and metalness, and numbers of pixels.
    surfaces: [(f64, usize); 2],
}

impl ViewMaterials {
    /// View of physical materials with all layers ([`Channels::Layers`]), and ground truth of its
    /// size.
    ///
    /// # Panics
    ///
    /// For images with other channels, or of another size.
    pub fn new(image: &Image<Vec<f32>>, truth: &Materials) -> Self {
        assert_eq!(image.channels, Channels::Layers.count() + 1, "materials are layers");
        let coverage = |pixel: usize| 1.0 - image.plane(image.channels - 1)[pixel];
        // Light falls on the mean of the surfaces that cover a pixel.
        let at = |plane: usize, pixel: usize| image.plane(plane)[pixel] / coverage(pixel);
        let is_rendered = |pixel: usize| coverage(pixel) > COVERAGE_MIN;
        let albedo = |pixel: usize| match is_rendered(pixel) {
            true => [0, 1, 2].map(|k| at(channel::DIFFUSE + k, pixel)),
            false => [0.0; 3],
        };
        let error = |plane: usize, pixel: usize, truth: u8| match is_rendered(pixel) {
            true => (f64::from(at(plane, pixel)) - f64::from(truth) / 255.0).abs(),
            false => NOTHING_RENDERED,
        };
        let mut surfaces = [(0.0, 0); 2];
        for (pixel, surface) in known(image, truth.surface.as_ref()) {
            for (k, plane) in [channel::ROUGHNESS, channel::METALNESS].into_iter().enumerate() {
                surfaces[k].0 += error(plane, pixel, surface[k]);
                surfaces[k].1 += 1;
            }
        }
        let colors = known(image, truth.albedo.as_ref());
        Self { albedo: colors.map(|(pixel, color)| (albedo(pixel), color)).collect(), surfaces }
    }

    /// PSNR in dB of the scaled albedo; none without a true one.
    fn albedo_psnr(&self, scale: [f32; 3]) -> Option<f64> {
        let squared = |(rendered, truth): &([f32; 3], [u8; 3])| -> f64 {
            let difference = |k: usize| {
                let shown = quantize(srgb_from_linear((rendered[k] * scale[k]).clamp(0.0, 1.0)));
                (f64::from(shown) - f64::from(truth[k])) / 255.0
            };
            (0..3).map(|k| difference(k).powi(2)).sum()
        };
        let sum: f64 = self.albedo.iter().map(squared).sum();
        (!self.albedo.is_empty()).then(|| psnr(sum / (3 * self.albedo.len()) as f64))
    }
}

/// Index and colour of each pixel with ground truth.
fn known<'a>(image: &Image<Vec<f32>>, truth: Option<&'a Pixels>) -> impl Iterator<Item = (usize, [u8; 3])> + use<'a> {
    let is_of_size = |truth: &Pixels| [truth.width as usize, truth.height as usize] == [image.width, image.height];
    assert!(truth.is_none_or(is_of_size), "ground truth has the size of its view");
    let pixels = truth.map_or(&[][..], |truth| truth.rgba.as_slice()).chunks_exact(4).enumerate();
    pixels.filter(|(_, pixel)| pixel[3] >= ALPHA_MIN).map(|(index, pixel)| (index, [pixel[0], pixel[1], pixel[2]]))
}

/// Factors with the least squared error of linear albedo over all views; 1 where nothing is
/// rendered. None without a true albedo.
fn best_scale(views: &[ViewMaterials]) -> Option<[f32; 3]> {
    let pairs = || views.iter().flat_map(|view| &view.albedo);
    pairs().next()?;
    let factor = |k: usize| {
        let (products, squares) = pairs().fold((0.0, 0.0), |(products, squares), (rendered, truth)| {
            let [a, t] = [rendered[k], linear_from_srgb(f32::from(truth[k]) / 255.0)].map(f64::from);
            (products + a * t, squares + a * a)
        });
        if squares > 0.0 { (products / squares) as f32 } else { 1.0 }
    };
    Some([0, 1, 2].map(factor))
}

fn mean((sum, count): (f64, usize)) -> Option<f64> {
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Difference of numbers in `f32` that are equal up to rounding.
    const ROUNDING: f64 = 1e-6;
    /// Relative error of a factor when the true albedo is rounded to 8 bits.
    const QUANTISED: f32 = 0.01;
    const WIDTH: usize = 6;

    /// Picture of pixels of albedo, roughness and metalness, covered by a share each.
    fn image(pixels: &[([f32; 3], f32, f32)], coverage: f32) -> Image<Vec<f32>> {
        let channels = Channels::Layers.count() + 1;
        let mut image = Image { width: pixels.len(), height: 1, channels, values: vec![0.0; channels * pixels.len()] };
        for (pixel, (albedo, roughness, metalness)) in pixels.iter().enumerate() {
            let mut set = |plane: usize, value: f32| image.values[plane * pixels.len() + pixel] = value;
            albedo.iter().enumerate().for_each(|(k, value)| set(channel::DIFFUSE + k, value * coverage));
            set(channel::ROUGHNESS, roughness * coverage);
            set(channel::METALNESS, metalness * coverage);
            set(channels - 1, 1.0 - coverage);
        }
        image
    }

    fn picture(pixels: &[[u8; 4]]) -> Option<Pixels> {
        Some(Pixels::of_bytes(pixels.len() as u32, 1, pixels.concat()))
    }

    /// True albedo bytes of a pixel.
    fn color(pixel: usize) -> [u8; 3] {
        [40, 90, 60].map(|byte| byte + 20 * pixel as u8)
    }

    /// View with the true linear albedo times `factors`, changed by `change` levels.
    fn scaled(factors: [f32; 3], change: impl Fn(usize) -> i16) -> ViewMaterials {
        let linear = |pixel: usize, k: usize| {
            let byte = i16::from(color(pixel)[k]) + change(pixel);
            linear_from_srgb(f32::from(byte) / 255.0) * factors[k]
        };
        let pixels: Vec<_> = (0..WIDTH).map(|pixel| ([0, 1, 2].map(|k| linear(pixel, k)), 0.5, 0.0)).collect();
        let [[r, g, b], ..] = [color(0)];
        let truth: Vec<[u8; 4]> = (0..WIDTH).map(color).map(|[r, g, b]| [r, g, b, 255]).collect();
        assert_eq!(truth[0], [r, g, b, 255]);
        ViewMaterials::new(&image(&pixels, 0.75), &Materials { albedo: picture(&truth), surface: None })
    }

    #[test]
    fn a_scaled_albedo_is_perfect_after_the_factors_of_all_views() {
        let factors = [0.5, 1.25, 2.0];
        let quality = MaterialQuality::of(&[scaled(factors, |_| 0), scaled(factors, |_| 0)]);
        let scale = quality.albedo_scale.unwrap();
        for (found, factor) in scale.iter().zip(factors) {
            assert!((found * factor - 1.0).abs() < QUANTISED, "{found} times {factor}");
        }
        assert_eq!(quality.views[0].albedo_psnr, Some(f64::INFINITY));
        assert_eq!((quality.views[0].roughness, quality.views[0].metalness), (None, None));
        // Factors that differ between views are an error: one factor belongs to all.
        let quality = MaterialQuality::of(&[scaled([1.0; 3], |_| 0), scaled([0.5; 3], |_| 0)]);
        assert!(quality.views.iter().all(|view| view.albedo_psnr.unwrap() < 30.0), "{quality:?}");
    }

    #[test]
    fn a_known_error_of_the_albedo_has_its_psnr() {
        /// Errors of pixels in levels, alternating.
        const LEVELS: i16 = 10;
        let view = scaled([1.0; 3], |pixel| if pixel % 2 == 0 { LEVELS } else { -LEVELS });
        let expected = 20.0 * (255.0 / f64::from(LEVELS)).log10();
        assert!((view.albedo_psnr([1.0; 3]).unwrap() - expected).abs() < ROUNDING);
        assert!(MaterialQuality::of(&[view]).views[0].albedo_psnr.unwrap() < expected + 1.0);
    }

    #[test]
    fn errors_of_roughness_and_metalness_count_pixels_that_have_a_truth() {
        // Errors of 0.1 and 0.25, of 0.3 and 0; without a material; not rendered.
        let shown = [([0.5; 3], 0.3, 0.25), ([0.5; 3], 0.7, 1.0), ([0.5; 3], 0.9, 0.9)];
        let truth = [[51, 0, 0, 255], [102, 255, 0, 255], [0, 0, 0, 0]];
        let truth = Materials { albedo: None, surface: picture(&truth) };
        let errors = MaterialQuality::of(&[ViewMaterials::new(&image(&shown, 0.5), &truth)]).views[0];
        assert!((errors.roughness.unwrap() - 0.2).abs() < ROUNDING, "{errors:?}");
        assert!((errors.metalness.unwrap() - 0.125).abs() < ROUNDING, "{errors:?}");
        assert_eq!(errors.albedo_psnr, None);
        let nothing = MaterialQuality::of(&[ViewMaterials::new(&image(&shown, 0.0), &truth)]).views[0];
        assert_eq!((nothing.roughness, nothing.metalness), (Some(1.0), Some(1.0)), "missing surfaces count as errors");
    }

    #[test]
    fn without_a_truth_nothing_is_measured() {
        let quality =
            MaterialQuality::of(&[ViewMaterials::new(&image(&[([0.5; 3], 0.3, 0.0)], 1.0), &Materials::default())]);
        assert_eq!(quality, MaterialQuality { albedo_scale: None, views: vec![MaterialErrors::default()] });
    }
}
