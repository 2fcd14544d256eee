// Gradient of the tile rasteriser, splat by splat: replays the splats of each segment, front to
// back.
//
// Threads: one workgroup a segment, one invocation every SPLATS-th splat. Blocks of BLOCK_WIDTH ×
// BLOCK_HEIGHT pixels pass from invocation to invocation: in step s, invocation k has block (s − k)
// % BLOCKS. After its last block it continues with its next splat and the first blocks, so only the
// first and the last steps have idle invocations.
// Memory: states of the pixels in workgroup memory, with their gradients where these fit; sums of a
// splat in registers, then in its slot, at its emission index. No sums over invocations are needed.
// The next splat is loaded during the replay of one.
// Inputs: segments, and the states of the pixels in front of them.
// Variants: size of the block, number of splats, number of channels.
// Early exit: once all pixels of the tile have terminated, and after the batch of emissions.

@group(0) @binding(8) var<storage, read> segments: array<Segment>;
@group(0) @binding(9) var<storage, read> states: array<vec2f>;

// Steps between two tests whether all pixels have terminated.
const STEPS_AT_ONCE: u32 = 8u;

var<workgroup> transmittances: array<Pixels, BLOCKS>;
var<workgroup> remainders: array<Pixels, BLOCKS>;
// Vector after vector, each of all blocks.
var<workgroup> grads: array<vec4f, select(1u, BLOCK_VECTORS * BLOCKS, KEEPS_GRADS)>;
// First splat after which all pixels have terminated.
var<workgroup> over_at: u32;

var<private> sums: array<f32, SLOT>;
// First state of the segment.
var<private> first_state: u32;

// Next splat to replay, its emission and its channels.
var<private> next_splat: Splat;
var<private> next_emission: u32;
var<private> next_color: array<vec4f, CHANNEL_VECTORS>;

fn store_sum(number: u32, value: f32) {
    sums[number] += value;
}

fn state(pixel: u32) -> vec2f {
    let at = pixel_at(pixel) % TILE_EDGE;
    return states[first_state + at.y * TILE_EDGE + at.x];
}

fn transmittance_in_front(pixel: u32) -> f32 {
    return state(pixel).x;
}

fn remaining_in_front(pixel: u32) -> f32 {
    return state(pixel).y;
}

// Reads the state of all blocks in front of the segment.
fn start_blocks(tile: vec2u, local: u32) {
    for (var block = local; block < BLOCKS; block += SPLATS) {
        corner = corner_of(tile, block);
        replay_resume();
        transmittances[block] = transmittance;
        remainders[block] = remaining;
        if KEEPS_GRADS {
            read_pixel_grads();
            keep_grads(block);
        }
    }
}

// Replays a splat over a block; returns the sum of the transmittances behind it.
fn replay_block(tile: vec2u, block: u32, splat: Splat) -> f32 {
    corner = corner_of(tile, block);
    if KEEPS_GRADS {
        read_kept_grads(block);
    } else {
        read_pixel_grads();
    }
    transmittance = transmittances[block];
    remaining = remainders[block];
    let over = replay_splat(splat.root, splat.log2_opacity, vec2f(corner) + 0.5 - splat.mean2d);
    transmittances[block] = transmittance;
    remainders[block] = remaining;
    return over.transmittance_sum;
}

fn read_next(pair: u32, end: u32) {
    if pair < end {
        let gaussian = gaussians_of[pair];
        next_emission = emissions_of[pair];
        next_splat = splats[gaussian];
        read_next_color(gaussian);
    }
}

// First splat of a segment after the batch of emissions, which ascend within a tile.
fn end_of_batch(segment: Segment) -> u32 {
    var low = segment.first;
    var high = segment.end;
    if low < high && emissions_of[high - 1u] < batch.end {
        return high;
    }
    while low < high {
        let middle = (low + high) / 2u;
        if emissions_of[middle] < batch.end {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

// Steps until the last of some splats has processed the last block.
fn steps_of(count: u32) -> u32 {
    if count == 0u {
        return 0u;
    }
    return (count - 1u) / SPLATS * BLOCKS + (count - 1u) % SPLATS + BLOCKS;
}

@compute @workgroup_size(SPLATS)
fn blend_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = group.y * groups.x + group.x;
    if number >= arrayLength(&segments) {
        return;
    }
    let segment = segments[number];
    let end = end_of_batch(segment);
    if segment.first == end || emissions_of[end - 1u] < batch.first {
        return;
    }
    if segment.is_over != 0u {
        clear_slots(segment.first, end, local, SPLATS);
        return;
    }
    let tile = vec2u(segment.tile % camera.tiles.x, segment.tile / camera.tiles.x);
    first_state = number * TILE_EDGE * TILE_EDGE;
    start_blocks(tile, local);
    if local == 0u {
        over_at = end;
    }
    workgroupBarrier();

    let steps = steps_of(end - segment.first);
    var own = segment.first + local;
    read_next(own, end);
    var splat: Splat;
    var emission: u32;
    var transmittance_sum = 0.0;
    for (var step = 0u; step < steps; step++) {
        if local <= step && own < end {
            let block = (step - local) % BLOCKS;
            if block == 0u {
                splat = next_splat;
                emission = next_emission;
                color = next_color;
                sums = array<f32, SLOT>();
                transmittance_sum = 0.0;
                read_next(own + SPLATS, end);
            }
            transmittance_sum += replay_block(tile, block, splat);
            if block == BLOCKS - 1u {
                if has_slot(emission) {
                    write_slot((emission - batch.first) * SLOT);
                }
                // At most one invocation finishes a splat in a step, and splats finish in order.
                if transmittance_sum == 0.0 {
                    over_at = min(over_at, own + 1u);
                }
                own += SPLATS;
            }
        }
        if step % STEPS_AT_ONCE != STEPS_AT_ONCE - 1u {
            workgroupBarrier();
        } else if workgroupUniformLoad(&over_at) < end {
            break;
        }
    }
    // Splats that finished after the last contributing one have written their slots.
    storageBarrier();
    clear_slots(workgroupUniformLoad(&over_at), end, local, SPLATS);
}
