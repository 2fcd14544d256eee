//! Invariants of physical materials.

use proptest::{collection::vec, prelude::*};
use specula_core::{
    physical::{DIELECTRIC, PixelLight, metal_share, pixel_color, reflectances, reflected},
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

/// Diffuse colour of an albedo under a mean radiance.
fn diffuse(albedo: f32, radiance: f32) -> Vec3<f32> {
    Vec3::splat(albedo * radiance)
}

#[test]
fn metals_and_dielectrics_are_told_apart_under_lights_of_any_brightness() {
    for radiance in [0.05, 0.4, 1.0, 20.0] {
        for albedo in [0.02, 0.05, 0.3, 0.5, 0.9] {
            let dielectric = metal_share(Vec3::splat(DIELECTRIC), diffuse(albedo, radiance), radiance);
            assert_eq!(dielectric, 0.0, "4 % before an albedo of {albedo} under {radiance}");
        }
        let metal = metal_share(vec3(0.4, 0.3, 0.2), diffuse(0.0, radiance), radiance);
        assert!(metal > 0.999, "no diffuse colour under {radiance}: {metal}");
        let half = metal_share(Vec3::splat(0.21), diffuse(0.79, radiance), radiance);
        assert!((half - 0.5).abs() < 1e-3, "half of the way from 0.12 to 0.3 under {radiance}: {half}");
    }
}

#[test]
fn black_and_unlit_gaussians_count_as_dielectrics() {
    assert_eq!(metal_share(Vec3::splat(0.0), Vec3::splat(0.0), 1.0), 0.0);
    assert_eq!(metal_share(Vec3::splat(1.0), Vec3::splat(0.5), 0.0), 0.0);
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
