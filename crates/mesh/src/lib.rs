//! Surfaces of Gaussian scenes.
//!
//! * [`fusion`]: a mesh from the depths of rendered views
//! * [`align`], [`simplify`]: a smoother mesh, of fewer triangles
//! * [`atlas`], [`texture`]: its textures, from means over views ([`means`])
//! * [`ambient`]: self-occluded light of a surface under a [`sky`]
//! * [`sight`]: light that a surface reflects onto itself
//! * [`near_field`]: a mesh with the attributes of its surface, for reflected rays
//! * [`hierarchy`]: boxes around triangles, in the order in which rays visit them
#![forbid(unsafe_code)]

pub mod align;
pub mod ambient;
pub mod atlas;
pub mod fusion;
pub mod hierarchy;
pub mod means;
pub mod near_field;
pub mod sight;
pub mod simplify;
pub mod sky;
pub mod surface;
pub mod texture;
mod view;

use glam::Vec3;

/// Triangles and their vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions in world space.
    pub positions: Vec<[f32; 3]>,
    /// Outward unit normals.
    pub normals: Vec<[f32; 3]>,
    /// sRGB, in \[0, 1\].
    pub colors: Vec<[f32; 3]>,
    /// Vertices of each triangle, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// Positions and normals.
    fn points(&self) -> [&[[f32; 3]]; 2] {
        [&self.positions, &self.normals]
    }

    /// Corners of a triangle.
    fn corners(&self, triangle: &[u32; 3]) -> [Vec3; 3] {
        triangle.map(|vertex| Vec3::from(self.positions[vertex as usize]))
    }

    /// Normal of a triangle, twice its area long.
    fn across(&self, triangle: &[u32; 3]) -> Vec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// The same mesh with the normals of its surface. The weights of triangles around a vertex are
    /// exact on a sphere (Max 1999, "Weights for Computing Vertex Normals from Facet Normals").
    #[must_use]
    pub fn with_own_normals(mut self) -> Self {
        let mut sums = vec![Vec3::ZERO; self.positions.len()];
        for triangle in &self.triangles {
            let (corners, across) = (self.corners(triangle), self.across(triangle));
            for k in 0..3 {
                let [before, after] = [2, 1].map(|step| corners[(k + step) % 3].distance_squared(corners[k]));
                let weighted = across / (before * after);
                sums[triangle[k] as usize] += if weighted.is_finite() { weighted } else { Vec3::ZERO };
            }
        }
        for (normal, sum) in self.normals.iter_mut().zip(sums) {
            *normal = sum.try_normalize().map_or(*normal, |sum| sum.to_array());
        }
        self
    }

    /// Mesh with some of its vertices, and the triangles between them.
    fn with_vertices(&self, is_kept: impl Fn(usize) -> bool) -> Self {
        let mut kept = Self::default();
        let mut index_of = vec![u32::MAX; self.positions.len()];
        for vertex in (0..self.positions.len()).filter(|vertex| is_kept(*vertex)) {
            index_of[vertex] = kept.positions.len() as u32;
            kept.positions.push(self.positions[vertex]);
            kept.normals.push(self.normals[vertex]);
            kept.colors.push(self.colors[vertex]);
        }
        let triangles = self.triangles.iter().map(|triangle| triangle.map(|vertex| index_of[vertex as usize]));
        kept.triangles = triangles.filter(|triangle| !triangle.contains(&u32::MAX)).collect();
        kept
    }
}
