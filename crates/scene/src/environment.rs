//! Environment maps at the resolutions that prefilters support.

use specula_core::{
    cubemap::solid_angles,
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

/// Share of all directions that [`concentration`] looks at.
const BRIGHTEST: f64 = 0.01;
/// Concentration from which a light counts as one of small lamps: those learned from path-traced
/// pictures under lamps had 0.23 to 0.48, those of rooms less than 0.2.
const LAMPS_MIN: f64 = 0.2;

/// Share of a light's radiance that comes from the brightest hundredth of all directions, weighted
/// by solid angle: 0.01 of a uniform light, 1 of a sun in a black sky; 0 of a black one.
pub fn concentration(light: &Environment<Vec<f32>>) -> f64 {
    let sums = environment::texels(light).map(|radiance| radiance.iter().sum::<f32>());
    let mut texels: Vec<(f32, f64)> = sums.zip(solid_angles(light.resolution)).collect();
    texels.sort_by(|one, other| other.0.total_cmp(&one.0));
    let mut left = BRIGHTEST * texels.iter().map(|(_, solid_angle)| solid_angle).sum::<f64>();
    let (mut bright, mut total) = (0.0, 0.0);
    for (radiance, solid_angle) in texels {
        let taken = solid_angle.min(left);
        left -= taken;
        bright += f64::from(radiance) * taken;
        total += f64::from(radiance) * solid_angle;
    }
    if total > 0.0 { bright / total } else { 0.0 }
}

/// Those of several lights that small lamps dominate, with their [`concentration`], if others are
/// soft. The training does not model shadows of lamps, and takes them for darker material.
pub fn lights_of_lamps<'a>(lights: impl Iterator<Item = &'a Environment<Vec<f32>>>) -> Vec<(usize, f64)> {
    let all: Vec<(usize, f64)> = lights.map(concentration).enumerate().collect();
    let count = all.len();
    let concentrated: Vec<_> = all.into_iter().filter(|(_, concentration)| *concentration >= LAMPS_MIN).collect();
    if concentrated.len() < count { concentrated } else { Vec::new() }
}

/// Words for a [`concentration`].
pub fn concentration_text(concentration: f64) -> String {
    format!("{:.0} % of its radiance in {:.0} % of the directions", 100.0 * concentration, 100.0 * BRIGHTEST)
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

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::scene::RadianceActivation;

    /// Cube map of a radiance by the number of a texel.
    fn light(radiance: impl Fn(usize) -> f32) -> Environment<Vec<f32>> {
        let values = (0..6 * 16 * 16).flat_map(|texel| [radiance(texel); 3]).collect();
        Environment { resolution: 16, activation: RadianceActivation::Identity, values }
    }

    #[test]
    fn a_uniform_light_has_its_share_in_a_hundredth_of_the_directions_and_a_lamp_all_of_it() {
        assert!((concentration(&light(|_| 0.7)) - BRIGHTEST).abs() < 1e-12);
        assert!((concentration(&light(|texel| f32::from(texel == 900))) - 1.0).abs() < 1e-12);
        assert_eq!(concentration(&light(|_| 0.0)), 0.0, "a black light");
        let face = concentration(&light(|texel| if texel < 16 * 16 { 5.0 } else { 1.0 }));
        let expected = BRIGHTEST * 5.0 / ((5.0 + 5.0) / 6.0);
        assert!((face - expected).abs() < 1e-9, "{face} of a face that is brighter, not {expected}");
    }

    #[test]
    fn lights_of_lamps_are_told_where_others_are_soft() {
        let [soft, lamp] = [light(|_| 1.0), light(|texel| if texel == 900 { 2000.0 } else { 1.0 })];
        let found: Vec<usize> = lights_of_lamps([&soft, &lamp].into_iter()).iter().map(|(index, _)| *index).collect();
        assert_eq!(found, [1]);
        assert_eq!(lights_of_lamps([&lamp, &lamp].into_iter()), [], "nothing would be left");
        assert_eq!(lights_of_lamps([&soft].into_iter()), []);
    }
}
