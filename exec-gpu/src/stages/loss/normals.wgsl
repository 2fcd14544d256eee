// Normal loss: rendered normals against those of the depth, and its gradients (stage `loss`).
//
// Threads: one workgroup a tile, one invocation a pixel.
// Memory: gradients of the depths around each pixel, of the tile and its border, in workgroup
// memory.
// Inputs: blended normals, depth and transmittance; marks of the tiles; camera.
// Outputs: gradients of normals, depth and transmittance; sum of the loss over each tile.
// Variants: form of the loss, number of channels.
// Early exit: tiles without a visible splat have no loss.

@group(0) @binding(4) var<storage, read> marks: array<u32>;
@group(0) @binding(5) var<storage, read_write> grads: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;
@group(0) @binding(7) var<uniform> camera: Camera;

// Width of a tile with a border of one pixel.
const WIDE: u32 = TILE_EDGE + 2u;

// Gradients of the depths to the left, right, above and below of each pixel.
var<workgroup> of_depths: array<vec4f, WIDE * WIDE>;

fn store_grad(channel: u32, index: u32, grad: f32) {
    grads[channel * pixel_count() + index] = grad;
}

fn blended_at(channel: u32, index: u32) -> f32 {
    return blended[channel * pixel_count() + index];
}

// Depths to the left, right, above and below of a pixel with neighbours on all sides.
fn depths_around(index: u32) -> vec4f {
    let width = settings.size.x;
    return vec4f(
        blended_at(DEPTH_CHANNEL, index - 1u),
        blended_at(DEPTH_CHANNEL, index + 1u),
        blended_at(DEPTH_CHANNEL, index - width),
        blended_at(DEPTH_CHANNEL, index + width),
    );
}

fn normal_at(index: u32) -> vec3f {
    return vec3f(
        blended_at(NORMAL_CHANNEL, index),
        blended_at(NORMAL_CHANNEL + 1u, index),
        blended_at(NORMAL_CHANNEL + 2u, index),
    );
}

// Loss of a pixel. Stores the gradients of the depths around it, and that of its normal if it
// belongs to the tile.
fn compare_at(pixel: vec2u, slot: u32, is_inside_tile: bool) -> f32 {
    of_depths[slot] = vec4f(0.0);
    let around = vec4f(
        known_transmittance(pixel - vec2u(1u, 0u)),
        known_transmittance(pixel + vec2u(1u, 0u)),
        known_transmittance(pixel - vec2u(0u, 1u)),
        known_transmittance(pixel + vec2u(0u, 1u)),
    );
    let weight = normal_weight(known_transmittance(pixel), around);
    // False for NaN.
    if !(weight > 0.0) {
        return 0.0;
    }
    let index = index_of(pixel);
    let loss = normal_loss(vec2f(pixel) + 0.5, weight, normal_at(index), around, depths_around(index));
    of_depths[slot] = loss.of_depths;
    if !is_inside_tile {
        return 0.0;
    }
    store_grad(NORMAL_CHANNEL, index, loss.of_rendered.x);
    store_grad(NORMAL_CHANNEL + 1u, index, loss.of_rendered.y);
    store_grad(NORMAL_CHANNEL + 2u, index, loss.of_rendered.z);
    return loss.value;
}

// Gathers the gradients of a pixel's depth from its neighbours, and passes them to the blended
// channels.
fn gather(index: u32, slot: u32) {
    let across = of_depths[slot + 1u].x + of_depths[slot - 1u].y;
    let down = of_depths[slot + WIDE].z + of_depths[slot - WIDE].w;
    let grad = depth_grad(blended_at(DEPTH_CHANNEL, index), transmittance_at(index), across + down);
    store_grad(DEPTH_CHANNEL, index, grad.of_blended);
    grads[CHANNELS * pixel_count() + index] += grad.of_transmittance;
}

@compute @workgroup_size(TILE_EDGE, TILE_EDGE)
fn compare_normals(
    @builtin(workgroup_id) tile: vec3u,
    @builtin(local_invocation_id) position: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = tile_index(tile.xy);
    let slot_of_sum = 3u * settings.tiles.x * settings.tiles.y + number;
    let first = tile.xy * TILE_EDGE;
    let pixel = first + position.xy;
    if (marks[number] & IS_RENDERED) == 0u {
        if local == 0u {
            sums[slot_of_sum] = 0.0;
        }
        return;
    }
    var loss = 0.0;
    for (var slot = local; slot < WIDE * WIDE; slot += LOSS_GROUP) {
        let within = vec2u(slot % WIDE, slot / WIDE) - 1u;
        loss += compare_at(first + within, slot, all(within < vec2u(TILE_EDGE)));
    }
    workgroupBarrier();
    if is_inside(pixel) {
        gather(index_of(pixel), (position.y + 1u) * WIDE + position.x + 1u);
    }
    let sum = sum_of_group(local, loss);
    if local == 0u {
        sums[slot_of_sum] = sum;
    }
}
