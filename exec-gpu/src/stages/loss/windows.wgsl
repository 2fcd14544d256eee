// Declarations: means over SSIM's windows, down and then across. Workgroup memory holds a row of
// means for each row of a tile, with a border of half a window on either side.

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

// Averages a colour down, over the taps of the kernel's `tap_at`: eight means an invocation.
fn blur_down(tile: vec2u, c: u32, local: u32) {
    let first = first_down(tile, local);
    let step = vec2u(0u, 1u);
    let means = means_down(
        tap_at(first, c),
        tap_at(first + step, c),
        tap_at(first + 2u * step, c),
        tap_at(first + 3u * step, c),
        tap_at(first + 4u * step, c),
        tap_at(first + 5u * step, c),
        tap_at(first + 6u * step, c),
        tap_at(first + 7u * step, c),
        tap_at(first + 8u * step, c),
        tap_at(first + 9u * step, c),
        tap_at(first + 10u * step, c),
        tap_at(first + 11u * step, c),
        tap_at(first + 12u * step, c),
        tap_at(first + 13u * step, c),
        tap_at(first + 14u * step, c),
        tap_at(first + 15u * step, c),
        tap_at(first + 16u * step, c),
        tap_at(first + 17u * step, c),
    );
    let index = local / WIDE * DOWN * WIDE + local % WIDE;
    rows[index] = means.mean_0;
    rows[index + WIDE] = means.mean_1;
    rows[index + 2u * WIDE] = means.mean_2;
    rows[index + 3u * WIDE] = means.mean_3;
    rows[index + 4u * WIDE] = means.mean_4;
    rows[index + 5u * WIDE] = means.mean_5;
    rows[index + 6u * WIDE] = means.mean_6;
    rows[index + 7u * WIDE] = means.mean_7;
}

// Averages the rows across: means of the four pixels of an invocation.
fn blur_across(local: u32) -> MeansAcross {
    let first = local / 4u * WIDE + 4u * (local % 4u);
    return means_across(
        rows[first],
        rows[first + 1u],
        rows[first + 2u],
        rows[first + 3u],
        rows[first + 4u],
        rows[first + 5u],
        rows[first + 6u],
        rows[first + 7u],
        rows[first + 8u],
        rows[first + 9u],
        rows[first + 10u],
        rows[first + 11u],
        rows[first + 12u],
        rows[first + 13u],
    );
}
