//! Near fields ([`specula_core::near_field`]) from meshes: the attributes of the surface at each
//! vertex are means over the views that see it.

use crate::{Mesh, hierarchy::Hierarchy, view::View};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    color::linear_from_srgb,
    near_field::{
        INDEX_MAX, NODE_LEN, NearField, NearSurface, TRIANGLE_LEN, VERTEX_LEN, share_of_near, vertex_surface,
    },
    rules::{Channels, channel},
    scene::Image,
    shade::reflect,
    vector::Vec3 as Real3,
};

/// Distance along the normal at which reflected rays start, in voxels: less meets the surface that
/// they start from, whose triangles differ from the depths of a view.
const OFFSET_VOXELS: f32 = 1.5;
/// Difference of depths up to which a view sees a vertex, in voxels.
const VISIBLE_VOXELS: f32 = 2.0;
/// Share of reflections below which a scene does not reflect itself: contacts of its parts alone.
const SHARE_MIN: f64 = 0.01;
/// Step between the vertices that are tested for it.
const TESTED_EVERY: usize = 7;
/// Normal, base, tint and roughness.
const ATTRIBUTES: usize = 10;

/// Mesh whose vertices collect the attributes of the surface.
#[derive(Clone, Debug)]
pub struct SurfaceMeans {
    mesh: Mesh,
    voxel_size: f32,
    /// Weighted sums of the attributes of each vertex, and of the weights.
    sums: Vec<[f32; ATTRIBUTES + 1]>,
}

impl SurfaceMeans {
    /// Mesh that no view was added to.
    pub fn new(mesh: Mesh, voxel_size: f32) -> Self {
        let sums = vec![[0.0; ATTRIBUTES + 1]; mesh.positions.len()];
        Self { mesh, voxel_size, sums }
    }

    /// Adds a view with all layers ([`Channels::Layers`]), premultiplied. Vertices count as much as
    /// they face the camera.
    ///
    /// # Panics
    ///
    /// For images with other channels.
    pub fn add(&mut self, camera: &Camera, image: &Image<Vec<f32>>) {
        assert_eq!(image.channels, Channels::Layers.count() + 1, "attributes are layers");
        let view = View::new(camera, image);
        let tolerance = VISIBLE_VOXELS * self.voxel_size;
        let Self { mesh, sums, .. } = self;
        let vertices = mesh.positions.par_iter().zip(&mesh.normals);
        sums.par_iter_mut().zip(vertices).for_each(|(sums, (position, normal))| {
            let position = Vec3::from(*position);
            let Some((depth, pixel)) = view.pixel(position) else { return };
            let is_visible = (view.depths[pixel] - depth).abs() < tolerance;
            let cosine = Vec3::from(*normal).dot((camera.position - position).normalize_or_zero());
            let weight = cosine.max(0.0) * view.coverage[pixel];
            if is_visible && weight > 0.0 {
                let attributes = attributes(image, pixel, view.coverage[pixel]);
                sums.iter_mut().zip(attributes).for_each(|(sum, x)| *sum += weight * x);
                sums[ATTRIBUTES] += weight;
            }
        });
    }

    /// Near field of the mesh; none without triangles, or with more than can be traced. Vertices
    /// that no view sees reflect nothing and have the normal and the colour of the mesh.
    pub fn near_field(&self) -> Option<NearField<Vec<f32>>> {
        let Self { mesh, voxel_size, sums } = self;
        let triangle = |corners: &[u32; 3]| corners.map(|corner| mesh.positions[corner as usize]);
        let corners: Vec<[[f32; 3]; 3]> = mesh.triangles.iter().map(triangle).collect();
        if corners.is_empty() || mesh.positions.len().max(2 * corners.len()) >= INDEX_MAX {
            return None;
        }
        let Hierarchy { nodes, order } = Hierarchy::new(&corners);
        let mut near_field = NearField {
            node_count: nodes.len(),
            triangle_count: order.len(),
            vertex_count: mesh.positions.len(),
            offset: OFFSET_VOXELS * voxel_size,
            values: Vec::new(),
        };
        let triangles = order.iter().map(|triangle| {
            let [a, b, c] = mesh.triangles[*triangle as usize].map(|vertex| vertex as f32);
            [a, b, c, 0.0]
        });
        let triangles: Vec<[f32; TRIANGLE_LEN]> = triangles.collect();
        let vertices: Vec<[f32; VERTEX_LEN]> = (0..sums.len()).map(|vertex| self.vertex(vertex)).collect();
        const { assert!(NODE_LEN == 8 && TRIANGLE_LEN == 4, "the arrays above") };
        near_field.values = [nodes.as_flattened(), triangles.as_flattened(), vertices.as_flattened()].concat();
        Some(near_field)
    }

