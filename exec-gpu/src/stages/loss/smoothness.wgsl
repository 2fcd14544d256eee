// Smoothness of rendered normals between creases, and its gradient (stage `loss`).
//
// Threads: one workgroup a tile, one invocation a pixel.
// Memory: unit normals of the tile and its border, in workgroup memory, where they are blurred.
// Inputs: blended surfaces and their colours, before exposure; marks of the tiles; camera.
// Outputs: unit normals, blurred normals and weights; gradients of normals; sum of the loss over
// each tile.
// Variants: with or without gloss, which needs light per pixel.
// Early exit: tiles without a visible splat have no loss, but blurred normals next to others.

@group(0) @binding(4) var<storage, read> marks: array<u32>;
// Planes of the picture: three of unit normals, three of blurred normals, weights.
@group(0) @binding(5) var<storage, read_write> normals: array<f32>;
@group(0) @binding(6) var<storage, read_write> grads: array<f32>;
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;
@group(0) @binding(8) var<uniform> camera: Camera;

// First planes of `normals`.
const UNITS: u32 = 0u;
const BLURRED: u32 = 3u;
const WEIGHTS: u32 = 6u;

// Width of a tile with its border.
const WIDE: u32 = TILE_EDGE + 2u * BLUR_REACH;

var<workgroup> units: array<vec3f, WIDE * WIDE>;

fn blended_vector(channel: u32, index: u32) -> vec3f {
    let first = channel * pixel_count() + index;
    return vec3f(blended[first], blended[first + pixel_count()], blended[first + 2u * pixel_count()]);
}

// Gloss of a pixel; one without light per pixel.
fn gloss_at(pixel: vec2u) -> f32 {
    if !HAS_GLOSS {
        return 1.0;
    }
    let index = index_of(pixel);
    let lit = vec3f(colors[index], colors[index + pixel_count()], colors[index + 2u * pixel_count()]);
    return gloss(lit, blended_vector(COLOR_CHANNEL, index), blended[ROUGHNESS_CHANNEL * pixel_count() + index], transmittance_at(index));
}

fn unit_at(pixel: vec2u) -> vec3f {
    if !is_inside(pixel) {
        return vec3f(0.0);
    }
    return unit_normal(blended_vector(NORMAL_CHANNEL, index_of(pixel)), known_transmittance(pixel));
}

fn store_normal(plane: u32, index: u32, normal: vec3f) {
    let first = plane * pixel_count() + index;
    normals[first] = normal.x;
    normals[first + pixel_count()] = normal.y;
    normals[first + 2u * pixel_count()] = normal.z;
}

// Normal of a pixel; zero outside of the picture.
fn normal_at(plane: u32, pixel: vec2u) -> vec3f {
    if !is_inside(pixel) {
        return vec3f(0.0);
    }
    let first = plane * pixel_count() + index_of(pixel);
    return vec3f(normals[first], normals[first + pixel_count()], normals[first + 2u * pixel_count()]);
}

@compute @workgroup_size(TILE_EDGE, TILE_EDGE)
fn blur_normals(
    @builtin(workgroup_id) tile: vec3u,
    @builtin(local_invocation_id) position: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = tile.xy * TILE_EDGE;
    for (var slot = local; slot < WIDE * WIDE; slot += LOSS_GROUP) {
        units[slot] = unit_at(first + vec2u(slot % WIDE, slot / WIDE) - BLUR_REACH);
    }
    workgroupBarrier();
    let pixel = first + position.xy;
    if !is_inside(pixel) {
        return;
    }
    var sum = vec3f(0.0);
    for (var row = 0u; row <= 2u * BLUR_REACH; row++) {
        for (var column = 0u; column <= 2u * BLUR_REACH; column++) {
            sum += units[(position.y + row) * WIDE + position.x + column];
        }
    }
    let index = index_of(pixel);
    store_normal(UNITS, index, units[(position.y + BLUR_REACH) * WIDE + position.x + BLUR_REACH]);
    store_normal(BLURRED, index, blurred_normal(sum));
}

