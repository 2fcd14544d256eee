// Losses of an image: declarations of all kernels.

// Shares are weights over the number of values that a loss is a mean of.
struct LossSettings {
    background: vec3f,
    absolute: f32,
    squared: f32,
    structure: f32,
    coverage: f32,
    sparse_coverage: f32,
    residual_image: f32,
    normal: f32,
    size: vec2u,
    tiles: vec2u,
    padding: vec2u,
}

// Marks of a tile: whether anything but the background shows in the rendered picture, and in the
// true one.
const IS_RENDERED: u32 = 1u;
const IS_TRUE: u32 = 2u;

@group(0) @binding(0) var<uniform> settings: LossSettings;
@group(0) @binding(1) var<storage, read> blended: array<f32>;
@group(0) @binding(2) var<storage, read> colors: array<f32>;
@group(0) @binding(3) var<storage, read> texels: array<u32>;

var<workgroup> parts: array<LossSum, LOSS_GROUP>;

// Sum over all invocations, in a fixed order.
fn sum_of_group(local: u32, own: LossSum) -> LossSum {
    parts[local] = own;
    workgroupBarrier();
    for (var reach = LOSS_GROUP / 2u; reach > 0u; reach /= 2u) {
        if local < reach {
            parts[local] += parts[local + reach];
        }
        workgroupBarrier();
    }
    return parts[0];
}

fn pixel_count() -> u32 {
    return settings.size.x * settings.size.y;
}

fn place_of(pixel: vec2u) -> u32 {
    return pixel.y * settings.size.x + pixel.x;
}

fn number_of(tile: vec2u) -> u32 {
    return tile.y * settings.tiles.x + tile.x;
}

fn is_inside(pixel: vec2u) -> bool {
    return all(pixel < settings.size);
}

fn transmittance_at(place: u32) -> f32 {
    return blended[CHANNELS * pixel_count() + place];
}

// Whether a pixel lies in the picture, and something is known of it.
fn is_known(pixel: vec2u) -> bool {
    if !is_inside(pixel) {
        return false;
    }
    return texels[place_of(pixel)] != UNKNOWN;
}

// Outside the picture, and where nothing is known of it, nothing is covered.
fn passed_at(pixel: vec2u) -> f32 {
    if is_known(pixel) {
        return transmittance_at(place_of(pixel));
    }
    return 1.0;
}

// One of red, green, blue, alpha.
fn byte_of(texel: u32, channel: u32) -> f32 {
    return f32((texel >> (8u * channel)) & 255u);
}

// The first of the four pixels of a tile that are an invocation's own; the others are to its right.
fn own_pixels(tile: vec2u, local: u32) -> vec2u {
    return tile * TILE_EDGE + vec2u(4u * (local % 4u), local / 4u);
}
