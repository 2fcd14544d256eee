//! Scale of a light whose mean radiance is known.
//!
//! A light k times as bright on materials that reflect 1/k of it gives the same picture, so
//! photographs of only metals do not determine the scale. The mean radiance over all directions
//! does; it is the mean radiance of a matte ball of albedo a, divided by a.

use specula_core::{
    cubemap::solid_angles,
    environment::texels,
    scene::{Environment, RadianceActivation},
};

/// Mean radiance of a cube map over all directions, weighted by solid angle.
pub(crate) fn mean_radiance(light: &Environment<Vec<f32>>) -> [f32; 3] {
    let mut sums = [0.0; 3];
    let mut total = 0.0;
    for (radiance, weight) in texels(light).zip(solid_angles(light.resolution)) {
        sums = core::array::from_fn(|k| sums[k] + weight * f64::from(radiance[k]));
        total += weight;
    }
    sums.map(|sum| (sum / total) as f32)
}

/// Scales a cube map so that its mean radiance is `wanted`; a channel that is black or not finite
/// is unchanged.
pub(crate) fn scale_to(light: &mut Environment<Vec<f32>>, wanted: [f32; 3]) {
    let mean = mean_radiance(light);
    let factors: [f32; 3] = core::array::from_fn(|k| wanted[k] / mean[k]);
    let activation = light.activation;
    for (index, number) in light.values.iter_mut().enumerate() {
        let factor = factors[index % 3];
        if factor.is_finite() && factor > 0.0 {
            match activation {
                RadianceActivation::Exponential => *number += factor.ln(),
                RadianceActivation::Identity => *number *= factor,
                RadianceActivation::Network => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::environment::number_of;

    fn light(activation: RadianceActivation) -> Environment<Vec<f32>> {
        let radiance = |index: usize| [0.2, 0.5, 1.0][index % 3] * (1.0 + (index % 7) as f32);
        let values = (0..3 * 6 * 16 * 16).map(|index| number_of(activation, radiance(index))).collect();
        Environment { resolution: 16, activation, values }
    }

    #[test]
    fn a_scaled_light_has_the_requested_mean_and_the_same_shape() {
        for activation in [RadianceActivation::Identity, RadianceActivation::Exponential] {
            let [before, mut scaled] = [light(activation), light(activation)];
            let wanted = [0.25, 2.0, 30.0];
            scale_to(&mut scaled, wanted);
            let ratio = |(new, old): ([f32; 3], [f32; 3])| core::array::from_fn::<f32, 3, _>(|k| new[k] / old[k]);
            let first = texels(&scaled).zip(texels(&before)).map(ratio).next().expect("a texel");
            for texel in texels(&scaled).zip(texels(&before)).map(ratio) {
                (0..3).for_each(|k| assert!((texel[k] / first[k] - 1.0).abs() < 1e-5, "{activation:?}: {texel:?}"));
            }
            let mean = mean_radiance(&scaled);
            (0..3).for_each(|k| assert!((mean[k] / wanted[k] - 1.0).abs() < 1e-5, "{activation:?}: {mean:?}"));
        }
    }

    #[test]
    fn texels_count_by_their_solid_angle() {
        // One bright texel at the corner of a face, where texels cover the least, and one at its
        // centre.
        let mean_with = |texel: usize| {
            let mut one = Environment {
                resolution: 16,
                activation: RadianceActivation::Identity,
                values: vec![0.0; 3 * 6 * 16 * 16],
            };
            one.values[3 * texel] = 1.0;
            mean_radiance(&one)[0]
        };
        let [corner, centre] = [mean_with(0), mean_with(8 * 16 + 8)];
        // (1 + u² + v²)^(-3/2) at the texel's centre, relative to the face's.
        let expected = (1.0 + 2.0 * (15.0_f32 / 16.0).powi(2)).powf(-1.5);
        assert!((corner / centre / expected - 1.0).abs() < 0.02, "{corner} {centre}");
    }

    #[test]
    fn a_black_channel_stays_black() {
        let mut dark = light(RadianceActivation::Identity);
        dark.values.iter_mut().skip(1).step_by(3).for_each(|number| *number = 0.0);
        scale_to(&mut dark, [1.0; 3]);
        let mean = mean_radiance(&dark);
        assert!(mean[1] == 0.0 && (mean[0] - 1.0).abs() < 1e-5, "{mean:?}");
    }
}
