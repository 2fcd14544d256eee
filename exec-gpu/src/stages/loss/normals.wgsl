// Rendered normals against those of the depth, and their gradients: one workgroup a tile, one
// invocation a pixel.

@group(0) @binding(4) var<storage, read> marks: array<u32>;
@group(0) @binding(5) var<storage, read_write> grads: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;
@group(0) @binding(7) var<uniform> camera: Camera;

// A tile and the pixels around it.
const WIDE: u32 = TILE_EDGE + 2u;

// Gradients of the depths to the left, right, above and below of each pixel.
var<workgroup> of_depths: array<vec4f, WIDE * WIDE>;

fn put(channel: u32, place: u32, grad: f32) {
    grads[channel * pixel_count() + place] = grad;
}

fn blended_at(channel: u32, place: u32) -> f32 {
    return blended[channel * pixel_count() + place];
}

// Around a pixel that has neighbours on all sides: left, right, above, below.
fn depths_around(place: u32) -> vec4f {
    let width = settings.size.x;
    return vec4f(
        blended_at(DEPTH_CHANNEL, place - 1u),
        blended_at(DEPTH_CHANNEL, place + 1u),
        blended_at(DEPTH_CHANNEL, place - width),
        blended_at(DEPTH_CHANNEL, place + width),
    );
}

fn normal_at(place: u32) -> vec3f {
    return vec3f(
        blended_at(NORMAL_CHANNEL, place),
        blended_at(NORMAL_CHANNEL + 1u, place),
        blended_at(NORMAL_CHANNEL + 2u, place),
    );
}

// The loss of a pixel; leaves the gradients of the depths around it, and writes that of its normal
// where it belongs to the tile.
fn compare_at(pixel: vec2u, slot: u32, is_own: bool) -> f32 {
    of_depths[slot] = vec4f(0.0);
    let around = vec4f(
        passed_at(pixel - vec2u(1u, 0u)),
        passed_at(pixel + vec2u(1u, 0u)),
        passed_at(pixel - vec2u(0u, 1u)),
        passed_at(pixel + vec2u(0u, 1u)),
    );
    let weight = normal_weight(passed_at(pixel), around);
    // False for NaN.
    if !(weight > 0.0) {
        return 0.0;
    }
    let place = place_of(pixel);
    let loss = normal_loss(vec2f(pixel) + 0.5, weight, normal_at(place), around, depths_around(place));
    of_depths[slot] = loss.of_depths;
    if !is_own {
        return 0.0;
    }
    put(NORMAL_CHANNEL, place, loss.of_rendered.x);
    put(NORMAL_CHANNEL + 1u, place, loss.of_rendered.y);
    put(NORMAL_CHANNEL + 2u, place, loss.of_rendered.z);
    return loss.value;
}

// Gathers the gradients of a pixel's depth from its neighbours, and passes them to the blended
// channels.
fn gather(place: u32, slot: u32) {
    let across = of_depths[slot + 1u].x + of_depths[slot - 1u].y;
    let down = of_depths[slot + WIDE].z + of_depths[slot - WIDE].w;
    let own = depth_grad(blended_at(DEPTH_CHANNEL, place), transmittance_at(place), across + down);
    put(DEPTH_CHANNEL, place, own.of_blended);
    grads[CHANNELS * pixel_count() + place] += own.of_transmittance;
}

@compute @workgroup_size(TILE_EDGE, TILE_EDGE)
fn compare_normals(
    @builtin(workgroup_id) tile: vec3u,
    @builtin(local_invocation_id) position: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = number_of(tile.xy);
    let slot_of_sum = 3u * settings.tiles.x * settings.tiles.y + number;
    let first = tile.xy * TILE_EDGE;
    let pixel = first + position.xy;
    if (marks[number] & IS_RENDERED) == 0u {
        if local == 0u {
            sums[slot_of_sum] = 0.0;
        }
        return;
    }
    var own = 0.0;
    for (var slot = local; slot < WIDE * WIDE; slot += LOSS_GROUP) {
        let within = vec2u(slot % WIDE, slot / WIDE) - 1u;
        own += compare_at(first + within, slot, all(within < vec2u(TILE_EDGE)));
    }
    workgroupBarrier();
    if is_inside(pixel) {
        gather(place_of(pixel), (position.y + 1u) * WIDE + position.x + 1u);
    }
    let sum = sum_of_group(local, own);
    if local == 0u {
        sums[slot_of_sum] = sum;
    }
}
