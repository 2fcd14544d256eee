//! Invariants of physical materials.

use proptest::{collection::vec, prelude::*};
use specula_core::{
    physical::{DIELECTRIC, PixelLight, pixel_color, reflectances, reflected},
    shade_pixels::PixelSurface,
    split_sum::integrate,
    vector::{Vec3, vec3},
};
use specula_tests::strategies::same_every_time;

/// Points of the split sum.
const SAMPLES: u32 = 256;
/// Rounding of a few operations in `f32`.
const ROUNDING: f32 = 1e-5;

fn surface([red, green, blue]: [f32; 3], metalness: f32) -> PixelSurface<f32> {
    let [base, tint] = reflectances(vec3(red, green, blue), metalness);
    PixelSurface { base, tint, roughness: 0.5, reflection_dir: vec3(0.0, 0.0, 1.0) }
}

fn light(radiance: f32, n_dot_v: f32, roughness: f32) -> PixelLight<f32> {
    let split_sum = integrate(f64::from(n_dot_v), f64::from(roughness), SAMPLES).map(|x| x as f32);
    PixelLight { specular: Vec3::splat(radiance), irradiance: Vec3::splat(radiance), split_sum }
}

#[test]
fn dielectrics_reflect_four_percent_and_metals_their_albedo() {
    let albedo = vec3(0.9, 0.5, 0.1);
    assert_eq!(reflectances(albedo, 0.0), [albedo, Vec3::splat(DIELECTRIC)]);
    assert_eq!(reflectances(albedo, 1.0), [Vec3::splat(0.0), albedo]);
}

proptest! {
    #![proptest_config(same_every_time())]

    /// In a furnace of radiance 1.
    #[test]
    fn nothing_reflects_more_than_it_receives(
        albedo in vec(0.0..=1.0_f32, 3),
        metalness in 0.0..=1.0_f32,
        n_dot_v in 0.01..1.0_f32,
        roughness in 0.0..1.0_f32,
    ) {
        let albedo = [albedo[0], albedo[1], albedo[2]];
        let [diffuse, specular] = reflected(&surface(albedo, metalness), &light(1.0, n_dot_v, roughness));
        for (diffuse, specular) in diffuse.to_array().into_iter().zip(specular.to_array()) {
            prop_assert!(diffuse >= -ROUNDING && specular >= 0.0, "{diffuse} {specular}");
            prop_assert!(diffuse + specular <= 1.0 + ROUNDING, "{diffuse} + {specular}");
        }
        let [diffuse, specular] = reflected(&surface([1.0; 3], 0.0), &light(1.0, n_dot_v, roughness));
        prop_assert!(((diffuse + specular).x - 1.0).abs() < ROUNDING, "a white dielectric keeps {:?}", diffuse + specular);
    }

    #[test]
    fn reflected_light_is_proportional_to_the_light(
        albedo in vec(0.0..=1.0_f32, 3),
        metalness in 0.0..=1.0_f32,
        n_dot_v in 0.01..1.0_f32,
        roughness in 0.0..1.0_f32,
    ) {
        let surface = surface([albedo[0], albedo[1], albedo[2]], metalness);
        let [one, many] = [1.0, 1e6].map(|radiance| reflected(&surface, &light(radiance, n_dot_v, roughness)));
        for (one, many) in one.into_iter().zip(many) {
            for (one, many) in one.to_array().into_iter().zip(many.to_array()) {
                prop_assert!((one - many / 1e6).abs() <= ROUNDING * one.abs(), "{one} {many}");
            }
        }
        let dark = pixel_color(&surface, &light(0.0, n_dot_v, roughness), 1.0).to_array();
        prop_assert!(dark.iter().all(|x| x.abs() < ROUNDING), "without light it is black: {dark:?}");
    }
}
