//! Surfaces of Gaussian scenes.
//!
//! * [`fusion`]: a mesh from the depths of rendered views
//! * [`ambient`]: self-occluded light of a surface under a [`sky`]
//! * [`sight`]: light that a surface reflects onto itself
//! * [`near_field`]: a mesh with the attributes of its surface, for reflected rays
//! * [`hierarchy`]: boxes around triangles, in the order in which rays visit them
#![forbid(unsafe_code)]

pub mod ambient;
pub mod fusion;
pub mod hierarchy;
pub mod near_field;
pub mod sight;
pub mod sky;
pub mod surface;
mod view;

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
