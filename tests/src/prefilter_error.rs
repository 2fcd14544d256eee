//! Distance of filtered light from its integral: the measurement behind every figure about
//! prefilters.

use crate::{
    lobe::{CubeMap, filtered, studio},
    plain::{Light, look_up},
};
use rayon::prelude::*;
use specula_core::{
    double::Double,
    prefilter::{Level, Levels},
    scene::{Environment, RadianceActivation},
    vector::vec3,
};

/// Roughnesses that are looked up: dense where lobes change most.
pub const ROUGHNESS: [f64; 14] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
/// Directions of the published figures.
pub const DIRECTIONS: usize = 160;
/// Samples along the edge of a texel of the base.
const SAMPLES: usize = 8;

/// [`studio`] as a base map, and its light under lobes of every roughness, by quadrature of the
/// bilinear map.
#[derive(Debug)]
pub struct Truth {
    /// The base: three numbers as a display shows them, then three of full range.
    pub base: CubeMap<6>,
    directions: Vec<[f64; 3]>,
    /// For each roughness the light of each direction.
    light: Vec<[f64; 6]>,
}

/// Relative errors √(Σ |found − true|² / Σ |true|²) over all directions, one for each of
/// [`ROUGHNESS`].
#[derive(Clone, Copy, Debug)]
pub struct Errors(pub [f64; ROUGHNESS.len()]);

impl Errors {
    /// The root of their mean square.
    pub fn rms(&self) -> f64 {
        (self.0.iter().map(|error| error * error).sum::<f64>() / self.0.len() as f64).sqrt()
    }
    /// The largest; infinite for NaN.
    pub fn worst(&self) -> f64 {
        self.0.iter().fold(0.0, |worst, error| if error.is_nan() { f64::INFINITY } else { error.max(worst) })
    }
}

impl Truth {
    /// Integrates; the time grows with the directions and with the square of the resolution.
    pub fn new(resolution: usize, directions: usize) -> Self {
        let base = CubeMap::new(resolution, SAMPLES, |direction| studio(direction).map(|x| f64::from(x as f32)));
        let directions = spiral(directions);
        let places: Vec<(f64, [f64; 3])> = ROUGHNESS
            .iter()
            .flat_map(|roughness| directions.iter().map(|direction| (*roughness, *direction)))
            .collect();
        let of = |(roughness, direction): &(f64, [f64; 3])| {
            filtered(|light_dir| base.sample(light_dir), *direction, *roughness, resolution)
        };
        let light = places.par_iter().map(of).collect();
        Self { base, directions, light }
    }

    /// The base as a display shows it, and in full range.
    pub fn environments(&self) -> [Environment<Vec<f32>>; 2] {
        [0, 3].map(|first| Environment {
            resolution: self.base.resolution,
            activation: RadianceActivation::Identity,
            values: self.base.texels.iter().flat_map(|texel| [0, 1, 2].map(|k| texel[first + k] as f32)).collect(),
        })
    }

    /// Errors of both kinds of light, from texels of their levels with aprons, one level after the
    /// other.
    pub fn errors(&self, levels: &[Level], texels: [&[[f32; 4]]; 2]) -> [Errors; 2] {
        let lights = texels.map(|texels| opened(levels, texels));
        [0, 1].map(|kind| Errors(core::array::from_fn(|index| self.error(index, kind, &lights[kind]))))
    }

    fn error(&self, index: usize, kind: usize, light: &Light<Double>) -> f64 {
        let truths = &self.light[index * self.directions.len()..];
        let (mut difference, mut whole) = (0.0, 0.0);
        for (direction, truth) in self.directions.iter().zip(truths) {
            let [x, y, z] = direction.map(Double);
            let found = look_up(light, vec3(x, y, z), Double(ROUGHNESS[index])).to_array();
            for (found, truth) in found.iter().zip(&truth[3 * kind..]) {
                difference += (found.0 - truth).powi(2);
                whole += truth * truth;
            }
        }
        (difference / whole).sqrt()
    }
}

/// Evenly spread over the sphere: equal steps of height, a golden angle apart.
fn spiral(count: usize) -> Vec<[f64; 3]> {
    let golden = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let point = |k: usize| {
        let height = 1.0 - (2 * k + 1) as f64 / count as f64;
        let (sin, cos) = (golden * k as f64).sin_cos();
        let radius = (1.0 - height * height).sqrt();
        [radius * cos, radius * sin, height]
    };
    (0..count).map(point).collect()
}

/// Levels with aprons as they are looked up in `f64`.
fn opened(levels: &[Level], texels: &[[f32; 4]]) -> Light<Double> {
    let texels = texels.iter().map(|[r, g, b, _]| vec3(*r, *g, *b).map(|x: f32| Double(f64::from(x)))).collect();
    Light::new(Levels::of(levels).expect("they were looked up before"), texels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::assert_close;

    #[test]
    fn errors_are_told_apart_and_nan_is_the_worst() {
        let mut errors = Errors([0.1; ROUGHNESS.len()]);
        assert_close(errors.rms(), 0.1, 1e-12);
        errors.0[3] = 0.4;
        assert!(errors.rms() > 0.13 && errors.worst() == 0.4, "one of many counts");
        errors.0[4] = f64::NAN;
        assert!(errors.rms().is_nan() && errors.worst().is_infinite(), "NaN is never small");
    }

    #[test]
    fn a_light_that_is_too_bright_by_a_tenth_is_off_by_a_tenth() {
        let truth = Truth::new(4, 6);
        let levels = [0.0, 1.0].map(|roughness| Level { roughness, resolution: 1 });
        let map = |brightness: f32| vec![[brightness, brightness, brightness, 0.0]; 2 * padded_len(1)];
        let truth = Truth { light: vec![[2.0; 6]; truth.light.len()], ..truth };
        let [shown, full] = truth.errors(&levels, [&map(2.0), &map(2.2)]);
        assert_close(shown.worst(), 0.0, 0.0);
        assert_close(full.rms(), 0.1, 1e-6);
    }
}
