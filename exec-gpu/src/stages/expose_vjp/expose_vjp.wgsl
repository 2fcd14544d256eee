// Gradient of exposure (stage `expose_vjp`).
//
// Threads: one workgroup a tile, one invocation four pixels of a column.
// Memory: partial sums of the exposure's gradient in workgroup memory, added in a binary tree.
// Inputs: exposure, colours, transmittance; gradient of the exposed image.
// Outputs: gradient of the image, in place; sums of the exposure's gradient over each tile.

@group(0) @binding(3) var<storage, read_write> grads: array<f32>;
@group(0) @binding(4) var<storage, read_write> sums: array<f32>;

struct ExposureSum {
    red: vec4f,
    green: vec4f,
    blue: vec4f,
}

var<workgroup> partial_sums: array<ExposureSum, SUM_GROUP>;

fn plus(one: ExposureSum, other: ExposureSum) -> ExposureSum {
    return ExposureSum(one.red + other.red, one.green + other.green, one.blue + other.blue);
}

// Replaces the gradient of an exposed pixel by that of the image; returns that of the exposure.
fn pixel_vjp(pixel: vec2u) -> ExposureSum {
    if any(pixel >= exposure.size) {
        return ExposureSum();
    }
    let size = pixel_count();
    let index = pixel.y * exposure.size.x + pixel.x;
    let grad = vec3f(grads[index], grads[size + index], grads[2u * size + index]);
    let grads_of_pixel = expose_pixel_vjp(color_at(index), transmittance_at(index), grad);
    grads[index] = grads_of_pixel.color.x;
    grads[size + index] = grads_of_pixel.color.y;
    grads[2u * size + index] = grads_of_pixel.color.z;
    grads[CHANNELS * size + index] += grads_of_pixel.transmittance;
    return ExposureSum(grads_of_pixel.red, grads_of_pixel.green, grads_of_pixel.blue);
}

@compute @workgroup_size(SUM_GROUP)
fn expose_vjp(
    @builtin(workgroup_id) tile: vec3u,
    @builtin(num_workgroups) tiles: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let rows = SUM_GROUP / TILE_EDGE;
    let first = tile.xy * TILE_EDGE + vec2u(local % TILE_EDGE, local / TILE_EDGE);
    var sum = ExposureSum();
    for (var row = 0u; row < TILE_EDGE; row += rows) {
        sum = plus(sum, pixel_vjp(first + vec2u(0u, row)));
    }
    partial_sums[local] = sum;
    workgroupBarrier();
    for (var reach = SUM_GROUP / 2u; reach > 0u; reach /= 2u) {
        if local < reach {
            partial_sums[local] = plus(partial_sums[local], partial_sums[local + reach]);
        }
        workgroupBarrier();
    }
    // A row of the exposure for each of three invocations.
    if local < 3u {
        let total = partial_sums[0];
        var row = total.red;
        if local == 1u {
            row = total.green;
        }
        if local == 2u {
            row = total.blue;
        }
        let index = 12u * (tile.y * tiles.x + tile.x) + 4u * local;
        sums[index] = row.x;
        sums[index + 1u] = row.y;
        sums[index + 2u] = row.z;
        sums[index + 3u] = row.w;
    }
}
