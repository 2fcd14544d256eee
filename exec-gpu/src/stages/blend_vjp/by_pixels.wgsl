// Gradient of the tile rasteriser, pixel by pixel: replays the splats of each tile, front to back.
//
// Threads: one workgroup a tile, one invocation a block of BLOCK_WIDTH × BLOCK_HEIGHT pixels.
// Memory: invocations store the sums over their pixels of SPLATS_AT_ONCE splats in workgroup
// memory; their totals go to slots in storage, one for each tile-splat pair, at its emission index.
// Variants: size of the block, number of channels.
// Early exit: once all pixels of the tile have terminated, and after the batch of emissions.

@group(0) @binding(8) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(9) var<storage, read> frame: array<f32>;

const INVOCATIONS: u32 = BLOCKS;
// A row of sums has one number more than invocations, so rows begin in different memory banks.
const ROW: u32 = INVOCATIONS + 1u;
// Bit of `contributions` for pixels that have not terminated; the lowest bits are those of the
// splats.
const IS_ACTIVE: u32 = 1u << 31u;

var<workgroup> sums: array<f32, SPLATS_AT_ONCE * SLOT * ROW>;
var<workgroup> contributions: array<atomic<u32>, 2>;
var<workgroup> is_over: u32;

// First of the sums that the invocation stores next.
var<private> first_sum: u32;

fn store_sum(number: u32, value: f32) {
    sums[first_sum + number * ROW] = value;
}

// Replays splats; returns a bit for each splat that contributes to a pixel of the invocation.
fn replay_splats(first: u32, count: u32, local: u32) -> u32 {
    let point = vec2f(corner) + 0.5;
    var contributes = 0u;
    var transmittance_sum = 0.0;
    for (var k = 0u; k < count; k++) {
        let gaussian = gaussians_of[first + k];
        let splat = splats[gaussian];
        read_color(gaussian);
        first_sum = k * SLOT * ROW + local;
        let over = replay_splat(splat.root, splat.log2_opacity, point - splat.mean2d);
        contributes |= select(0u, 1u << k, over.weight > 0.0);
        transmittance_sum = over.transmittance_sum;
    }
    return contributes | select(0u, IS_ACTIVE, transmittance_sum > 0.0);
}

// The sum over the invocations, four side by side.
fn sum_of_row(row: u32) -> f32 {
    var parts = vec4f(0.0);
    let end = row * ROW + INVOCATIONS;
    for (var k = row * ROW; k < end; k += 4u) {
        parts += vec4f(sums[k], sums[k + 1u], sums[k + 2u], sums[k + 3u]);
    }
    return parts.x + parts.y + (parts.z + parts.w);
}

fn write_slots(first: u32, count: u32, contributing: u32, local: u32) {
    for (var row = local; row < count * SLOT; row += INVOCATIONS) {
        let k = row / SLOT;
        let emission = emissions_of[first + k];
        if has_slot(emission) {
            var sum = 0.0;
            if (contributing >> k & 1u) != 0u {
                sum = sum_of_row(row);
            }
            slots[(emission - batch.first) * SLOT + row % SLOT] = sum;
        }
    }
}

@compute @workgroup_size(INVOCATIONS)
fn blend_vjp(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    corner = corner_of(tile.xy, local);
    replay_start();
    if local < 2u {
        atomicStore(&contributions[local], 0u);
    }
    workgroupBarrier();

    var first = range.x;
    var parity = 0u;
    // Within a tile emissions ascend: nothing remains after the batch.
    while first < range.y && emissions_of[first] < batch.end {
        let count = min(SPLATS_AT_ONCE, range.y - first);
        atomicOr(&contributions[parity], replay_splats(first, count, local));
        if local == 0u {
            atomicStore(&contributions[1u - parity], 0u);
        }
        workgroupBarrier();
        let contributing = atomicLoad(&contributions[parity]);
        write_slots(first, count, contributing, local);
        if local == 0u {
            is_over = select(1u, 0u, (contributing & IS_ACTIVE) != 0u);
        }
        first += count;
        parity = 1u - parity;
        if workgroupUniformLoad(&is_over) != 0u {
            break;
        }
    }
    clear_slots(first, range.y, local, INVOCATIONS);
}
