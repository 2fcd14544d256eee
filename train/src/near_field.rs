//! Near field of a scene under training: its own surface, for reflected rays.

use specula_core::{
    camera::Camera,
    near_field::NearField,
    rules::Channels,
    scene::{Gaussians, Image},
};
use specula_mesh::{fusion::Fusion, near_field::SurfaceMeans};

/// Largest number of views that are fused.
const VIEWS_MAX: usize = 100;
/// Longest edge of a fused view, in pixels.
const EDGE_MAX: u32 = 800;

/// Near field of a scene as some cameras see it; none where they see no surface, or where it
/// reflects nothing of itself.
///
/// `render` renders a view without light, with these channels.
///
/// # Errors
///
/// An error of `render`.
pub fn fused<Error>(
    gaussians: &Gaussians<Vec<f32>>,
    cameras: &[Camera],
    voxels: u16,
    render: &mut impl FnMut(&Camera, Channels) -> Result<Image<Vec<f32>>, Error>,
) -> Result<Option<NearField<Vec<f32>>>, Error> {
    if gaussians.count == 0 {
        return Ok(None);
    }
    let cameras: Vec<Camera> = evenly_spaced(cameras).map(limited).collect();
    let mut fusion = Fusion::around(gaussians, voxels);
    for camera in &cameras {
        fusion.add(camera, &render(camera, Channels::Training)?);
    }
    let mut means = SurfaceMeans::new(fusion.mesh(), fusion.voxel_size());
    for camera in &cameras {
        means.add(camera, &render(camera, Channels::Layers)?);
    }
    let positions: Vec<_> = cameras.iter().map(|camera| camera.position).collect();
    Ok(means.near_field().filter(|near_field| specula_mesh::near_field::reflects_itself(near_field, &positions)))
}

/// Cameras in their order, at most [`VIEWS_MAX`] of them.
fn evenly_spaced(cameras: &[Camera]) -> impl Iterator<Item = &Camera> {
    let count = cameras.len().min(VIEWS_MAX);
    (0..count).map(move |k| &cameras[k * cameras.len() / count])
}

/// Camera of at most [`EDGE_MAX`] pixels along its longest edge.
fn limited(camera: &Camera) -> Camera {
    let longest = camera.width.max(camera.height);
    if longest <= EDGE_MAX {
        return *camera;
    }
    let [width, height] = [camera.width, camera.height].map(|edge| (edge * EDGE_MAX / longest).max(1));
    Camera { near: camera.near, ..camera.resized(width, height) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_taken_from_the_whole_set_and_made_smaller() {
        let camera =
            |x: u32| Camera::look_at(glam::vec3(x as f32, 0.0, 0.0), glam::Vec3::Y, glam::Vec3::Z, 0.7, 1600, 400);
        let all: Vec<Camera> = (0..250).map(camera).collect();
        let taken: Vec<f32> = evenly_spaced(&all).map(|camera| camera.position.x).collect();
        assert_eq!((taken.len(), taken[0], taken[99]), (VIEWS_MAX, 0.0, 247.0));
        assert_eq!(evenly_spaced(&all[..3]).count(), 3);
        let small = limited(&all[0]);
        assert_eq!((small.width, small.height), (800, 200));
        assert_eq!(limited(&small), small);
    }
}
