

const REACH: u32 = SSIM_WINDOW / 2u;
const WIDE: u32 = TILE_EDGE + 2u * REACH;
// Consecutive windows that an invocation averages down.
const DOWN: u32 = 8u;
const DOWN_GROUP: u32 = WIDE * TILE_EDGE / DOWN;

var<workgroup> rows: array<Means, WIDE * TILE_EDGE>;

// First pixel of an invocation; left of and above the image, coordinates wrap to values outside
// any image.
fn first_down(tile: vec2u, local: u32) -> vec2u {
    return tile * TILE_EDGE + vec2u(local % WIDE, local / WIDE * DOWN) - REACH;
}

// Index of an invocation's first vertical mean.
fn column_index(local: u32) -> u32 {
    return local / WIDE * DOWN * WIDE + local % WIDE;
}

// Stores the vertical means of an invocation.
fn store_means(index: u32, means: MeansDown) {
    rows[index] = means.mean_0;
    rows[index + WIDE] = means.mean_1;
    rows[index + 2u * WIDE] = means.mean_2;
    rows[index + 3u * WIDE] = means.mean_3;
    rows[index + 4u * WIDE] = means.mean_4;
    rows[index + 5u * WIDE] = means.mean_5;
    rows[index + 6u * WIDE] = means.mean_6;
    rows[index + 7u * WIDE] = means.mean_7;
}

// Index of an invocation's first mean across.
fn row_index(local: u32) -> u32 {
    return local / 4u * WIDE + 4u * (local % 4u);
}