// Loss of the line along a step through a pixel.
fn bending_at(pixel: vec2u, step: vec2u, weight: f32) -> f32 {
    let before = normal_at(UNITS, pixel - step);
    let after = normal_at(UNITS, pixel + step);
    return bending(before, normal_at(UNITS, pixel), after, vec2f(pixel) + 0.5, weight);
}

// Writes the weight of a pixel; returns its loss.
fn weigh(pixel: vec2u) -> f32 {
    let across = vec2u(CREASE_REACH, 0u);
    let down = vec2u(0u, CREASE_REACH);
    let even = evenness(
        normal_at(BLURRED, pixel - across),
        normal_at(BLURRED, pixel + across),
        normal_at(BLURRED, pixel - down),
        normal_at(BLURRED, pixel + down),
        normal_at(BLURRED, pixel),
        vec2f(pixel) + 0.5,
    );
    let weight = even * gloss_at(pixel);
    normals[WEIGHTS * pixel_count() + index_of(pixel)] = weight;
    let near = bending_at(pixel, vec2u(NEAR_REACH, 0u), weight) + bending_at(pixel, vec2u(0u, NEAR_REACH), weight);
    let far = bending_at(pixel, vec2u(FAR_REACH, 0u), weight) + bending_at(pixel, vec2u(0u, FAR_REACH), weight);
    return 0.5 * (near + far);
}

@compute @workgroup_size(TILE_EDGE, TILE_EDGE)
fn weigh_normals(
    @builtin(workgroup_id) tile: vec3u,
    @builtin(local_invocation_id) position: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = tile_index(tile.xy);
    let pixel = tile.xy * TILE_EDGE + position.xy;
    let is_rendered = (marks[number] & IS_RENDERED) != 0u;
    var loss = 0.0;
    if is_inside(pixel) {
        if is_rendered {
            loss = weigh(pixel);
        } else {
            normals[WEIGHTS * pixel_count() + index_of(pixel)] = 0.0;
        }
    }
    let sum = sum_of_group(local, loss);
    if local == 0u {
        sums[SMOOTHNESS_SUM * settings.tiles.x * settings.tiles.y + number] = sum;
    }
}

// Gradient of the line along a step through a pixel, with respect to the normal of an end.
fn slope_at(pixel: vec2u, step: vec2u) -> vec3f {
    if !is_inside(pixel) {
        return vec3f(0.0);
    }
    let weight = normals[WEIGHTS * pixel_count() + index_of(pixel)];
    let before = normal_at(UNITS, pixel - step);
    let after = normal_at(UNITS, pixel + step);
    return bending_vjp(before, normal_at(UNITS, pixel), after, vec2f(pixel) + 0.5, weight);
}

// Gradient of a unit normal, of the lines along a step with this pixel at an end or in the middle.
fn grad_along(pixel: vec2u, step: vec2u) -> vec3f {
    return slope_at(pixel - step, step) - 2.0 * slope_at(pixel, step) + slope_at(pixel + step, step);
}

@compute @workgroup_size(TILE_EDGE, TILE_EDGE)
fn smooth_normals(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_id) position: vec3u) {
    let pixel = tile.xy * TILE_EDGE + position.xy;
    if !is_inside(pixel) || (marks[tile_index(tile.xy)] & IS_RENDERED) == 0u {
        return;
    }
    let near = grad_along(pixel, vec2u(NEAR_REACH, 0u)) + grad_along(pixel, vec2u(0u, NEAR_REACH));
    let far = grad_along(pixel, vec2u(FAR_REACH, 0u)) + grad_along(pixel, vec2u(0u, FAR_REACH));
    let index = index_of(pixel);
    let grad = unit_normal_vjp(blended_vector(NORMAL_CHANNEL, index), known_transmittance(pixel), near + far);
    let first = NORMAL_CHANNEL * pixel_count() + index;
    grads[first] += grad.x;
    grads[first + pixel_count()] += grad.y;
    grads[first + 2u * pixel_count()] += grad.z;
}
