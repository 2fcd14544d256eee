//! Coordinates of a mesh in a texture: charts that do not overlap (crate `uvunwrap`), and tangents
//! of normal maps ([MikkTSpace](http://www.mikktspace.com), crate `bevy_mikktspace`).

use crate::Mesh;
use bevy_mikktspace::{Geometry, StdOps, TangentSpace, generate_tangents};
use core::fmt;
use glam::{Vec2, Vec3};
use uvunwrap::{Density, MeshInput, Options, OutputVertex};

/// Empty texels around each chart, for filters and smaller levels of the texture.
const PADDING: u32 = 2;

/// Mesh with texture coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    /// Mesh, its vertices repeated at the outlines of charts.
    pub mesh: Mesh,
    /// Unit tangent of each vertex along u, perpendicular to the normal, and the sign w of the
    /// bitangent w n × t, along −v.
    pub tangents: Vec<[f32; 4]>,
    /// Coordinates of each vertex, in \[0, 1\], from the upper left corner of the texture.
    /// Triangles are counterclockwise in a picture of it.
    pub uvs: Vec<[f32; 2]>,
    /// Rows and columns of the texture.
    pub size: u32,
    /// Number of charts.
    pub charts: usize,
}

/// Charts that do not fit into a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextureTooSmall {
    /// Rows and columns of the texture.
    pub size: u32,
    /// Number of triangles.
    pub triangles: usize,
}

impl fmt::Display for TextureTooSmall {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size, triangles } = self;
        write!(out, "a texture of {size} × {size} texels cannot hold the charts of {triangles} triangles")
    }
}

impl core::error::Error for TextureTooSmall {}

impl Atlas {
    /// Unwraps a mesh with finite positions into a square texture.
    ///
    /// # Errors
    ///
    /// [`TextureTooSmall`].
    pub fn new(mesh: &Mesh, size: u32) -> Result<Self, TextureTooSmall> {
        let input = MeshInput::new(&mesh.positions, mesh.triangles.as_flattened());
        let density = Density::Auto { page_size: size };
        let unwrapped = uvunwrap::generate(&[input], &Options { density, padding: PADDING, ..Options::default() });
        let too_small = TextureTooSmall { size, triangles: mesh.triangles.len() };
        let unwrapped = unwrapped.ok().filter(|atlas| atlas.page_count == 1).ok_or(too_small)?;
        let [width, height] = [unwrapped.width, unwrapped.height].map(|edge| edge as f32 / size as f32);
        let charts = unwrapped.chart_count as usize;
        let unwrapped = unwrapped.meshes.into_iter().next().unwrap_or_default();
        // Rows count from below, so that w is 1.
        let uv = |vertex: &OutputVertex| [vertex.uv[0] * width, 1.0 - vertex.uv[1] * height];
        let uvs = unwrapped.vertices.iter().map(uv).collect();
        let of = |numbers: &[[f32; 3]]| unwrapped.vertices.iter().map(|vertex| numbers[vertex.xref as usize]).collect();
        let triangles = unwrapped.indices.as_chunks().0.to_vec();
        let mesh =
            Mesh { positions: of(&mesh.positions), normals: of(&mesh.normals), colors: of(&mesh.colors), triangles };
        let tangents = vec![[0.0; 4]; mesh.positions.len()];
        let mut atlas = Self { mesh, tangents, uvs, size, charts };
        atlas.set_tangents();
        Ok(atlas)
    }

    fn set_tangents(&mut self) {
        generate_tangents(self).expect("every face is a triangle");
        for (tangent, normal) in self.tangents.iter_mut().zip(&self.mesh.normals) {
            let normal = Vec3::from(*normal);
            let along = Vec3::from_slice(&tangent[..3]).reject_from_normalized(normal);
            let [x, y, z] = along.try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector()).to_array();
            *tangent = [x, y, z, if tangent[3] < 0.0 { -1.0 } else { 1.0 }];
        }
    }

    /// Place of a vertex in the texture, in texels.
    pub(crate) fn texel(&self, vertex: u32) -> Vec2 {
        Vec2::from(self.uvs[vertex as usize]) * self.size as f32
    }
}

impl Geometry<StdOps> for Atlas {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.mesh.triangles[face][corner] as usize]
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.mesh.triangles[face][corner] as usize]
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        let [u, v] = self.uvs[self.mesh.triangles[face][corner] as usize];
        [u, 1.0 - v]
    }

    fn set_tangent(&mut self, tangent: Option<TangentSpace>, face: usize, corner: usize) {
        let Some(tangent) = tangent else { return };
        self.tangents[self.mesh.triangles[face][corner] as usize] = tangent.tangent_encoded();
    }
}
