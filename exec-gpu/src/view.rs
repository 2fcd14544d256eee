//! A camera as shaders read it.

use bytemuck::{Pod, Zeroable};
use core::ops::Range;
use specula_core::{bin::tile_count, camera::Camera, vector::Vec3};

/// `Camera` of `camera.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(crate) struct View {
    row_x: [f32; 3],
    gaussian_count: u32,
    row_y: [f32; 3],
    first_gaussian: u32,
    row_z: [f32; 3],
    near: f32,
    position: [f32; 3],
    padding_position: u32,
    focal_px: [f32; 2],
    principal_px: [f32; 2],
    slope_limit: [f32; 2],
    tiles: [u32; 2],
    size: [u32; 2],
    padding_size: [u32; 2],
}

impl View {
    /// A camera, and how many Gaussians it looks at.
    pub(crate) fn new(camera: &Camera, gaussian_count: usize) -> Self {
        Self::of(camera, 0..gaussian_count)
    }
    /// A camera, and at which Gaussians of more it looks.
    pub(crate) fn of(camera: &Camera, gaussians: Range<usize>) -> Self {
        let lifted = camera.lift(0.0_f32);
        let [row_x, row_y, row_z] = lifted.camera_from_world.rows.map(Vec3::to_array);
        Self {
            row_x,
            gaussian_count: gaussians.len() as u32,
            row_y,
            first_gaussian: gaussians.start as u32,
            row_z,
            near: lifted.near,
            position: lifted.position.to_array(),
            padding_position: 0,
            focal_px: lifted.focal_px,
            principal_px: lifted.principal_px,
            slope_limit: lifted.slope_limit,
            tiles: [tile_count(camera.width), tile_count(camera.height)],
            size: [camera.width, camera.height],
            padding_size: [0; 2],
        }
    }
    /// Its bytes.
    pub(crate) fn bytes(&self) -> &[u8] {
        bytemuck::bytes_of(self)
    }
    pub(crate) fn tile_count(&self) -> usize {
        self.tiles[0] as usize * self.tiles[1] as usize
    }
    pub(crate) fn tiles(&self) -> [u32; 2] {
        self.tiles
    }
    pub(crate) fn pixel_count(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }
}
