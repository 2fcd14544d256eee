// Gradient of the tile rasteriser, splat by splat: replays the splats of each tile, front to back.
//
// Threads: one workgroup a tile, one invocation every SPLATS-th splat. Blocks of BLOCK_WIDTH ×
// BLOCK_HEIGHT pixels pass from invocation to invocation: in step s, invocation k has block
// (s − k) % BLOCKS. After its last block it goes on with its next splat, while the first blocks
// come back to it, so that only the first and the last steps have idle invocations.
// Memory: states of the pixels in workgroup memory, with their gradients where these fit; sums of
// a splat in registers, then in its slot, at its emission index. There is nothing to add up.
// Variants: size of the block, number of splats, number of channels.
// Early exit: once all pixels of the tile have terminated, and behind the batch of emissions.

// Steps between two tests whether all pixels have terminated.
const STEPS_AT_ONCE: u32 = 8u;

var<workgroup> transmittances: array<Pixels, BLOCKS>;
var<workgroup> remainders: array<Pixels, BLOCKS>;
// Vector after vector, each of all blocks.
var<workgroup> grads: array<vec4f, select(1u, BLOCK_VECTORS * BLOCKS, KEEPS_GRADS)>;
// The first splat behind which all pixels have terminated.
var<workgroup> over_at: u32;

var<private> sums: array<f32, SLOT>;

fn store_sum(number: u32, value: f32) {
    sums[number] += value;
}

// Stores the state of all blocks in front of the first splat.
fn start_blocks(tile: vec2u, local: u32) {
    for (var block = local; block < BLOCKS; block += SPLATS) {
        corner = corner_of(tile, block);
        replay_start();
        transmittances[block] = transmittance;
        remainders[block] = remaining;
        if KEEPS_GRADS {
            for (var k = 0u; k < BLOCK_VECTORS; k++) {
                grads[k * BLOCKS + block] = pixel_grads[k];
            }
        }
    }
}

fn read_grads(block: u32) {
    if KEEPS_GRADS {
        for (var k = 0u; k < BLOCK_VECTORS; k++) {
            pixel_grads[k] = grads[k * BLOCKS + block];
        }
        return;
    }
    for (var pixel = 0u; pixel < BLOCK_PIXELS; pixel++) {
        for (var c = 0u; c < CHANNELS; c++) {
            pixel_grads[pixel * CHANNEL_VECTORS + c / 4u][c % 4u] = grad_of_blended(pixel * (CHANNELS + 1u) + c);
        }
    }
}

// Replays a splat over a block; returns the sum of the transmittances behind it.
fn replay_block(tile: vec2u, block: u32, splat: Splat) -> f32 {
    corner = corner_of(tile, block);
    read_grads(block);
    transmittance = transmittances[block];
    remaining = remainders[block];
    let over = replay_splat(splat.root, splat.log2_opacity, vec2f(corner) + 0.5 - splat.mean2d);
    transmittances[block] = transmittance;
    remainders[block] = remaining;
    return over.transmittance_sum;
}

fn write_slot(splat: u32) {
    let emission = emissions_of[splat];
    if has_slot(emission) {
        for (var number = 0u; number < SLOT; number++) {
            slots[(emission - batch.first) * SLOT + number] = sums[number];
        }
    }
}

// The first splat of a tile behind the batch of emissions, which ascend within a tile.
fn end_of_batch(range: vec2u) -> u32 {
    var low = range.x;
    var high = range.y;
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

// Steps until the last of some splats has met the last block.
fn steps_of(count: u32) -> u32 {
    if count == 0u {
        return 0u;
    }
    return (count - 1u) / SPLATS * BLOCKS + (count - 1u) % SPLATS + BLOCKS;
}

@compute @workgroup_size(SPLATS)
fn blend_vjp(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    let end = end_of_batch(range);
    start_blocks(tile.xy, local);
    if local == 0u {
        over_at = end;
    }
    workgroupBarrier();

    let steps = steps_of(end - range.x);
    var own = range.x + local;
    var splat: Splat;
    var transmittance_sum = 0.0;
    for (var step = 0u; step < steps; step++) {
        if local <= step && own < end {
            let block = (step - local) % BLOCKS;
            if block == 0u {
                let gaussian = gaussians_of[own];
                splat = splats[gaussian];
                read_color(gaussian);
                sums = array<f32, SLOT>();
                transmittance_sum = 0.0;
            }
            transmittance_sum += replay_block(tile.xy, block, splat);
            if block == BLOCKS - 1u {
                write_slot(own);
                // At most one invocation ends a splat in a step, and splats end in their order.
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
    clear_slots(workgroupUniformLoad(&over_at), end, local, SPLATS);
}
