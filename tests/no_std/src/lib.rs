//! Links specula-core into a library without `std` and without an allocator.
//!
//! A use of `std` in core would bring a second panic handler, and the compiler would stop with
//! "found duplicate lang item `panic_impl`". It has C's calling convention so that any program can
//! call it.
#![no_std]

use core::panic::PanicInfo;
use specula_core::{
    antialias::LowPass,
    blend,
    camera::Camera,
    prefilter::{Levels, PrefilterScheme, level_of_roughness},
    project::{Shape, project},
    random,
    real::Real,
    shade::{Material, ShadingRules, Terms, shade, surface},
    splat::Splat2d,
    vector::{Vec3, vec3},
};

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

/// The alpha that a Gaussian at the origin has in the middle of a picture of it, as a function of
/// its logit.
#[unsafe(no_mangle)]
pub extern "C" fn specula_alpha(opacity_logit: f32) -> f32 {
    let shape = Shape {
        mean: vec3(0.0, 0.0, 0.0),
        log_scales: vec3(-2.0, -2.5, -3.0),
        quat: [1.0, 0.2, 0.3, 0.4],
        opacity_logit,
        low_pass: LowPass::Dilated,
        filter: None,
    };
    let splat = project(&shape, &camera().lift(0.0));
    let footprint = Splat2d::new(splat.mean2d, splat.root_conic, splat.opacity.log2());
    let falloff = blend::falloff(&footprint, 32.0 - splat.mean2d[0], 32.0 - splat.mean2d[1]);
    blend::alpha(falloff.log2_strength)
}

/// The red of a shiny Gaussian under white light, and the level that its light is read from.
#[unsafe(no_mangle)]
pub extern "C" fn specula_red(roughness_logit: f32, seed: u64) -> f32 {
    let random = |index| random::normal(seed, 0, index);
    let material = Material {
        mean: vec3(0.0, 0.0, 0.0),
        quat: [random(0), random(1), random(2), random(3)],
        log_scales: vec3(-2.0, -2.5, -3.0),
        diffuse: Vec3::splat(0.0),
        tint: Vec3::splat(1.0),
        roughness: roughness_logit,
        normal_residuals: [Vec3::splat(0.0); 2],
    };
    let rules = ShadingRules::PAPER;
    let surface = surface(&material, camera().lift(0.0).position, rules);
    let levels = Levels::new(PrefilterScheme::Exact, 64);
    let terms = Terms {
        diffuse: surface.diffuse,
        tint: surface.tint,
        specular_light: Vec3::splat(1.0 + level_of_roughness(surface.roughness, levels.as_slice())),
        residual: Vec3::splat(0.0),
        ambient_light: Vec3::splat(0.0),
        split_sum: [1.0, 0.0],
    };
    shade(rules.form, &terms).x
}

fn camera() -> Camera {
    Camera::look_at(glam::Vec3::new(0.0, 0.0, -4.0), glam::Vec3::ZERO, glam::Vec3::NEG_Y, 0.8, 64, 64)
}
