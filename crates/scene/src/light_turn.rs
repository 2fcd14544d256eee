//! Turn of a light relative to another one about the up direction: of an object that was turned in
//! one light between two groups of pictures, each of which was trained under a light of its own.

use crate::environment::radiance;
use core::f64::consts::PI;
use glam::{DVec3, Vec3};
use specula_core::scene::Environment;
use specula_io::latlong;

/// Directions around the up direction, and heights above and below the horizon.
const AROUND: usize = 360;
const HEIGHTS: usize = 48;
/// Degrees between the best turn and the next best one.
const APART: usize = 30;
/// Radiance to which darker directions are raised: the logarithm of a black one says nothing.
const DARK: f64 = 1e-2;
/// Share of the variance of a light around the up direction below which turns cannot be told.
const VARIANCE_MIN: f64 = 1e-3;

/// Turn of a light relative to another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightTurn {
    /// Degrees by which the object was turned, counterclockwise from above, as in a table of lights
    /// ([`specula_io::light_table`]), from −180 to 180.
    pub degrees: f64,
    /// Correlation of the turned light with the other one, over logarithms of the radiance without
    /// their mean at each height.
    pub correlation: f64,
    /// Largest correlation of a turn that differs by 30° or more.
    pub second: f64,
}

impl LightTurn {
    /// The turn for which a light is most like another one: `other` in a direction is `first` in
    /// the turned direction. `None` if one of them is the same all around.
    pub fn find(first: &Environment<Vec<f32>>, other: &Environment<Vec<f32>>, up: Vec3) -> Option<Self> {
        let [first, other] = [first, other].map(|light| rings(light, up.as_dvec3()));
        let norm = |rings: &[f64]| rings.iter().map(|number| number * number).sum::<f64>();
        let norms = [norm(&first), norm(&other)];
        if norms.iter().any(|norm| norm / (AROUND * HEIGHTS) as f64 <= VARIANCE_MIN) {
            return None;
        }
        let scale = (norms[0] * norms[1]).sqrt();
        let correlation = |turn: usize| -> f64 {
            let ring = |(one, other): (&[f64], &[f64])| -> f64 {
                (0..AROUND).map(|k| one[(k + turn) % AROUND] * other[k]).sum()
            };
            first.chunks(AROUND).zip(other.chunks(AROUND)).map(ring).sum::<f64>() / scale
        };
        let all: Vec<f64> = (0..AROUND).map(correlation).collect();
        let best = (0..AROUND).max_by(|a, b| all[*a].total_cmp(&all[*b]))?;
        let away = |turn: usize| {
            let apart = turn.abs_diff(best);
            apart.min(AROUND - apart)
        };
        let second = (0..AROUND).filter(|turn| away(*turn) >= APART).map(|turn| all[turn]).fold(-1.0, f64::max);
        // Vertex of the parabola through the best turn and its neighbours.
        let [before, after] = [AROUND - 1, 1].map(|step| all[(best + step) % AROUND]);
        let curvature = before - 2.0 * all[best] + after;
        let offset = if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 };
        let degrees = (best as f64 + offset) * 360.0 / AROUND as f64;
        let degrees = if degrees > 180.0 { degrees - 360.0 } else { degrees };
        Some(Self { degrees, correlation: all[best], second })
    }

    /// True if the lights are alike under this turn and under no other.
    pub fn is_clear(&self) -> bool {
        self.correlation > 0.5 && self.correlation > self.second + 0.15
    }
}

/// Logarithms of the radiance around the up direction, at one height after another, without their
/// mean at each height. Heights divide the sphere into zones of equal area.
fn rings(light: &Environment<Vec<f32>>, up: DVec3) -> Vec<f64> {
    let [right, front] = {
        let (right, front) = up.any_orthonormal_pair();
        if right.cross(front).dot(up) > 0.0 { [right, front] } else { [front, right] }
    };
    let directions: Vec<[f64; 3]> = (0..HEIGHTS * AROUND)
        .map(|index| {
            let height = 2.0 * ((index / AROUND) as f64 + 0.5) / HEIGHTS as f64 - 1.0;
            let (sine, cosine) = (2.0 * PI * (index % AROUND) as f64 / AROUND as f64).sin_cos();
            let flat = (1.0 - height * height).sqrt();
            (height * up + flat * (cosine * right + sine * front)).to_array()
        })
        .collect();
    let found = latlong::radiance_along(&radiance(light), light.resolution, &directions);
    let number = |[red, green, blue]: [f32; 3]| (DARK + f64::from(red + green + blue)).ln();
    let mut rings: Vec<f64> = found.into_iter().map(number).collect();
    for ring in rings.chunks_mut(AROUND) {
        let mean = ring.iter().sum::<f64>() / AROUND as f64;
        ring.iter_mut().for_each(|number| *number -= mean);
    }
    rings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::following_light::light_of_turned_object;
    use specula_core::{
        cubemap::{FACE_COUNT, texel_direction},
        scene::RadianceActivation,
    };

    const RESOLUTION: usize = 32;

    fn light(radiance: impl Fn(Vec3) -> f32) -> Environment<Vec<f32>> {
        let texel = |index: usize| {
            let (face, texel) = (index / RESOLUTION / RESOLUTION, index % (RESOLUTION * RESOLUTION));
            let direction = texel_direction(face, texel % RESOLUTION, texel / RESOLUTION, RESOLUTION);
            [radiance(DVec3::from(direction).as_vec3().normalize()); 3]
        };
        let values = (0..FACE_COUNT * RESOLUTION * RESOLUTION).flat_map(texel).collect();
        Environment { resolution: RESOLUTION, activation: RadianceActivation::Identity, values }
    }

    /// A window, a lamp and a bright ground.
    fn room(direction: Vec3) -> f32 {
        let lobe =
            |x: f32, y: f32, z: f32, power: i32| direction.dot(Vec3::new(x, y, z).normalize()).max(0.0).powi(power);
        0.1 + 3.0 * lobe(1.0, 0.2, 0.4, 20) + 8.0 * lobe(-0.3, 1.0, 0.8, 60) + 0.3 * lobe(0.0, 0.0, -1.0, 1)
    }

    #[test]
    fn the_turn_between_two_lights_is_found() {
        for up in [Vec3::Z, Vec3::NEG_Y, Vec3::new(0.2, 0.6, -0.7).normalize()] {
            for degrees in [0.0, 37.4, 90.0, -121.7, 180.0] {
                let turn = light_of_turned_object(up, degrees);
                let found = LightTurn::find(&light(room), &light(|direction| room(turn * direction)), up);
                let found = found.expect("the room is not the same all around");
                let off = (found.degrees - degrees + 540.0).rem_euclid(360.0) - 180.0;
                assert!(off.abs() < 0.5 && found.is_clear(), "{degrees}: {found:?}");
            }
        }
    }

    #[test]
    fn no_turn_is_found_where_there_is_none() {
        let sky = light(|direction| 1.0 + direction.z);
        assert_eq!(LightTurn::find(&sky, &light(room), Vec3::Z), None, "the sky is the same all around");
        let twice = light(|direction| 1.0 + direction.x * direction.x);
        let found = LightTurn::find(&twice, &twice, Vec3::Z).expect("it differs around");
        assert!(!found.is_clear(), "half a turn looks the same: {found:?}");
        let other = light(|direction| 0.2 + (5.0 * direction.y).sin().powi(2));
        assert!(LightTurn::find(&light(room), &other, Vec3::Z).is_some_and(|found| !found.is_clear()));
    }
}
