//! Near fields ([`specula_core::near_field`]) from meshes: the attributes of the surface at each
//! vertex are means over the views that see it.

use crate::{
    Mesh,
    ambient::Ambient,
    hierarchy::Hierarchy,
    means::{WeightedSum, gather},
    sky::Sky,
};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    color::linear_from_srgb,
    near_field::{
        INDEX_MAX, NODE_LEN, NearField, NearSurface, TRIANGLE_LEN, VERTEX_ALBEDO, VERTEX_BASE, VERTEX_LEN,
        share_of_near, vertex_surface,
    },
    rules::{Channels, channel},
    scene::Image,
    shade::reflect,
    vector::Vec3 as Real3,
};

/// Distance along the normal at which reflected rays start, in voxels: shorter distances hit the
/// surface of the origin, because its triangles differ from a view's depths.
const OFFSET_VOXELS: f32 = 1.5;
/// Difference of depths up to which a view sees a vertex, in voxels.
const VISIBLE_VOXELS: f32 = 2.0;
/// Share of reflections below which a scene does not reflect itself: only touching parts see each
/// other.
const SHARE_MIN: f64 = 0.01;
/// Step between the vertices that are tested for self-reflection.
const TESTED_EVERY: usize = 7;
/// Normal, base, tint and roughness.
const ATTRIBUTES: usize = 10;

/// Mesh that accumulates the attributes of the surface at its vertices.
#[derive(Clone, Debug)]
pub struct SurfaceMeans {
    mesh: Mesh,
    voxel_size: f32,
    /// Attributes of each vertex.
    attributes: Vec<WeightedSum<ATTRIBUTES>>,
    /// Diffuse albedo of each vertex.
    albedos: Vec<WeightedSum<3>>,
}

impl SurfaceMeans {
    /// Mesh without views.
    pub fn new(mesh: Mesh, voxel_size: f32) -> Self {
        let count = mesh.positions.len();
        let (attributes, albedos) = (vec![WeightedSum::NONE; count], vec![WeightedSum::NONE; count]);
        Self { mesh, voxel_size, attributes, albedos }
    }

    /// Adds a view with all layers ([`Channels::Layers`]) of its view-dependent colours,
    /// premultiplied. Views are weighted by the cosine between a vertex's normal and the camera.
    ///
    /// # Panics
    ///
    /// For images with other channels.
    pub fn add(&mut self, camera: &Camera, image: &Image<Vec<f32>>) {
        assert_eq!(image.channels, Channels::Layers.count() + 1, "attributes are layers");
        let Self { mesh, voxel_size, attributes: sums, .. } = self;
        gather(mesh.points(), visible(*voxel_size), sums, camera, image, attributes);
    }

    /// Adds a view with all layers of its physical materials in the same way.
    ///
    /// # Panics
    ///
    /// For images with other channels.
    pub fn add_materials(&mut self, camera: &Camera, image: &Image<Vec<f32>>) {
        assert_eq!(image.channels, Channels::Layers.count() + 1, "materials are layers");
        let Self { mesh, voxel_size, albedos, .. } = self;
        gather(mesh.points(), visible(*voxel_size), albedos, camera, image, diffuse_albedo);
    }

    /// Near field of the mesh; `None` without triangles, or with more than can be traced. Unseen
    /// vertices reflect nothing and have the normal and the colour of the mesh.
    pub fn near_field(&self) -> Option<NearField<Vec<f32>>> {
        let Self { mesh, voxel_size, .. } = self;
        let vertices: Vec<[f32; VERTEX_LEN]> = (0..mesh.positions.len()).map(|vertex| self.vertex(vertex)).collect();
        arranged(&mesh.triangles, &vertices, OFFSET_VOXELS * voxel_size)
    }

    /// Numbers of a vertex.
    fn vertex(&self, vertex: usize) -> [f32; VERTEX_LEN] {
        let Self { mesh, .. } = self;
        let attributes = self.attributes[vertex].mean().unwrap_or_else(|| {
            let ([x, y, z], [red, green, blue]) = (mesh.normals[vertex], mesh.colors[vertex].map(linear_from_srgb));
            [x, y, z, red, green, blue, 0.0, 0.0, 0.0, 1.0]
        });
        let mut numbers = [0.0; VERTEX_LEN];
        numbers[..3].copy_from_slice(&mesh.positions[vertex]);
        numbers[3..3 + ATTRIBUTES].copy_from_slice(&attributes);
        numbers[VERTEX_ALBEDO..].copy_from_slice(&self.albedos[vertex].mean().unwrap_or_default());
        numbers
    }
}

/// Distances behind the depths of views between which these see a vertex.
fn visible(voxel_size: f32) -> [f32; 2] {
    [-VISIBLE_VOXELS, VISIBLE_VOXELS].map(|voxels| voxels * voxel_size)
}

