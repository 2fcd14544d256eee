//! Environment maps at the resolutions that prefilters support.

use specula_core::{
    environment,
    prefilter::{Levels, PrefilterScheme, RESOLUTION_MAX},
    scene::Environment,
};
use specula_io::latlong::{self, UpAxis};

/// Resolution from which on the exact prefilter takes seconds or more.
pub(crate) const RESOLUTION_SLOW: usize = 256;

/// Linear radiance of an environment's texels; those of a network are at roughness 0.
pub fn radiance(light: &Environment<Vec<f32>>) -> Vec<f32> {
    environment::texels(light).flatten().collect()
}

/// Roughness levels that an environment is filtered into, at the resolution of [`fitting`].
pub fn levels_of(light: &Environment<Vec<f32>>, scheme: PrefilterScheme) -> Levels {
    Levels::new(scheme, fitting_resolution(light.resolution, scheme))
}

/// Smallest resolution that the prefilter supports and that is at least this one, or the largest
/// supported.
fn fitting_resolution(resolution: usize, scheme: PrefilterScheme) -> usize {
    resolution.next_power_of_two().clamp(scheme.resolution_min(), RESOLUTION_MAX)
}

/// Environment at a resolution that the prefilter supports: other tools also write resolutions that
/// are not powers of two.
pub fn fitting(light: &Environment<Vec<f32>>, scheme: PrefilterScheme) -> Environment<Vec<f32>> {
    resampled(light, fitting_resolution(light.resolution, scheme))
}

/// Environment at another resolution, by way of a lat-long map of four by two times its size; a
/// network is evaluated at any.
pub(crate) fn resampled(light: &Environment<Vec<f32>>, resolution: usize) -> Environment<Vec<f32>> {
    if resolution == light.resolution {
        return light.clone();
    }
    if light.is_network() {
        return Environment { resolution, ..light.clone() };
    }
    let (width, height) = (4 * resolution, 2 * resolution);
    let map = latlong::from_cube(&light.values, light.resolution, width, height, UpAxis::Z);
    Environment { resolution, values: latlong::to_cube(&map, resolution, UpAxis::Z), ..*light }
}
