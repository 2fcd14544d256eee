//! Random Gaussians and lights, and a view of them: deterministic for a seed on every machine.

use specula_core::{
    camera::Camera,
    environment::number_of,
    light_network::initial_weight,
    random,
    scene::{
        AMBIENT, Environment, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, RadianceActivation, len_of_values,
    },
};

/// View of the origin.
pub fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at(glam::Vec3::new(2.0, -3.0, 1.5), glam::Vec3::new(0.2, 0.0, 0.1), glam::Vec3::Z, 0.7, width, height)
}

/// Gaussians of a seed: centres within 0.8 of the origin, scales from 0.05 to 0.4, opacities from
/// 0.27 to 0.95, attributes within 1.2 of zero, ambient transfers from 0.3 to 1.5, filters in space
/// up to 0.2.
pub fn random_cloud(count: usize, layout: Layout, seed: u64) -> Gaussians<Vec<f32>> {
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for gaussian in 0..count {
        let draw = |plane: usize, low: f32, high: f32| {
            low + (high - low) * random::uniform(seed, gaussian as u64, plane as u64)
        };
        for plane in 0..layout.plane_count() {
            let number = match plane {
                MEAN..LOG_SCALE => draw(plane, -0.8, 0.8),
                LOG_SCALE..QUAT => draw(plane, -3.0, -0.9),
                QUAT..OPACITY => random::normal(seed, gaussian as u64, 1000 + plane as u64),
                OPACITY => draw(plane, -1.0, 3.0),
                plane if plane < layout.sh_start() => draw(plane, -1.2, 1.2),
                plane if Some(plane) == layout.filter_plane() => draw(plane, 0.0, 0.2),
                plane if plane >= layout.sh_end() + AMBIENT => draw(plane, 0.3, 1.5),
                plane if plane >= layout.sh_end() => draw(plane, -1.2, 1.2),
                _ => draw(plane, -0.1, 0.1),
            };
            gaussians.set(gaussian, plane, [number]);
        }
    }
    gaussians
}

/// Light of a seed: independent texels from 0.1 to 2 (or the logarithm of that); or a network of
/// random weights.
pub fn random_environment(resolution: usize, activation: RadianceActivation, seed: u64) -> Environment<Vec<f32>> {
    let mut environment = Environment { resolution, activation, values: Vec::new() };
    if environment.is_network() {
        let added = |index: usize| 0.1 * (random::uniform(seed, 0x12, index as u64) - 0.5);
        let weight = |index: usize| initial_weight(index, 0.0, seed) + added(index);
        environment.values = (0..environment.len_of_values()).map(weight).collect();
        return environment;
    }
    let radiance = |index: usize| 0.1 + 1.9 * random::uniform(seed, 0x11, index as u64);
    environment.values =
        (0..environment.len_of_values()).map(radiance).map(|radiance| number_of(activation, radiance)).collect();
    environment
}