/// Near field of triangles and vertices, in a hierarchy; `None` without triangles, or with more
/// than can be traced.
fn arranged(corners: &[[u32; 3]], vertices: &[[f32; VERTEX_LEN]], offset: f32) -> Option<NearField<Vec<f32>>> {
    if corners.is_empty() || vertices.len().max(2 * corners.len()) >= INDEX_MAX {
        return None;
    }
    let position = |corner: u32| core::array::from_fn(|axis| vertices[corner as usize][axis]);
    let triangles: Vec<[[f32; 3]; 3]> = corners.iter().map(|corners| corners.map(position)).collect();
    let Hierarchy { nodes, order } = Hierarchy::new(&triangles);
    let triangles = order.iter().map(|triangle| {
        let [a, b, c] = corners[*triangle as usize].map(|vertex| vertex as f32);
        [a, b, c, 0.0]
    });
    let triangles: Vec<[f32; TRIANGLE_LEN]> = triangles.collect();
    const { assert!(NODE_LEN == 8 && TRIANGLE_LEN == 4, "the arrays above") };
    let sizes = [nodes.len(), triangles.len(), vertices.len()];
    let values = [nodes.as_flattened(), triangles.as_flattened(), vertices.as_flattened()].concat();
    Some(NearField::of_sizes(sizes, offset, values))
}

/// Rebuilds the hierarchy of the same triangles and vertices; `None` without triangles, or if one
/// refers to a vertex that does not exist.
pub fn rearranged(surface: &NearField<Vec<f32>>) -> Option<NearField<Vec<f32>>> {
    arranged(&corners(surface)?, vertices(surface), surface.offset)
}

/// Part of a surface within a region: its triangles whose corners are all in it. `None` without
/// such triangles.
pub fn within(surface: &NearField<Vec<f32>>, contains: impl Fn([f32; 3]) -> bool) -> Option<NearField<Vec<f32>>> {
    let mut kept = Vec::new();
    let indices: Vec<Option<u32>> = vertices(surface)
        .iter()
        .map(|vertex| {
            let [x, y, z, ..] = *vertex;
            contains([x, y, z]).then(|| {
                kept.push(*vertex);
                kept.len() as u32 - 1
            })
        })
        .collect();
    let index = |corner: u32| indices[corner as usize];
    let corners = corners(surface)?.into_iter().filter_map(|[a, b, c]| Some([index(a)?, index(b)?, index(c)?]));
    arranged(&corners.collect::<Vec<_>>(), &kept, surface.offset)
}

/// Corners of the triangles of a surface; `None` if one refers to a vertex that does not exist.
fn corners(surface: &NearField<Vec<f32>>) -> Option<Vec<[u32; 3]>> {
    let vertex_count = surface.vertex_count as f32;
    let is_there = |corner: &f32| *corner >= 0.0 && *corner < vertex_count;
    let corners =
        surface.values.get(surface.triangles_start()..surface.vertices_start())?.as_chunks::<TRIANGLE_LEN>().0;
    let whole = |[a, b, c, _]: &[f32; TRIANGLE_LEN]| {
        [a, b, c].into_iter().all(is_there).then(|| [*a, *b, *c].map(|corner| corner as u32))
    };
    corners.iter().map(whole).collect()
}

fn vertices(surface: &NearField<Vec<f32>>) -> &[[f32; VERTEX_LEN]] {
    surface.values[surface.vertices_start()..].as_chunks().0
}

/// Returns true if reflected rays of a scene hit it: at least a hundredth of its reflections, seen
/// from some eyes, weighted by tint and by the share of a single ray.
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
    // Sums in the order of the vertices, so the result does not depend on threads.
    let shares: Vec<[f64; 2]> = shares.collect();
    let [all, met] = shares.iter().fold([0.0; 2], |[all, met], share| [all + share[0], met + share[1]]);
    met > SHARE_MIN * all
}

/// Diffuse albedo of a covered pixel of physical materials.
fn diffuse_albedo(image: &Image<Vec<f32>>, pixel: usize, coverage: f32) -> [f32; 3] {
    let at = |plane: usize| image.plane(plane)[pixel] / coverage;
    let share = (1.0 - at(channel::METALNESS)).max(0.0);
    [0, 1, 2].map(|k| at(channel::DIFFUSE + k).max(0.0) * share)
}

/// Base colours of a near field under a light, of vertices of physical materials: diffuse albedo
/// times irradiance.
pub fn relight(near_field: &mut NearField<Vec<f32>>, sky: &Sky) {
    let vertices = near_field.vertices_mut();
    let normals: Vec<Vec3> =
        vertices.iter().map(|numbers| Vec3::from_slice(&numbers[3..]).normalize_or_zero()).collect();
    for (numbers, irradiance) in vertices.iter_mut().zip(sky.irradiance(&normals)) {
        let base = Vec3::from_slice(&numbers[VERTEX_ALBEDO..]) * irradiance;
        numbers[VERTEX_BASE..VERTEX_BASE + 3].copy_from_slice(&base.to_array());
    }
}

/// Multiplies the base colours of a near field by the ambient transfers of its vertices: the light
/// that other surfaces do not occlude.
pub fn transfer(near_field: &mut NearField<Vec<f32>>, ambient: &Ambient) {
    let vertices = near_field.vertices_mut();
    for (numbers, transfer) in vertices.iter_mut().zip(&ambient.transfers) {
        let base = &mut numbers[VERTEX_BASE..VERTEX_BASE + 3];
        base.iter_mut().zip(transfer).for_each(|(base, transfer)| *base *= transfer);
    }
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
