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

// Where the first mean across lies.
fn place_across(local: u32) -> u32 {
    return local / 4u * WIDE + 4u * (local % 4u);
}
