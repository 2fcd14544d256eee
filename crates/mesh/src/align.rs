//! Surfaces that agree with known normals.
//!
//! Depths of Gaussians are noisy, their normals are trained to be smooth. A mesh is moved until its
//! triangles are perpendicular to the normals, while its vertices stay near their places (Nehab et
//! al. 2005, "Efficiently Combining Positions and Normals for Precise 3D Geometry"; vertices move
//! as in Sun et al. 2007, "Fast and Effective Feature-Preserving Mesh Denoising"):
//!
//! ```text
//! p ← p + mean over triangles of n (n · (c − p)) + a (p₀ − p)
//! ```
//!
//! with the centroid c and the wanted normal n of each triangle around a vertex p. Bumps of up to
//! about 2π / √a edges vanish; wider shapes keep their depths.

use crate::Mesh;
use glam::Vec3;
use rayon::prelude::*;

/// Strength a of the pull towards the first place.
const ANCHOR: f32 = 0.01;
/// Number of steps: those of the slowest bumps, 1 / a.
const STEPS: usize = 100;
/// Rounds in which a normal becomes the mean of its triangles'.
const SMOOTHINGS: usize = 2;
/// Cosine between the wanted and the own normal of a triangle below which the wanted one is
/// ignored.
const AGREEING_MIN: f32 = 0.0;

/// Mesh with triangles perpendicular to a normal at each vertex, and with the normals of its new
/// surface. The normals have any length; a vertex with a zero normal takes part with the mesh's.
///
/// # Panics
///
/// Unless there is one normal for each vertex.
pub fn aligned(mesh: &Mesh, normals: &[[f32; 3]]) -> Mesh {
    assert_eq!(normals.len(), mesh.positions.len(), "each vertex has a normal");
    let triangles_of = TrianglesOf::new(mesh);
    let known = normals.iter().zip(&mesh.normals);
    let mut vertex_normals: Vec<Vec3> =
        known.map(|(known, own)| Vec3::from(*known).try_normalize().unwrap_or_else(|| Vec3::from(*own))).collect();
    let mut wanted = Vec::new();
    for _ in 0..SMOOTHINGS {
        wanted = triangle_normals(mesh, &vertex_normals);
        vertex_normals = (0..mesh.positions.len())
            .into_par_iter()
            .map(|vertex| {
                let sum: Vec3 = triangles_of.vertex(vertex).iter().map(|triangle| wanted[*triangle as usize]).sum();
                sum.try_normalize().unwrap_or(vertex_normals[vertex])
            })
            .collect();
    }
    let first: Vec<Vec3> = mesh.positions.iter().map(|position| Vec3::from(*position)).collect();
    let mut positions = first.clone();
    for _ in 0..STEPS {
        positions = step(mesh, &triangles_of, &wanted, &first, &positions);
    }
    let positions = positions.into_iter().map(|position| position.to_array()).collect();
    Mesh { positions, ..mesh.clone() }.with_own_normals()
}

/// Wanted normals of triangles: means over their vertices, unless these disagree with the surface.
fn triangle_normals(mesh: &Mesh, vertex_normals: &[Vec3]) -> Vec<Vec3> {
    let wanted = |triangle: &[u32; 3]| {
        let own = mesh.across(triangle).normalize_or_zero();
        let mean = triangle.iter().map(|vertex| vertex_normals[*vertex as usize]).sum::<Vec3>().normalize_or_zero();
        if mean.dot(own) >= AGREEING_MIN { mean } else { own }
    };
    mesh.triangles.par_iter().map(wanted).collect()
}

/// Positions after one step.
fn step(mesh: &Mesh, triangles_of: &TrianglesOf, wanted: &[Vec3], first: &[Vec3], positions: &[Vec3]) -> Vec<Vec3> {
    let centroid = |triangle: &[u32; 3]| triangle.iter().map(|vertex| positions[*vertex as usize]).sum::<Vec3>() / 3.0;
    let centroids: Vec<Vec3> = mesh.triangles.par_iter().map(centroid).collect();
    let moved = |(vertex, position): (usize, &Vec3)| {
        let around = triangles_of.vertex(vertex);
        let towards = |triangle: &u32| {
            let normal = wanted[*triangle as usize];
            normal * normal.dot(centroids[*triangle as usize] - position)
        };
        let sum: Vec3 = around.iter().map(towards).sum();
        position + sum / around.len().max(1) as f32 + ANCHOR * (first[vertex] - position)
    };
    positions.par_iter().enumerate().map(moved).collect()
}

/// Triangles around each vertex.
struct TrianglesOf {
    /// Start of each vertex's list, and the end of the last.
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl TrianglesOf {
    fn new(mesh: &Mesh) -> Self {
        let mut starts = vec![0; mesh.positions.len() + 1];
        mesh.triangles.as_flattened().iter().for_each(|vertex| starts[*vertex as usize + 1] += 1);
        (1..starts.len()).for_each(|vertex| starts[vertex] += starts[vertex - 1]);
        let mut next = starts.clone();
        let mut triangles = vec![0; 3 * mesh.triangles.len()];
        for (corner, vertex) in mesh.triangles.as_flattened().iter().enumerate() {
            triangles[next[*vertex as usize] as usize] = corner as u32 / 3;
            next[*vertex as usize] += 1;
        }
        Self { starts, triangles }
    }

    fn vertex(&self, vertex: usize) -> &[u32] {
        &self.triangles[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }
}
