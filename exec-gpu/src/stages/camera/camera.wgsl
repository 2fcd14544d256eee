// Declarations: camera, and the range of Gaussians of a dispatch; `CameraUniform` of
// `camera/mod.rs`.

struct Camera {
    row_x: vec3f,
    gaussian_count: u32,
    row_y: vec3f,
    // Index of the first Gaussian in larger arrays.
    first_gaussian: u32,
    row_z: vec3f,
    near: f32,
    position: vec3f,
    padding_position: u32,
    focal_px: vec2f,
    principal_px: vec2f,
    slope_limit: vec2f,
    tiles: vec2u,
    size: vec2u,
    padding_size: vec2u,
}
