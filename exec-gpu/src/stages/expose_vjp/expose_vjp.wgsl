// Gradient of exposure: replaces the gradient of the exposed image by that of the image, and sums
// that of the exposure over each tile. One workgroup a tile, four pixels of a column an invocation.

@group(0) @binding(3) var<storage, read_write> grads: array<f32>;
@group(0) @binding(4) var<storage, read_write> sums: array<f32>;

struct ExposureSum {
    red: vec4f,
    green: vec4f,
    blue: vec4f,
}

var<workgroup> parts: array<ExposureSum, SUM_GROUP>;

fn plus(one: ExposureSum, other: ExposureSum) -> ExposureSum {
    return ExposureSum(one.red + other.red, one.green + other.green, one.blue + other.blue);
}

// The gradient of a pixel of the photograph becomes that of the picture; returns that of the
// exposure.
fn pixel_vjp(pixel: vec2u) -> ExposureSum {
    if any(pixel >= exposure.size) {
        return ExposureSum();
    }
    let size = pixel_count();
    let place = pixel.y * exposure.size.x + pixel.x;
    let grad = vec3f(grads[place], grads[size + place], grads[2u * size + place]);
    let own = expose_pixel_vjp(color_at(place), passed_at(place), grad);
    grads[place] = own.color.x;
    grads[size + place] = own.color.y;
    grads[2u * size + place] = own.color.z;
    grads[CHANNELS * size + place] += own.passed;
    return ExposureSum(own.red, own.green, own.blue);
}

@compute @workgroup_size(SUM_GROUP)
fn expose_vjp(
    @builtin(workgroup_id) tile: vec3u,
    @builtin(num_workgroups) tiles: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let rows = SUM_GROUP / TILE_EDGE;
    let first = tile.xy * TILE_EDGE + vec2u(local % TILE_EDGE, local / TILE_EDGE);
    var own = ExposureSum();
    for (var row = 0u; row < TILE_EDGE; row += rows) {
        own = plus(own, pixel_vjp(first + vec2u(0u, row)));
    }
    parts[local] = own;
    workgroupBarrier();
    for (var reach = SUM_GROUP / 2u; reach > 0u; reach /= 2u) {
        if local < reach {
            parts[local] = plus(parts[local], parts[local + reach]);
        }
        workgroupBarrier();
    }
    // A row of the exposure for each of three invocations.
    if local < 3u {
        let sum = parts[0];
        var row = sum.red;
        if local == 1u {
            row = sum.green;
        }
        if local == 2u {
            row = sum.blue;
        }
        let place = 12u * (tile.y * tiles.x + tile.x) + 4u * local;
        sums[place] = row.x;
        sums[place + 1u] = row.y;
        sums[place + 2u] = row.z;
        sums[place + 3u] = row.w;
    }
}
