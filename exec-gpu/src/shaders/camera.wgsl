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

// A Gaussian on the screen. Its root of the conic is scaled for powers of two.
struct Splat {
    mean2d: vec2f,
    log2_opacity: f32,
    opacity: f32,
    root: vec3f,
    reach: f32,
    half_extent: vec2f,
    depth: f32,
    padding: f32,
}

fn count_tiles(splat: Splat) -> u32 {
    let shape = outline_of(splat);
    let rows = rows_of(splat);
    var count = 0u;
    for (var row = rows.x; row < rows.y; row++) {
        let columns = columns_in_row(shape, row);
        count += max(columns.x, columns.y) - columns.x;
    }
    return count;
}
