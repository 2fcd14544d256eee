//! Visibility between the vertices of a surface, along cosine-weighted rays. It is computed once
//! and used for interreflections of any lamps.

use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    near_field::{NearField, VERTEX_LEN},
    random,
};

/// Rays of a vertex.
pub const RAYS: usize = 64;
/// Stream of the rotations of the rays.
const ROTATIONS: u64 = 0x616d_6269;
/// Fractional parts of multiples of these fill a square evenly (the R₂ sequence; Roberts 2018).
const R2: [f32; 2] = [0.754_877_7, 0.569_840_3];

/// Vertex that a ray without a hit sees.
const OPEN: u32 = u32::MAX;

/// Vertices that each vertex of a near field sees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sight {
    /// [`RAYS`] for each vertex: the nearest corner of the triangle that a ray hits.
    seen: Vec<u32>,
}

impl Sight {
    /// Sight of all vertices of a near field. Vertices without a normal see none.
    pub fn new(near_field: &NearField<Vec<f32>>) -> Self {
        let mut seen = vec![OPEN; RAYS * near_field.vertex_count];
        seen.par_chunks_mut(RAYS).enumerate().for_each(|(vertex, seen)| {
            for (seen, (start, direction)) in seen.iter_mut().zip(rays(near_field, vertex)) {
                if let Some(hit) = near_field.first_hit(start.into(), direction.into()) {
                    let [b, c] = hit.weights;
                    let weights = [1.0 - b - c, b, c];
                    let nearest = (1..3).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
                    *seen = near_field.corners(hit.triangle)[nearest] as u32;
                }
            }
        });
        Self { seen }
    }

    /// Vertices that a vertex sees along its rays, in their order; `None` for a ray without a hit.
    pub(crate) fn of_vertex(&self, vertex: usize) -> impl Iterator<Item = Option<usize>> {
        self.seen[RAYS * vertex..RAYS * (vertex + 1)].iter().map(|seen| (*seen != OPEN).then_some(*seen as usize))
    }

    /// Irradiance / π of every vertex by the light of the vertices that it sees, which are diffuse;
    /// rays without a hit contribute nothing.
    pub fn irradiance(&self, radiance: &[Vec3]) -> Vec<Vec3> {
        let of = |seen: &u32| if *seen == OPEN { Vec3::ZERO } else { radiance[*seen as usize] };
        // The density of rays is proportional to their cosine.
        self.seen.par_chunks(RAYS).map(|seen| seen.iter().map(of).sum::<Vec3>() / RAYS as f32).collect()
    }
}

/// Starts and directions of the cosine-weighted rays of a vertex; `None` without a normal.
pub(crate) fn rays(near_field: &NearField<Vec<f32>>, vertex: usize) -> impl Iterator<Item = (Vec3, Vec3)> {
    let numbers: [f32; VERTEX_LEN] = near_field.vertex(vertex);
    let position = Vec3::from_slice(&numbers);
    let normal = Vec3::from_slice(&numbers[3..]).normalize_or_zero();
    let count = if normal == Vec3::ZERO { 0 } else { RAYS };
    let start = position + near_field.offset * normal;
    let [tangent, bitangent] = if count == 0 { [Vec3::ZERO; 2] } else { normal.any_orthonormal_pair().into() };
    let rotation = [0, 1].map(|axis| random::uniform(0, ROTATIONS, 2 * vertex as u64 + axis));
    (0..count).map(move |ray| {
        let [u, v] = [0, 1].map(|axis: usize| (rotation[axis] + R2[axis] * ray as f32).fract());
        let (sine, cosine) = (core::f32::consts::TAU * v).sin_cos();
        (start, u.sqrt() * (cosine * tangent + sine * bitangent) + (1.0 - u).sqrt() * normal)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mesh, near_field::SurfaceMeans};

    /// A small square on the floor below a large one that faces down.
    fn below_a_roof(half: f32, height: f32) -> NearField<Vec<f32>> {
        let square = |half: f32, height: f32| {
            [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
        };
        let normals = |z: f32| [[0.0, 0.0, z]; 4];
        let mesh = Mesh {
            positions: [square(half, height), square(1e-3, 0.0)].concat(),
            normals: [normals(-1.0), normals(1.0)].concat(),
            colors: vec![[0.5; 3]; 8],
            triangles: vec![[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]],
        };
        SurfaceMeans::new(mesh, 1e-4).near_field().expect("there are triangles")
    }

    /// A square of half edge a at a height of h fills (4/π) (a / √(a² + h²)) atan(a / √(a² + h²))
    /// of the view of the point below its middle, weighted by the cosine.
    #[test]
    fn a_roof_lights_the_floor_by_its_form_factor() {
        for (half, height) in [(1.0_f32, 0.5_f32), (1.0, 2.0)] {
            let sight = Sight::new(&below_a_roof(half, height));
            let slant = half / half.hypot(height);
            let expected = 4.0 / core::f32::consts::PI * slant * slant.atan();
            let radiance = [[Vec3::new(1.0, 2.0, 0.0); 4], [Vec3::ZERO; 4]].concat();
            for found in &sight.irradiance(&radiance)[4..] {
                // Of 64 rays.
                assert!((found.x - expected).abs() < 0.03, "{found} rather than {expected}");
                assert!((found.y - 2.0 * found.x).abs() < 1e-6 && found.z == 0.0, "{found}");
            }
        }
    }

    #[test]
    fn vertices_without_a_normal_see_nothing() {
        let mut near_field = below_a_roof(1.0, 0.5);
        near_field.vertices_mut().iter_mut().for_each(|numbers| numbers[3..6].fill(0.0));
        let dark = Sight::new(&near_field).irradiance(&[Vec3::ONE; 8]);
        assert!(dark.iter().all(|irradiance| *irradiance == Vec3::ZERO));
    }
}