    /// Numbers of a vertex.
    fn vertex(&self, vertex: usize) -> [f32; VERTEX_LEN] {
        let Self { mesh, sums, .. } = self;
        let [attributes @ .., weight] = sums[vertex];
        let attributes = match weight > 0.0 {
            true => attributes.map(|sum| sum / weight),
            false => {
                let ([x, y, z], [red, green, blue]) = (mesh.normals[vertex], mesh.colors[vertex].map(linear_from_srgb));
                [x, y, z, red, green, blue, 0.0, 0.0, 0.0, 1.0]
            }
        };
        let mut numbers = [0.0; VERTEX_LEN];
        numbers[..3].copy_from_slice(&mesh.positions[vertex]);
        numbers[3..3 + ATTRIBUTES].copy_from_slice(&attributes);
        numbers
    }
}

/// Returns whether reflected rays of a scene meet it: a hundredth of its reflections or more, as
/// some eyes see them, weighted by tint and by the share of a single ray.
pub fn reflects_itself(near_field: &NearField<Vec<f32>>, eyes: &[Vec3]) -> bool {
    if eyes.is_empty() {
        return false;
    }
    let vertices: Vec<usize> = (0..near_field.vertex_count).step_by(TESTED_EVERY).collect();
    let shares = vertices.par_iter().map(|vertex| {
        let numbers = near_field.vertex(*vertex);
        let [position, normal, _, tint] = core::array::from_fn(|k| Vec3::from_slice(&numbers[3 * k..]));
        let NearSurface { roughness, .. } = vertex_surface(numbers);
        let (normal, eye) = (normal.normalize_or_zero(), eyes[*vertex % eyes.len()]);
        let view_dir = (eye - position).normalize_or_zero();
        let start = position + near_field.offset * normal;
        let is_seen = view_dir.dot(normal) > 0.0 && near_field.first_hit(start.into(), view_dir.into()).is_none();
        if !is_seen {
            return [0.0; 2];
        }
        let direction = reflect(Real3::from(view_dir), Real3::from(normal));
        let is_met = near_field.first_hit(start.into(), direction).is_some();
        let weight = f64::from(tint.element_sum());
        [weight, if is_met { weight * f64::from(share_of_near(roughness)) } else { 0.0 }]
    });
    // Sums in the order of the vertices, so that threads change nothing.
    let shares: Vec<[f64; 2]> = shares.collect();
    let [all, met] = shares.iter().fold([0.0; 2], |[all, met], share| [all + share[0], met + share[1]]);
    met > SHARE_MIN * all
}

/// Normal, base colour, tint and roughness of a covered pixel.
fn attributes(image: &Image<Vec<f32>>, pixel: usize, coverage: f32) -> [f32; ATTRIBUTES] {
    let at = |plane: usize| image.plane(plane)[pixel] / coverage;
    core::array::from_fn(|k| match k {
        0..3 => at(channel::NORMAL + k),
        3..6 => (at(channel::DIFFUSE + k - 3) + at(channel::RESIDUAL + k - 3)).max(0.0),
        6..9 => at(channel::TINT + k - 6),
        _ => at(channel::ROUGHNESS),
    })
}
