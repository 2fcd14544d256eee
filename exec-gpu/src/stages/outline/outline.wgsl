// Declarations: tiles that a splat touches, row by row; loads and conversions around the formulas
// of `specula_core::bin`.

// First and past-the-last row of tiles.
fn rows_of(splat: Splat) -> vec2u {
    return vec2u(tile_rows(splat.mean2d.y, splat.half_extent.y, vec2f(camera.window_rows)));
}

// First and past-the-last column of tiles in a row.
fn columns_in_row(shape: OutlineOf, row: u32) -> vec2u {
    return vec2u(tile_columns(
        shape.center,
        shape.slope,
        shape.half_width,
        shape.extreme_y,
        shape.reach_y,
        f32(row),
        vec2f(camera.window_columns),
    ));
}

fn count_tiles(splat: Splat) -> u32 {
    let shape = outline_of(splat.mean2d, splat.root, splat.reach);
    let rows = rows_of(splat);
    var count = 0u;
    for (var row = rows.x; row < rows.y; row++) {
        let columns = columns_in_row(shape, row);
        count += max(columns.x, columns.y) - columns.x;
    }
    return count;
}
