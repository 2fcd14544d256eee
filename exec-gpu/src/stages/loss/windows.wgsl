// Windows of SSIM, first down and then across: a row of means for each row of a tile, with what lies beside it.

const REACH: u32 = SSIM_WINDOW / 2u;
const WIDE: u32 = TILE_EDGE + 2u * REACH;
// Windows below one another that an invocation looks at.
const DOWN: u32 = 8u;
const DOWN_GROUP: u32 = WIDE * TILE_EDGE / DOWN;

var<workgroup> rows: array<Means, WIDE * TILE_EDGE>;

// The first pixel that an invocation looks at; left of the picture or above it numbers wrap to what no picture has.
fn first_down(tile: vec2u, local: u32) -> vec2u {
    return tile * TILE_EDGE + vec2u(local % WIDE, local / WIDE * DOWN) - REACH;
}

// Where the first of its means belongs.
fn place_down(local: u32) -> u32 {
    return local / WIDE * DOWN * WIDE + local % WIDE;
}

// Puts the means of windows below one another where they belong.
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

// Where the first mean across lies.
fn place_across(local: u32) -> u32 {
    return local / 4u * WIDE + 4u * (local % 4u);
}
