//! Distant light in few directions, on the host.

use glam::{Mat3, Vec3};
use rayon::prelude::*;
use specula_core::{
    cubemap::{FACE_COUNT, face_of, texel_direction, texel_index, texel_of_index, texel_solid_angle},
    environment::texels,
    scene::Environment,
};

/// Texels along an edge of a face: 5.6° each, the mean distance of [`RAYS`](crate::sight::RAYS)
/// rays over a hemisphere is 18°.
const RESOLUTION: usize = 16;

/// Mean radiance of each of a few directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    resolution: usize,
    /// Face by face, row by row.
    texels: Vec<Vec3>,
}

impl Sky {
    /// Light of an environment, averaged by solid angles.
    pub fn new(environment: &Environment<Vec<f32>>) -> Self {
        let fine = environment.resolution;
        let coarse = RESOLUTION.min(fine);
        let mut sums = vec![(Vec3::ZERO, 0.0_f32); FACE_COUNT * coarse * coarse];
        for (index, radiance) in texels(environment).enumerate() {
            let (face, row, column) = (index / fine / fine, index / fine % fine, index % fine);
            let (sum, weight) = &mut sums[texel_index(face, column * coarse / fine, row * coarse / fine, coarse)];
            let angle = texel_solid_angle(column, row, fine) as f32;
            *sum += angle * Vec3::from(radiance);
            *weight += angle;
        }
        Self { resolution: coarse, texels: sums.into_iter().map(|(sum, weight)| sum / weight).collect() }
    }

    /// Mean sky of pictures whose lights have these rotations from world axes; the same sky without
    /// any.
    #[must_use]
    pub fn turned(self, lights_from_world: &[Mat3]) -> Self {
        if lights_from_world.is_empty() {
            return self;
        }
        let size = self.resolution;
        let texel = |index: usize| {
            let (face, column, row) = texel_of_index(index, size);
            let direction = Vec3::from(texel_direction(face, column, row, size).map(|x| x as f32));
            let sum: Vec3 = lights_from_world.iter().map(|turn| self.radiance(*turn * direction)).sum();
            sum / lights_from_world.len() as f32
        };
        Self { resolution: size, texels: (0..self.texels.len()).map(texel).collect() }
    }

    /// Weighted mean of skies of one resolution, with weights that add up to one; none of none.
    pub fn mean(skies: &[(Self, f32)]) -> Option<Self> {
        let (Self { resolution, texels }, _) = skies.first()?;
        let texel = |index: usize| skies.iter().map(|(sky, weight)| *weight * sky.texels[index]).sum();
        Some(Self { resolution: *resolution, texels: (0..texels.len()).map(texel).collect() })
    }

    /// Radiance from a direction of any length but zero; of an arbitrary direction if it is not
    /// finite.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let (face, u, v) = face_of(direction.to_array().map(f64::from));
        let texel = |x: f64| (((x + 1.0) * 0.5 * self.resolution as f64) as usize).min(self.resolution - 1);
        self.texels[texel_index(face, texel(u), texel(v), self.resolution)]
    }

    /// Irradiance / π along unit normals: Σ L (n·ω)⁺ dω / π.
    pub fn irradiance(&self, normals: &[Vec3]) -> Vec<Vec3> {
        let size = self.resolution;
        let texel = |index: usize| {
            let (face, column, row) = texel_of_index(index, size);
            let direction = texel_direction(face, column, row, size).map(|x| x as f32);
            let share = texel_solid_angle(column, row, size) as f32 / core::f32::consts::PI;
            (Vec3::from(direction), self.texels[index] * share)
        };
        let lights: Vec<(Vec3, Vec3)> = (0..self.texels.len()).map(texel).collect();
        let sum = |normal: &Vec3| {
            lights.iter().map(|(direction, light)| *light * normal.dot(*direction).max(0.0)).sum::<Vec3>()
        };
        normals.par_iter().map(sum).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::scene::RadianceActivation;

    fn environment(resolution: usize, radiance: impl Fn(Vec3) -> [f32; 3]) -> Environment<Vec<f32>> {
        let texel = |index: usize| {
            let (face, row, column) =
                (index / resolution / resolution, index / resolution % resolution, index % resolution);
            radiance(Vec3::from(texel_direction(face, column, row, resolution).map(|x| x as f32)).normalize())
        };
        let values = (0..FACE_COUNT * resolution * resolution).flat_map(texel).collect();
        Environment { resolution, activation: RadianceActivation::Identity, values }
    }

    #[test]
    fn a_uniform_sky_has_its_radiance_everywhere() {
        let sky = Sky::new(&environment(64, |_| [1.0, 2.0, 3.0]));
        let normals = [Vec3::X, Vec3::new(0.6, -0.8, 0.0), Vec3::NEG_Z];
        for normal in normals {
            assert!((sky.radiance(normal) - Vec3::new(1.0, 2.0, 3.0)).length() < 1e-5);
        }
        for irradiance in sky.irradiance(&normals) {
            assert!((irradiance / Vec3::new(1.0, 2.0, 3.0) - 1.0).length() < 0.01, "{irradiance}");
        }
    }

    #[test]
    fn a_sky_that_turns_is_a_mean() {
        let sky = Sky::new(&environment(32, |direction| [direction.x + 2.0, direction.y + 2.0, direction.z + 2.0]));
        assert_eq!(sky.clone().turned(&[]), sky);
        let quarters: Vec<Mat3> = (0..4).map(|k| Mat3::from_rotation_z(k as f32 * 1.570_796_4)).collect();
        let [one, mean] = [&quarters[1..2], &quarters[..]].map(|turns| sky.clone().turned(turns));
        for direction in [Vec3::X, Vec3::new(0.5, -0.7, 0.6).normalize()] {
            let turned = quarters[1] * direction + 2.0;
            assert!((one.radiance(direction) - turned).length() < 0.2, "{}", one.radiance(direction));
            let level = Vec3::new(2.0, 2.0, direction.z + 2.0);
            assert!((mean.radiance(direction) - level).length() < 0.2, "{}", mean.radiance(direction));
        }
    }

    #[test]
    fn skies_are_averaged_by_their_weights() {
        let sky = |radiance: f32| Sky::new(&environment(32, |direction| [direction.x + radiance; 3]));
        assert_eq!(Sky::mean(&[]), None);
        assert_eq!(Sky::mean(&[(sky(2.0), 1.0)]), Some(sky(2.0)), "the same bits");
        let mean = Sky::mean(&[(sky(2.0), 0.25), (sky(6.0), 0.75)]).unwrap();
        assert!((mean.radiance(Vec3::Y) - sky(5.0).radiance(Vec3::Y)).length() < 1e-5);
    }

    /// L = 1 + d·z has E/π = 1 + 2/3 n·z.
    #[test]
    fn irradiance_of_a_gradient_is_two_thirds_as_steep() {
        let sky = Sky::new(&environment(32, |direction| [1.0 + direction.z; 3]));
        for (normal, expected) in [(Vec3::Z, 5.0 / 3.0), (Vec3::X, 1.0), (Vec3::NEG_Z, 1.0 / 3.0)] {
            let [irradiance] = sky.irradiance(&[normal])[..] else { panic!("one normal") };
            assert!((irradiance.x - expected).abs() < 0.01, "{irradiance} along {normal}");
        }
        assert!(sky.radiance(Vec3::Z).x > 1.9 && sky.radiance(Vec3::NEG_Z).x < 0.1);
    }
}
