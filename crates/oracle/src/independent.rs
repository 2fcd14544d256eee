//! Independent renderer in `f64` that shares no formula with core: the reference for core's
//! formulas.
//!
//! It uses only core's types of scenes ([`specula_core::scene`], [`specula_core::camera::Camera`]).
//! Everything else is written again in the simplest way: no tiles, no culling, no early
//! termination; every Gaussian in every pixel, exactly along its ray, each pixel sorted separately;
//! light by quadrature.
//!
//! * [`rays`]: strength and order of Gaussians along a ray, and their blending
//! * [`surface`]: their colours: harmonics, and the paper's shading function
//! * [`lobe`]: light under a GGX lobe, the integral that every prefilter approximates; [`brdf`]:
//!   light under the complete reflectance, including the lobe
//! * [`paths`]: solids of such a reflectance by path tracing, with shadows and all bounces
//!
//! It does not support extreme numbers: it does not have the model's limits.

pub mod brdf;
pub mod lobe;
pub mod paths;
pub mod rays;
mod sphere;
pub mod surface;

use glam::DVec3;
use rays::{Gaussian, Order, RayView, blend};
use specula_core::scene::Image;
use surface::{Light, Look, SURFACE_CHANNELS, Surface, pixel_color};

/// Stage of the light lookup.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightPer {
    /// Per Gaussian, once for a picture: its colour is blended.
    Gaussian,
    /// Per pixel, for the blended mean surface.
    Pixel,
}

/// A picture of Gaussians: sRGB colours, premultiplied, then transmittance, as planes. All
/// appearances are of one kind; plain radiance uses no light.
pub fn render(
    scene: &[(Gaussian, Look)],
    light: &Light<'_>,
    light_per: LightPer,
    view: &RayView,
    order: Order,
) -> Image<Vec<f64>> {
    let gaussians: Vec<Gaussian> = scene.iter().map(|(gaussian, _)| *gaussian).collect();
    let surfaces: Option<Vec<&Surface>> = scene.iter().map(|(_, look)| look.surface()).collect();
    match surfaces.filter(|_| light_per == LightPer::Pixel) {
        Some(surfaces) => {
            let channels: Vec<_> = gaussians
                .iter()
                .zip(surfaces)
                .map(|(gaussian, surface)| surface.channels(to_eye(gaussian, view)))
                .collect();
            shaded(&blend(&gaussians, &channels, view, order), light, view)
        }
        None => {
            let color =
                |(gaussian, look): &(Gaussian, Look)| look.color(to_eye(gaussian, view), light).to_array().to_vec();
            blend(&gaussians, &scene.iter().map(color).collect::<Vec<_>>(), view, order)
        }
    }
}

/// From a Gaussian, of unit length.
fn to_eye(gaussian: &Gaussian, view: &RayView) -> DVec3 {
    (view.position - gaussian.mean).normalize()
}

/// Blended surfaces under a light.
fn shaded(blended: &Image<Vec<f64>>, light: &Light<'_>, view: &RayView) -> Image<Vec<f64>> {
    let count = blended.pixel_count();
    let mut values = vec![0.0; 4 * count];
    for pixel in 0..count {
        let surface: [f64; SURFACE_CHANNELS] = core::array::from_fn(|plane| blended.values[plane * count + pixel]);
        let transmittance = blended.values[SURFACE_CHANNELS * count + pixel];
        let to_eye = -(view.camera_from_world.transpose() * view.ray(pixel)).normalize();
        let color = pixel_color(&surface, transmittance, to_eye, light);
        (0..3).for_each(|c| values[c * count + pixel] = color[c]);
        values[3 * count + pixel] = transmittance;
    }
    Image { channels: 4, values, ..*blended }
}

/// The two numbers differ by no more than `tolerance`.
#[cfg(test)]
#[track_caller]
fn assert_close(actual: f64, expected: f64, tolerance: f64) {
    let difference = (actual - expected).abs();
    assert!(difference <= tolerance, "{actual} is {difference:e} from {expected}, allowed are {tolerance:e}");
}
