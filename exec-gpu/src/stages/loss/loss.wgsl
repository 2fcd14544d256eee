// Declarations: settings, images and tiles of the loss kernels, and the sum over a workgroup.

// Marks of a tile: the rendered image, or the target, shows more than the background.
const IS_RENDERED: u32 = 1u;
const IS_TRUE: u32 = 2u;

@group(0) @binding(0) var<uniform> settings: LossSettings;
@group(0) @binding(1) var<storage, read> blended: array<f32>;
@group(0) @binding(2) var<storage, read> colors: array<f32>;
@group(0) @binding(3) var<storage, read> texels: array<u32>;

var<workgroup> partial_sums: array<LossSum, LOSS_GROUP>;

// Sum over all invocations, in a fixed order.
fn sum_of_group(local: u32, value: LossSum) -> LossSum {
    partial_sums[local] = value;
    workgroupBarrier();
    for (var reach = LOSS_GROUP / 2u; reach > 0u; reach /= 2u) {
        if local < reach {
            partial_sums[local] += partial_sums[local + reach];
        }
        workgroupBarrier();
    }
    return partial_sums[0];
}

fn pixel_count() -> u32 {
    return settings.size.x * settings.size.y;
}

fn index_of(pixel: vec2u) -> u32 {
    return pixel.y * settings.size.x + pixel.x;
}

fn tile_index(tile: vec2u) -> u32 {
    return tile.y * settings.tiles.x + tile.x;
}

fn is_inside(pixel: vec2u) -> bool {
    return all(pixel < settings.size);
}

fn transmittance_at(index: u32) -> f32 {
    return blended[CHANNELS * pixel_count() + index];
}

// Red, green, blue and alpha of a target's pixel, a byte each.
fn texel_at(index: u32) -> u32 {
    return texels[TEXEL_WORDS * index];
}

// Colour of a target's pixel, 255 for white.
fn true_color(index: u32, c: u32) -> f32 {
    if !IS_UNCLIPPED {
        return byte_of(texel_at(index), c);
    }
    let halves = unpack2x16float(texels[TEXEL_WORDS * index + 1u + c / 2u]);
    return 255.0 * select(halves.x, halves.y, c == 1u);
}

// Tests whether a pixel is in the image and its target is not masked.
fn is_known(pixel: vec2u) -> bool {
    if !is_inside(pixel) {
        return false;
    }
    return texel_at(index_of(pixel)) != UNKNOWN;
}

// Transmittance; 1 outside the image and where the target is masked.
fn known_transmittance(pixel: vec2u) -> f32 {
    if is_known(pixel) {
        return transmittance_at(index_of(pixel));
    }
    return 1.0;
}

// One of red, green, blue, alpha.
fn byte_of(texel: u32, channel: u32) -> f32 {
    return f32((texel >> (8u * channel)) & 255u);
}

// First pixel of an invocation with four pixels in a row.
fn first_pixel(tile: vec2u, local: u32) -> vec2u {
    return tile * TILE_EDGE + vec2u(4u * (local % 4u), local / 4u);
}
