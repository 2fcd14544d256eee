//! Mesh of a scene by volumetric fusion ([`specula_mesh::fusion`]).

use crate::{SceneError, SceneRenderer};
use specula_core::{camera::Camera, scene::Gaussians};
use specula_io::mesh::Mesh;
use specula_mesh::fusion::Fusion;

/// Fuses the views of some cameras into a mesh. The volume is that of the Gaussians, with `voxels`
/// voxels along its longest edge.
///
/// `renderer` renders depths, so its channels are those of training or more. `progress` is given
/// the number of fused views after each.
///
/// # Errors
///
/// Those of [`SceneRenderer::render`].
///
/// # Panics
///
/// Without Gaussians, or with a renderer without depths.
pub fn fuse(
    renderer: &mut SceneRenderer,
    gaussians: &Gaussians<Vec<f32>>,
    cameras: &[Camera],
    voxels: u16,
    mut progress: impl FnMut(usize),
) -> Result<Mesh, SceneError> {
    let mut fusion = Fusion::around(gaussians, voxels);
    for (index, camera) in cameras.iter().enumerate() {
        fusion.add(camera, &renderer.render(camera)?);
        progress(index + 1);
    }
    let specula_mesh::Mesh { positions, normals, colors, triangles } = fusion.mesh();
    Ok(Mesh { positions, normals, colors, triangles })
}
