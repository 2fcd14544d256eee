//! Depths, colours and coverage of a rendered view, pixel by pixel.

use glam::Vec3;
use specula_core::{
    camera::Camera,
    cutoffs::ALPHA_MIN,
    rules::{Channels, channel},
    scene::Image,
};

/// Depth, colour and coverage of each pixel of a camera.
#[derive(Clone, Debug)]
pub(crate) struct View {
    camera: Camera,
    pub(crate) depths: Vec<f32>,
    pub(crate) colors: Vec<[f32; 3]>,
    pub(crate) coverage: Vec<f32>,
}

impl View {
    pub(crate) fn new(camera: &Camera, image: &Image<Vec<f32>>) -> Self {
        let coverage: Vec<f32> = image.plane(image.channels - 1).iter().map(|passed| 1.0 - passed).collect();
        let channels = Channels::with_count(image.channels - 1);
        let depth = channels.and_then(|channels| channels.index_of(channel::DEPTH)).expect("the renderer has depths");
        let normalised = |sum: f32, pixel: usize| sum / coverage[pixel].max(ALPHA_MIN);
        let pixels = || 0..image.pixel_count();
        Self {
            camera: *camera,
            depths: pixels().map(|pixel| normalised(image.plane(depth)[pixel], pixel)).collect(),
            colors: pixels().map(|pixel| image.rgb(pixel).map(|sum| normalised(sum, pixel).clamp(0.0, 1.0))).collect(),
            coverage,
        }
    }

    /// Depth of a point and index of its pixel; `None` for a point outside of the picture.
    pub(crate) fn pixel(&self, point: Vec3) -> Option<(f32, usize)> {
        let Camera { camera_from_world, position, focal_px, principal_px, near, width, height, .. } = self.camera;
        let in_camera = camera_from_world * (point - position);
        if !(in_camera.z > near) {
            return None;
        }
        let coordinate = |axis: usize| focal_px[axis] * in_camera[axis] / in_camera.z + principal_px[axis];
        let (x, y) = (coordinate(0), coordinate(1));
        let is_inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        is_inside.then(|| (in_camera.z, y as usize * width as usize + x as usize))
    }
}
