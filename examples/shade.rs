//! The colour of one Gaussian from two sides, with only core: `c = γ(c_d + s ⊙ L_s + c_r)`.
//!
//! Nothing here needs std or an allocator. An engine calls the same functions with its own light,
//! and with `Lanes` of `specula-cpu` for sixteen Gaussians at once.

use specula_core::{
    activation::logit,
    camera::Camera,
    shade::{Material, ShadingRules, Terms, shade, surface},
    vector::{Vec3, vec3},
};

/// A flat Gaussian that faces +z: blue, rather smooth, with a weak mirror on top. Colours are
/// stored as logits.
fn material() -> Material<f32> {
    Material {
        mean: vec3(0.0, 0.0, 0.0),
        quat: [1.0, 0.0, 0.0, 0.0],
        log_scales: vec3(-2.0, -2.0, -5.0),
        diffuse: vec3(logit(0.05), logit(0.1), logit(0.5)),
        tint: Vec3::splat(logit(0.3)),
        roughness: logit(0.2),
        normal_residuals: [Vec3::splat(0.0); 2],
    }
}

/// Light along a direction: a bright sky above +z, a dark ground. In an engine, a prefiltered cube
/// map.
fn light(direction: Vec3<f32>, roughness: f32) -> Vec3<f32> {
    let sharpness = 1.0 / roughness.max(0.05);
    let sky = 1.0 / (1.0 + (-sharpness * direction.z).exp());
    vec3(0.1 + 0.8 * sky, 0.1 + 0.9 * sky, 0.1 + sky)
}

/// The colour that an eye sees, as sRGB.
fn color_seen_from(eye: glam::Vec3) -> [f32; 3] {
    let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 64, 64);
    let rules = ShadingRules::PAPER;
    let surface = surface(&material(), camera.lift(0.0_f32).position, rules);
    let specular_light = light(surface.reflection_dir, surface.roughness);
    let unlit = Terms::unlit(surface.diffuse, Vec3::splat(0.0));
    let color = shade(rules.form, &Terms { tint: surface.tint, specular_light, ..unlit });
    [color.x, color.y, color.z]
}

fn main() {
    for eye in [glam::Vec3::new(0.5, 0.0, 3.0), glam::Vec3::new(3.0, 0.0, 0.5)] {
        let [red, green, blue] = color_seen_from(eye);
        println!("seen from {eye}: {red:.3} {green:.3} {blue:.3}");
    }
}

#[test]
fn the_sky_is_mirrored_more_from_above() {
    main();
    let [above, beside] = [glam::Vec3::new(0.5, 0.0, 3.0), glam::Vec3::new(3.0, 0.0, 0.5)].map(color_seen_from);
    assert!(above[0] > beside[0], "{above:?} and {beside:?}");
}
