//! Camera of a kernel, and the camera as a parameter of formulas.

use crate::codegen::{
    formula::{Field, Inputs, variable},
    source::Source,
    uniform::uniform,
};
use core::ops::Range;
use specula_core::{
    bin::tile_count,
    camera::{Camera, CameraOf},
    light_frame::LightFrame,
    real::Real,
    vector::{Mat3, Vec3},
};

uniform! {
    /// Camera, with the range of Gaussians that a dispatch processes.
    pub(crate) struct CameraUniform {
        row_x: [f32; 3],
        gaussian_count: u32,
        row_y: [f32; 3],
        /// Index of the first Gaussian in larger arrays.
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
        /// Columns of tiles that are rendered: the first, and one past the last.
        window_columns: [u32; 2],
        /// Rows likewise.
        window_rows: [u32; 2],
        padding_window: [u32; 2],
        light_x: [f32; 3],
        padding_light_x: u32,
        light_y: [f32; 3],
        padding_light_y: u32,
        light_z: [f32; 3],
        padding_light_z: u32,
    }
}

/// Rows of the rotation of a light that stands still.
const IDENTITY: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl CameraUniform {
    /// Camera for `gaussian_count` Gaussians.
    pub(crate) fn new(camera: &Camera, gaussian_count: usize) -> Self {
        Self::with_range(camera, 0..gaussian_count)
    }
    /// A camera, and a range of Gaussians within a larger array.
    pub(crate) fn with_range(camera: &Camera, gaussians: Range<usize>) -> Self {
        let (lifted, window) = (camera.lift(0.0_f32), camera.tile_window());
        let [row_x, row_y, row_z] = lifted.camera_from_world.rows.map(Vec3::to_array);
        let [light_x, light_y, light_z] =
            lifted.light.light_from_world.map_or(IDENTITY, |light| light.rows.map(Vec3::to_array));
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
            window_columns: window.columns,
            window_rows: window.rows,
            padding_window: [0; 2],
            light_x,
            padding_light_x: 0,
            light_y,
            padding_light_y: 0,
            light_z,
            padding_light_z: 0,
        }
    }
    /// Number of tiles of the image.
    pub(crate) fn tile_count(&self) -> usize {
        self.tiles[0] as usize * self.tiles[1] as usize
    }
    /// Tiles along x and y.
    pub(crate) fn tiles(&self) -> [u32; 2] {
        self.tiles
    }
    /// Number of pixels of the image.
    pub(crate) fn pixel_count(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }
}

/// Appends the structure `Camera`.
pub(crate) fn camera(source: Source) -> Source {
    source.uniform::<CameraUniform>()
}

/// The shader's variable `camera` as parameters, in the order of [`take_camera`].
pub(crate) fn camera_fields() -> [Field; 8] {
    [
        variable("camera.row_x", 3),
        variable("camera.row_y", 3),
        variable("camera.row_z", 3),
        variable("camera.position", 3),
        variable("camera.focal_px", 2),
        variable("camera.principal_px", 2),
        variable("camera.slope_limit", 2),
        variable("camera.near", 1),
    ]
}

/// Reads a camera from a formula's inputs, without its light ([`take_light_frame`]).
pub(crate) fn take_camera<R: Real>(inputs: &mut Inputs<'_, R>) -> CameraOf<R> {
    CameraOf {
        camera_from_world: Mat3 { rows: [inputs.vec3(), inputs.vec3(), inputs.vec3()] },
        position: inputs.vec3(),
        focal_px: inputs.array(),
        principal_px: inputs.array(),
        slope_limit: inputs.array(),
        near: inputs.number(),
        light: LightFrame::WORLD,
    }
}

/// Frame of the light of the shader's variable `camera` as parameters, if the light is turned.
pub(crate) fn light_frame_fields(is_turned: bool) -> impl Iterator<Item = Field> {
    let rows = is_turned.then_some(["camera.light_x", "camera.light_y", "camera.light_z"]);
    rows.into_iter().flatten().map(|row| variable(row, 3))
}

/// Reads [`light_frame_fields`] from a formula's inputs.
pub(crate) fn take_light_frame<R: Real>(inputs: &mut Inputs<'_, R>, is_turned: bool) -> LightFrame<R> {
    let rows = is_turned.then(|| [inputs.vec3(), inputs.vec3(), inputs.vec3()]);
    LightFrame { light_from_world: rows.map(|rows| Mat3 { rows }) }
}
