//! Triangle meshes: with a colour and a normal at each vertex, as Wavefront OBJ and PLY; with
//! textures, as [glTF](crate::glb::textured) and [OpenUSD](crate::usd).

use crate::{
    error::{Error, Result},
    latlong::ending,
    picture::RgbImage,
    whole_file,
};
use std::{
    io::{self, Write},
    path::Path,
};

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

/// Triangles with textures, rows of which start at v = 0.
#[derive(Clone, Debug)]
pub struct TexturedMesh {
    /// Positions in world space.
    pub positions: Vec<[f32; 3]>,
    /// Outward unit normals.
    pub normals: Vec<[f32; 3]>,
    /// Unit tangents along u, and the sign w of the bitangents w n × t, along −v.
    pub tangents: Vec<[f32; 4]>,
    /// Texture coordinates, in \[0, 1\], from the upper left corner.
    pub uvs: Vec<[f32; 2]>,
    /// Vertices of each triangle, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Base colour, sRGB-encoded.
    pub base_color: RgbImage,
    /// Roughness (green) and metalness (blue); without it the base colour contains the light.
    pub surface: Option<RgbImage>,
    /// Normals in the space of tangents, bitangents and normals, −1 to 1 as 0 to 255.
    pub normal_map: Option<RgbImage>,
}

/// Writes `.obj`, with vertex colours after positions as most programs expect, or `.ply`, with one
/// line per comment.
///
/// # Errors
///
/// [`Error::Ending`] for other extensions, [`Error::Write`] if the file cannot be written.
pub fn write(path: &Path, mesh: &Mesh, comments: &[String]) -> Result<()> {
    let count = mesh.positions.len();
    assert!(mesh.normals.len() == count && mesh.colors.len() == count, "each vertex has a normal and a colour");
    match ending(path).as_deref() {
        Some("obj") => whole_file::write(path, |out| write_obj(out, mesh, comments)),
        Some("ply") => whole_file::write(path, |out| write_ply(out, mesh, comments)),
        _ => Err(Error::Ending { path: path.to_owned(), expected: ".obj or .ply" }),
    }
}

fn write_obj(out: &mut impl Write, mesh: &Mesh, comments: &[String]) -> io::Result<()> {
    comments.iter().try_for_each(|comment| writeln!(out, "# {comment}"))?;
    for ([x, y, z], [r, g, b]) in mesh.positions.iter().zip(&mesh.colors) {
        writeln!(out, "v {x} {y} {z} {r:.4} {g:.4} {b:.4}")?;
    }
    for [x, y, z] in &mesh.normals {
        writeln!(out, "vn {x:.4} {y:.4} {z:.4}")?;
    }
    for [a, b, c] in mesh.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + 1)) {
        writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
    }
    Ok(())
}

fn write_ply(out: &mut impl Write, mesh: &Mesh, comments: &[String]) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    comments.iter().try_for_each(|comment| writeln!(out, "comment {comment}"))?;
    writeln!(out, "element vertex {}", mesh.positions.len())?;
    ["x", "y", "z", "nx", "ny", "nz"].iter().try_for_each(|name| writeln!(out, "property float {name}"))?;
    ["red", "green", "blue"].iter().try_for_each(|name| writeln!(out, "property uchar {name}"))?;
    writeln!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header", mesh.triangles.len())?;
    for ((position, normal), color) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.colors) {
        position.iter().chain(normal).try_for_each(|number| out.write_all(&number.to_le_bytes()))?;
        out.write_all(&color.map(|channel| (255.0 * channel).round().clamp(0.0, 255.0) as u8))?;
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        triangle.iter().try_for_each(|vertex| out.write_all(&vertex.to_le_bytes()))?;
    }
    Ok(())
}
