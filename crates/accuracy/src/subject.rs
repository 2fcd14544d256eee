//! Scene and its views, for rendering under different settings.

use specula_core::{
    camera::Camera,
    cubemap::{FACE_COUNT, texel_index, texel_of_index, texel_solid_angle},
    cutoffs::BlendOrder,
    environment::radiance,
    near_field::NearField,
    prefilter::PrefilterScheme,
    scene::{Environment, Gaussians, RadianceActivation},
    shade::{ShadingForm, ShadingRules},
};
use std::sync::Arc;

/// A scene with its views.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The Gaussians.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Light at a valid resolution; `None` for unlit scenes.
    pub light: Option<Environment<Vec<f32>>>,
    /// Surface of the scene that reflected rays may hit.
    pub near_field: Option<Arc<NearField<Vec<f32>>>>,
    /// Shading rules.
    pub shading: ShadingRules,
    /// Prefilter of the light.
    pub scheme: PrefilterScheme,
    /// Views.
    pub cameras: Vec<Camera>,
    /// Background in sRGB.
    pub background: [f32; 3],
    /// Order of splats in exact pictures.
    pub order: BlendOrder,
}

impl Subject {
    /// Returns whether exact pictures exist. GaussianShader's shading and prefilter have none,
    /// because only its code defines them.
    pub fn has_reference(&self) -> bool {
        !self.gaussians.layout.is_shaded()
            || (self.shading.form != ShadingForm::Official && self.scheme == PrefilterScheme::Exact)
    }

    /// True if light is looked up.
    pub fn is_lit(&self) -> bool {
        self.light.is_some() && self.gaussians.layout.is_shaded()
    }

    /// Light at a lower resolution, by repeated halving.
    pub fn light_at(&self, resolution: usize) -> Option<Environment<Vec<f32>>> {
        let mut light = self.light.clone()?;
        while light.resolution > resolution {
            light = halved(&light);
        }
        Some(light)
    }
}

/// Halves the resolution of a light: means of radiance over 2 × 2 texels, weighted by solid angle,
/// which preserves total radiance. A network is unchanged, but evaluated in fewer texels.
pub fn halved(light: &Environment<Vec<f32>>) -> Environment<Vec<f32>> {
    let (fine, resolution) = (light.resolution, light.resolution / 2);
    if light.is_network() {
        return Environment { resolution, ..light.clone() };
    }
    let radiance = |texel: usize, c: usize| radiance(light.activation, light.values[3 * texel + c]);
    let mut values = Vec::with_capacity(3 * FACE_COUNT * resolution * resolution);
    for index in 0..FACE_COUNT * resolution * resolution {
        let (face, column, row) = texel_of_index(index, resolution);
        let children = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, lower)| (2 * column + right, 2 * row + lower));
        let angles = children.map(|(column, row)| texel_solid_angle(column, row, fine) as f32);
        let sum: f32 = angles.iter().sum();
        for c in 0..3 {
            let child_radiance = |k: usize| radiance(texel_index(face, children[k].0, children[k].1, fine), c);
            values.push((0..4).map(|k| angles[k] * child_radiance(k)).sum::<f32>() / sum);
        }
    }
    Environment { resolution, activation: RadianceActivation::Identity, values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::cubemap::solid_angles;
    use specula_oracle::scenes::random_environment;

    /// Rounding of `f32` in a sum of some thousand terms.
    const ROUNDING: f64 = 1e-5;

    /// Integral of radiance over the sphere.
    fn whole(light: &Environment<Vec<f32>>) -> f64 {
        let radiance = |index: usize| -> f64 {
            match light.activation {
                RadianceActivation::Identity => light.values[3 * index].into(),
                RadianceActivation::Exponential => f64::from(light.values[3 * index]).exp(),
                RadianceActivation::Network => unreachable!("the light is a cube map"),
            }
        };
        solid_angles(light.resolution).enumerate().map(|(index, angle)| radiance(index) * angle).sum()
    }

    #[test]
    fn a_light_of_half_the_resolution_is_equally_bright() {
        for activation in [RadianceActivation::Identity, RadianceActivation::Exponential] {
            let light = random_environment(32, activation, 1);
            let [before, after] = [whole(&light), whole(&halved(&light))];
            assert!((before / after - 1.0).abs() < ROUNDING, "{before} and {after}");
        }
    }

    #[test]
    fn half_of_a_constant_light_is_that_light() {
        let light =
            Environment { resolution: 16, activation: RadianceActivation::Identity, values: vec![0.7; 6 * 256 * 3] };
        let half = halved(&light);
        assert_eq!(half.values.len(), 6 * 64 * 3);
        assert!(half.values.iter().all(|x| (f64::from(*x) - 0.7).abs() < ROUNDING), "it is 0.7 everywhere");
    }
}
