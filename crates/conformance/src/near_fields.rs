//! Near fields of made-up triangles.

use glam::Vec3;
use specula_core::{
    near_field::{NearField, NearSurface, VERTEX_LEN},
    random::uniform,
    scene::{Gaussians, ROUGHNESS},
    vector::Vec3 as Real3,
};
use specula_mesh::hierarchy::Hierarchy;

/// Near field of triangles that share no vertex, each of one surface. Normals are those of the
/// triangles; rays start 0.01 above a surface.
pub fn of_triangles(triangles: &[([Vec3; 3], NearSurface<f32>)]) -> NearField<Vec<f32>> {
    let corners: Vec<[[f32; 3]; 3]> = triangles.iter().map(|(corners, _)| corners.map(|v| v.to_array())).collect();
    let Hierarchy { nodes, order } = Hierarchy::new(&corners);
    let indices: Vec<[f32; 4]> = order.iter().map(|k| [0, 1, 2, 0].map(|corner| (3 * k + corner) as f32)).collect();
    let vertices: Vec<[f32; VERTEX_LEN]> = triangles
        .iter()
        .flat_map(|(corners, surface)| {
            let [a, b, c] = *corners;
            let normal = (b - a).cross(c - a).normalize_or_zero();
            corners.map(|corner| vertex(corner, normal, surface))
        })
        .collect();
    let sizes = [nodes.len(), indices.len(), vertices.len()];
    let values = [nodes.as_flattened(), indices.as_flattened(), vertices.as_flattened()].concat();
    NearField::of_sizes(sizes, 0.01, values)
}

fn vertex(position: Vec3, normal: Vec3, surface: &NearSurface<f32>) -> [f32; VERTEX_LEN] {
    let mut numbers = [0.0; VERTEX_LEN];
    numbers[..3].copy_from_slice(&position.to_array());
    numbers[3..6].copy_from_slice(&normal.to_array());
    numbers[6..9].copy_from_slice(&surface.base.to_array());
    numbers[9..12].copy_from_slice(&surface.tint.to_array());
    numbers[12] = surface.roughness;
    numbers
}

/// Surface of one grey, that shines by itself and reflects.
pub fn gray(base: f32, tint: f32, roughness: f32) -> NearSurface<f32> {
    NearSurface { normal: Real3::splat(0.0), base: Real3::splat(base), tint: Real3::splat(tint), roughness }
}

/// Rectangle, whose front is that of `right` × `up`.
pub fn rectangle(corner: Vec3, right: Vec3, up: Vec3, surface: NearSurface<f32>) -> [([Vec3; 3], NearSurface<f32>); 2] {
    let opposite = corner + right + up;
    [([corner, corner + right, opposite], surface), ([corner, opposite, corner + up], surface)]
}

/// Gaussians of a roughness from 0.2 to 0.42, which reflect hits of single rays.
pub fn polished(mut gaussians: Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
    for index in 0..gaussians.count {
        let [raw] = gaussians.get::<1>(index, ROUGHNESS);
        gaussians.set(index, ROUGHNESS, [0.5 * raw.clamp(-1.0, 1.0) - 0.85]);
    }
    gaussians
}

/// Random near field whose vertices other surfaces light, and that light: irradiance / π. Rays
/// start so far above it that many pixels of any cloud in it find it below.
pub fn lit_near_field(count: u64, seed: u64) -> (NearField<Vec<f32>>, Vec<f32>) {
    let near_field = NearField { offset: 0.3, ..random_near_field(count, seed) };
    let reflected = (0..3 * near_field.vertex_count as u64).map(|index| uniform(seed, 91, index)).collect();
    (near_field, reflected)
}

/// Near field of triangles anywhere in a cube from −2 to 2, of any surface.
pub fn random_near_field(count: u64, seed: u64) -> NearField<Vec<f32>> {
    let triangle = |k: u64| {
        let draw = |index: u64| uniform(seed, 77 + k, index);
        let vector = |first: u64| Vec3::from([0, 1, 2].map(|axis| draw(first + axis)));
        let center = 4.0 * vector(0) - 2.0;
        let corners = [3, 6, 9].map(|first| center + 1.6 * vector(first) - 0.8);
        let base: Real3<f32> = vector(12).into();
        let tint: Real3<f32> = (0.5 * vector(15)).into();
        (corners, NearSurface { normal: base, base, tint, roughness: draw(18) })
    };
    of_triangles(&(0..count).map(triangle).collect::<Vec<_>>())
}
