//! Sight of a surface by itself: the vertices that each vertex looks at, along the rays of
//! [`crate::ambient`]. Found once, it carries light of any lamps from surface to surface.

use crate::ambient::{RAYS, rays};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::near_field::NearField;

/// Vertex that a ray into the open looks at.
const OPEN: u32 = u32::MAX;

/// Vertices that each vertex of a near field looks at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sight {
    /// [`RAYS`] for each vertex: the nearest corner of the triangle that a ray meets.
    seen: Vec<u32>,
}

impl Sight {
    /// Sight of all vertices of a near field. Vertices without a normal look into the open.
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

    /// The vertices that a vertex looks at along its rays, in their order; none into the open.
    pub(crate) fn of_vertex(&self, vertex: usize) -> impl Iterator<Item = Option<usize>> {
        self.seen[RAYS * vertex..RAYS * (vertex + 1)].iter().map(|seen| (*seen != OPEN).then_some(*seen as usize))
    }

    /// Irradiance / π of every vertex by the light that leaves those that it looks at, which shine
    /// alike in all directions; none comes from the open.
    pub fn irradiance(&self, radiance: &[Vec3]) -> Vec<Vec3> {
        let of = |seen: &u32| if *seen == OPEN { Vec3::ZERO } else { radiance[*seen as usize] };
        // Rays are weighted by their cosine.
        self.seen.par_chunks(RAYS).map(|seen| seen.iter().map(of).sum::<Vec3>() / RAYS as f32).collect()
    }
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
    fn vertices_without_a_normal_look_into_the_open() {
        let mut near_field = below_a_roof(1.0, 0.5);
        near_field.vertices_mut().iter_mut().for_each(|numbers| numbers[3..6].fill(0.0));
        let dark = Sight::new(&near_field).irradiance(&[Vec3::ONE; 8]);
        assert!(dark.iter().all(|irradiance| *irradiance == Vec3::ZERO));
    }
}
