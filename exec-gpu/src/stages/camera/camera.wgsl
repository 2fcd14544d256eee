// A camera and what is seen through it, as `scene.rs` lays it out.

struct Camera {
    row_x: vec3f,
    gaussian_count: u32,
    row_y: vec3f,
    // Where the first of them lies in arrays that hold more.
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
