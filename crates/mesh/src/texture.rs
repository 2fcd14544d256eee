//! Texels of a mesh with texture coordinates: their places on its surface, and textures of numbers
//! that are known at some of them.

use crate::atlas::Atlas;
use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

/// Texels whose centres lie in triangles, in the order of rows.
#[derive(Clone, Debug)]
pub struct Texels {
    /// Rows and columns of the texture.
    pub size: usize,
    /// Indices of the texels: columns fastest, from the upper left corner.
    pub indices: Vec<u32>,
    /// Points of the surface.
    pub positions: Vec<[f32; 3]>,
    /// Unit normals of the surface, interpolated.
    pub normals: Vec<[f32; 3]>,
    /// Axes of the tangent space of normal maps, interpolated: tangent, bitangent, normal.
    frames: Vec<Mat3>,
}

/// Triangle of no texel.
const NONE: u32 = u32::MAX;

impl Texels {
    /// Texels of an atlas.
    pub fn new(atlas: &Atlas) -> Self {
        let size = atlas.size as usize;
        let triangle_of = triangles_of_texels(atlas);
        let indices: Vec<u32> =
            (0..triangle_of.len() as u32).filter(|texel| triangle_of[*texel as usize] != NONE).collect();
        let places: Vec<([f32; 3], Mat3)> = indices
            .par_iter()
            .map(|texel| {
                let triangle = atlas.mesh.triangles[triangle_of[*texel as usize] as usize];
                let weights = Weights::new(triangle.map(|vertex| atlas.texel(vertex))).at(centre(*texel, size));
                let mean = |numbers: &dyn Fn(usize) -> Vec3| -> Vec3 {
                    triangle.iter().zip(weights).map(|(vertex, weight)| weight * numbers(*vertex as usize)).sum()
                };
                let normal = mean(&|vertex| atlas.mesh.normals[vertex].into());
                let tangent = mean(&|vertex| Vec3::from_slice(&atlas.tangents[vertex][..3]));
                let sign = atlas.tangents[triangle[0] as usize][3];
                let position = mean(&|vertex| atlas.mesh.positions[vertex].into());
                (position.to_array(), Mat3::from_cols(tangent, sign * normal.cross(tangent), normal))
            })
            .collect();
        let (positions, frames): (Vec<_>, Vec<Mat3>) = places.into_iter().unzip();
        let normals = frames.iter().map(|frame| frame.z_axis.normalize_or_zero().to_array()).collect();
        Self { size, indices, positions, normals, frames }
    }

    /// Unit normal in the tangent space of a texel, turned to the front of the surface; that of the
    /// surface for a zero vector.
    pub fn in_tangent_space(&self, texel: usize, normal: Vec3) -> Vec3 {
        /// Least share of the surface's normal.
        const FRONT: f32 = 0.05;
        let inside = (self.frames[texel].inverse() * normal).try_normalize().unwrap_or(Vec3::Z);
        if inside.is_finite() { inside.with_z(inside.z.max(FRONT)).normalize() } else { Vec3::Z }
    }

    /// Numbers of every texel of a texture, some of which are known at its texels; the others are
    /// those of the nearest known ones, in the mean over growing squares, so that filters and
    /// smaller levels of the texture do not mix them with others. Zeros if nothing is known.
    ///
    /// # Panics
    ///
    /// Unless there is one value for each texel of the mesh.
    pub fn filled<const N: usize>(&self, values: &[Option<[f32; N]>]) -> Vec<[f32; N]> {
        assert_eq!(values.len(), self.indices.len(), "each texel has a value, or none");
        let mut known = vec![None; self.size * self.size];
        self.indices.iter().zip(values).for_each(|(index, value)| known[*index as usize] = *value);
        filled(&known, self.size)
    }
}

/// Centre of a texel, in texels.
fn centre(texel: u32, size: usize) -> Vec2 {
    let (column, row) = (texel as usize % size, texel as usize / size);
    Vec2::new(column as f32 + 0.5, row as f32 + 0.5)
}

/// First triangle at the centre of each texel.
fn triangles_of_texels(atlas: &Atlas) -> Vec<u32> {
    let size = atlas.size as usize;
    let mut triangle_of = vec![NONE; size * size];
    for (index, triangle) in atlas.mesh.triangles.iter().enumerate() {
        let corners = triangle.map(|vertex| atlas.texel(vertex));
        let weights = Weights::new(corners);
        let range = |axis: usize| {
            let at = corners.map(|corner| corner[axis]);
            let [min, max] = [f32::min, f32::max].map(|pick| pick(at[0], pick(at[1], at[2])));
            (min - 0.5).ceil().max(0.0) as usize..((max + 0.5).floor().max(0.0) as usize).min(size)
        };
        for row in range(1) {
            for column in range(0) {
                let texel = row * size + column;
                let is_inside = weights.at(centre(texel as u32, size)).iter().all(|weight| *weight >= 0.0);
                if is_inside && triangle_of[texel] == NONE {
                    triangle_of[texel] = index as u32;
                }
            }
        }
    }
    triangle_of
}

/// Barycentric coordinates in a triangle.
struct Weights {
    first: Vec2,
    edges: [Vec2; 2],
    area: f32,
}

impl Weights {
    fn new([a, b, c]: [Vec2; 3]) -> Self {
        let edges = [b - a, c - a];
        Self { first: a, edges, area: edges[0].perp_dot(edges[1]) }
    }

    /// Weights of the corners; not numbers in a triangle without area.
    fn at(&self, place: Vec2) -> [f32; 3] {
        let [along, other] = self.edges;
        let from = place - self.first;
        let [second, third] = [from.perp_dot(other), along.perp_dot(from)].map(|area| area / self.area);
        [1.0 - second - third, second, third]
    }
}

/// Square of numbers, with those of the smaller square of its means where none are known.
fn filled<const N: usize>(known: &[Option<[f32; N]>], size: usize) -> Vec<[f32; N]> {
    if size <= 1 || known.iter().all(Option::is_some) {
        return known.iter().map(|value| value.unwrap_or([0.0; N])).collect();
    }
    let half = size.div_ceil(2);
    let mean = |index: usize| {
        let (column, row) = (2 * (index % half), 2 * (index / half));
        let square = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, below)| (column + right, row + below));
        let inside = square.into_iter().filter(|(column, row)| *column < size && *row < size);
        let values: Vec<[f32; N]> = inside.filter_map(|(column, row)| known[row * size + column]).collect();
        let sum = |k: usize| values.iter().map(|value| value[k]).sum::<f32>();
        (!values.is_empty()).then(|| core::array::from_fn(|k| sum(k) / values.len() as f32))
    };
    let means: Vec<Option<[f32; N]>> = (0..half * half).into_par_iter().map(mean).collect();
    let smaller = filled(&means, half);
    let value = |(index, value): (usize, &Option<[f32; N]>)| {
        value.unwrap_or_else(|| smaller[index / size / 2 * half + index % size / 2])
    };
    known.par_iter().enumerate().map(value).collect()
}
