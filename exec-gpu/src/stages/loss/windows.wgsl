// Windows of SSIM, first down and then across: a row of means for each row of a tile, with what
// lies beside it.

const REACH: u32 = SSIM_WINDOW / 2u;
const WIDE: u32 = TILE_EDGE + 2u * REACH;
// Windows below one another that an invocation looks at.
const DOWN: u32 = 8u;
const DOWN_GROUP: u32 = WIDE * TILE_EDGE / DOWN;

var<workgroup> rows: array<Means, WIDE * TILE_EDGE>;

// First pixel of an invocation; left of the image and above it, coordinates wrap to values outside
// of any image.
fn first_down(tile: vec2u, local: u32) -> vec2u {
    return tile * TILE_EDGE + vec2u(local % WIDE, local / WIDE * DOWN) - REACH;
}

// Index of an invocation's first vertical mean.
fn place_down(local: u32) -> u32 {
    return local / WIDE * DOWN * WIDE + local % WIDE;
}

// Stores the vertical means of an invocation.
fn put_down(place: u32, means: MeansDown) {
    rows[place] = means.mean_0;
    rows[place + WIDE] = means.mean_1;
    rows[place + 2u * WIDE] = means.mean_2;
    rows[place + 3u * WIDE] = means.mean_3;
    rows[place + 4u * WIDE] = means.mean_4;
    rows[place + 5u * WIDE] = means.mean_5;
    rows[place + 6u * WIDE] = means.mean_6;
    rows[place + 7u * WIDE] = means.mean_7;
}

// Index of an invocation's first mean across.
fn place_across(local: u32) -> u32 {
    return local / 4u * WIDE + 4u * (local % 4u);
}
