//! Near field of a scene under training: its own surface, for reflected rays and for occluding the
//! light of physical materials.

use core::num::NonZero;
use glam::Mat3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use specula_core::{
    camera::Camera,
    near_field::NearField,
    scene::{AMBIENT, Gaussians, Image, MEAN},
};
use specula_mesh::{
    ambient::Ambient,
    fusion::{Fusion, evenly_spaced, voxels_resolved},
    near_field::SurfaceMeans,
    sky::Sky,
    surface::Surface,
};

/// Largest number of views that are fused.
pub const VIEWS_MAX: usize = 100;
/// Longest edge of a fused view, in pixels.
const EDGE_MAX: u32 = 800;

/// Picture of a view without light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnlitPicture {
    /// Channels of training.
    Depths,
    /// All layers of view-dependent colours.
    Layers,
    /// All layers of physical materials.
    Materials,
}

/// Sky that a surface is under.
#[derive(Clone, Copy, Debug)]
pub struct UnderSky<'a> {
    /// Sky.
    pub sky: &'a Sky,
    /// Whether the sky lights the albedo of the surface, instead of its view-dependent colours.
    pub is_of_materials: bool,
}

/// Share of rays between parts of a surface below which it counts as unoccluded, since only
/// touching parts see each other.
const MET_MIN: f64 = 0.01;

/// Near field of a scene as some cameras see it; `None` if they see no surface, or if it neither
/// reflects itself nor, with physical materials, occludes light of `sky`.
///
/// `render` renders a view without light.
///
/// # Errors
///
/// An error of `render`.
pub fn fused<Error>(
    gaussians: &Gaussians<Vec<f32>>,
    cameras: &[Camera],
    voxels: u16,
    sky: Option<UnderSky<'_>>,
    render: &mut impl FnMut(&Camera, UnlitPicture) -> Result<Image<Vec<f32>>, Error>,
) -> Result<Option<Surroundings>, Error> {
    if gaussians.count == 0 {
        return Ok(None);
    }
    let cameras: Vec<Camera> =
        evenly_spaced(cameras, VIEWS_MAX).iter().map(|camera| camera.limited(EDGE_MAX)).collect();
    let mut fusion = Fusion::around(gaussians, voxels_resolved(voxels, &cameras));
    for camera in &cameras {
        fusion.add(camera, &render(camera, UnlitPicture::Depths)?);
    }
    let mut means = SurfaceMeans::new(fusion.mesh(), fusion.voxel_size());
    for camera in &cameras {
        means.add(camera, &render(camera, UnlitPicture::Layers)?);
        if gaussians.layout.is_physical {
            means.add_materials(camera, &render(camera, UnlitPicture::Materials)?);
        }
    }
    let Some(mut near_field) = means.near_field() else { return Ok(None) };
    if let Some(UnderSky { sky, is_of_materials: true }) = sky {
        specula_mesh::near_field::relight(&mut near_field, sky);
    }
    let positions: Vec<_> = cameras.iter().map(|camera| camera.position).collect();
    let surface = Surface::from(near_field);
    let ambient = sky.filter(|_| gaussians.layout.is_physical).map(|under| Ambient::new(&surface, under.sky));
    let is_met = ambient.as_ref().is_some_and(|ambient| ambient.met > MET_MIN);
    let is_needed = is_met || specula_mesh::near_field::reflects_itself(&surface, &positions);
    Ok(is_needed.then(|| Surroundings { near_field: surface.into_near_field(), ambient }))
}

/// Surface around a scene's own.
#[derive(Debug)]
pub struct Surroundings {
    /// The surface.
    pub near_field: NearField<Vec<f32>>,
    /// Light that reaches physical materials.
    pub ambient: Option<Ambient>,
}

/// Rotations of the lights of some views, if they turn.
pub(crate) fn lights_from_world(cameras: &[Camera]) -> Vec<Mat3> {
    evenly_spaced(cameras, VIEWS_MAX).iter().filter_map(|camera| camera.light_from_world).collect()
}

/// Sets the ambient transfer of physical Gaussians: the mean of those of the nearest vertices, or 1
/// without a surface.
pub fn set_ambient(gaussians: &mut Gaussians<Vec<f32>>, surroundings: Option<(&NearField<Vec<f32>>, &Ambient)>) {
    const NEAREST: usize = 4;
    let Some(plane) = gaussians.layout.physical_planes().map(|first| first + AMBIENT) else { return };
    let transfers: Vec<[f32; 3]> = match surroundings {
        None => vec![[1.0; 3]; gaussians.count],
        Some((near_field, ambient)) => {
            let position = |vertex: usize| {
                let [x, y, z, ..] = near_field.vertex(vertex);
                [x, y, z]
            };
            let positions: Vec<[f32; 3]> = (0..near_field.vertex_count).map(position).collect();
            let tree: ImmutableKdTree<f32, 3> =
                ImmutableKdTree::new_from_slice(&positions).expect("fewer than 2^32 finite points");
            let wanted = NonZero::new(NEAREST).expect("four is not zero");
            let means = &*gaussians;
            let transfer = |index: usize| {
                let mean = means.get::<3>(index, MEAN);
                let found = tree.query(&mean).nearest_n::<SquaredEuclidean<f32>>(wanted).execute();
                let sum = found.iter().fold([0.0; 3], |sum: [f32; 3], neighbour| {
                    let transfer = ambient.transfers[neighbour.item as usize];
                    core::array::from_fn(|k| sum[k] + transfer[k])
                });
                sum.map(|sum| sum / found.len().max(1) as f32)
            };
            (0..gaussians.count).map(transfer).collect()
        }
    };
    for (index, transfer) in transfers.into_iter().enumerate() {
        gaussians.set(index, plane, transfer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_made_smaller() {
        let camera = Camera::look_at(glam::Vec3::ZERO, glam::Vec3::Y, glam::Vec3::Z, 0.7, 1600, 400);
        let small = camera.limited(EDGE_MAX);
        assert_eq!((small.width, small.height), (800, 200));
        assert_eq!(small.limited(EDGE_MAX), small);
    }
}
