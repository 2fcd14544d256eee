// Which tiles a splat touches: `specula_core::bin`, function by function.

struct Outline {
    center: vec2f,
    slope: f32,
    half_width: vec2f,
    extreme_y: f32,
    reach_y: f32,
}

fn outline(mean2d: vec2f, root_conic: vec3f, reach: f32) -> Outline {
    let a = root_conic.x * root_conic.x + root_conic.y * root_conic.y;
    let b = root_conic.y * root_conic.z;
    let c = root_conic.z * root_conic.z;
    let per_a = 1.0 / a;
    // a c − b² without its cancellation.
    let determinant = root_conic.x * root_conic.x * c;
    let reach_squared = reach * reach;
    let reach_y = sqrt(reach_squared * a / determinant);
    let half_width = vec2f(reach_squared * per_a, determinant * per_a * per_a);
    let extreme_y = -b / c * sqrt(reach_squared * c / determinant);
    return Outline(mean2d, -b * per_a, half_width, extreme_y, reach_y);
}

fn half_width_at(shape: Outline, y: f32) -> f32 {
    return sqrt(max(shape.half_width.x - shape.half_width.y * y * y, 0.0));
}

// Leftmost and rightmost x within a band of y; the second is smaller where the outline misses the band.
fn span_in_rows(shape: Outline, top: f32, bottom: f32) -> vec2f {
    let low = top - shape.center.y;
    let high = bottom - shape.center.y;
    if !(shape.reach_y < F32_MAX) {
        return vec2f(-F32_MAX, F32_MAX);
    }
    if low > shape.reach_y || high < -shape.reach_y {
        return vec2f(1.0, -1.0);
    }
    let leftmost = clamp(-shape.extreme_y, low, high);
    let rightmost = clamp(shape.extreme_y, low, high);
    return vec2f(
        shape.center.x + shape.slope * leftmost - half_width_at(shape, leftmost),
        shape.center.x + shape.slope * rightmost + half_width_at(shape, rightmost),
    );
}

// First and past-the-last tile along an axis that the interval touches.
fn tile_range(low: f32, high: f32, tile_count: u32) -> vec2u {
    if !(low <= high) {
        return vec2u(0u, 0u);
    }
    let count = f32(tile_count);
    let first = clamp(floor(low / TILE_SIZE), -1.0, count);
    let last = clamp(floor(high / TILE_SIZE), -1.0, count);
    return vec2u(u32(max(first, 0.0)), u32(min(last + 1.0, count)));
}

fn outline_of(splat: Splat) -> Outline {
    return outline(splat.mean2d, splat.root / ROOT_SCALE, splat.reach);
}

fn rows_of(splat: Splat) -> vec2u {
    return tile_range(splat.mean2d.y - splat.half_extent.y, splat.mean2d.y + splat.half_extent.y, camera.tiles.y);
}

fn columns_in_row(shape: Outline, row: u32) -> vec2u {
    let top = f32(row) * TILE_SIZE;
    let span = span_in_rows(shape, top, top + TILE_SIZE);
    return tile_range(span.x, span.y, camera.tiles.x);
}

// Number of tiles that a splat touches.
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
