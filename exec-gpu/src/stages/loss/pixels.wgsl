// Losses of pixels, and their gradients, which are zero so far: one workgroup a tile, four pixels
// an invocation.

@group(0) @binding(4) var<storage, read> marks: array<u32>;
@group(0) @binding(5) var<storage, read> partials: array<f32>;
@group(0) @binding(6) var<storage, read_write> grads: array<f32>;
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

// Sums over the invocation's pixels: L1 and L2 losses of colour, and coverage loss.
var<private> own_sums: vec3f;

// Gradients of a window's means; there are no windows outside the picture.
fn partials_at(pixel: vec2u, c: u32) -> vec3f {
    if !is_inside(pixel) {
        return vec3f(0.0);
    }
    let size = pixel_count();
    let place = 3u * c * size + place_of(pixel);
    return vec3f(partials[place], partials[place + size], partials[place + 2u * size]);
}

fn blur_down(first: vec2u, c: u32, place: u32) {
    let step = vec2u(0u, 1u);
    put_down(place, windows_3_8(
        partials_at(first, c),
        partials_at(first + step, c),
        partials_at(first + 2u * step, c),
        partials_at(first + 3u * step, c),
        partials_at(first + 4u * step, c),
        partials_at(first + 5u * step, c),
        partials_at(first + 6u * step, c),
        partials_at(first + 7u * step, c),
        partials_at(first + 8u * step, c),
        partials_at(first + 9u * step, c),
        partials_at(first + 10u * step, c),
        partials_at(first + 11u * step, c),
        partials_at(first + 12u * step, c),
        partials_at(first + 13u * step, c),
        partials_at(first + 14u * step, c),
        partials_at(first + 15u * step, c),
        partials_at(first + 16u * step, c),
        partials_at(first + 17u * step, c),
    ));
}

fn blur_across(place: u32) -> Windows34 {
    return windows_3_4(
        rows[place],
        rows[place + 1u],
        rows[place + 2u],
        rows[place + 3u],
        rows[place + 4u],
        rows[place + 5u],
        rows[place + 6u],
        rows[place + 7u],
        rows[place + 8u],
        rows[place + 9u],
        rows[place + 10u],
        rows[place + 11u],
        rows[place + 12u],
        rows[place + 13u],
    );
}

fn texel_at(pixel: vec2u) -> u32 {
    if is_inside(pixel) {
        return texels[place_of(pixel)];
    }
    return 0u;
}

// Gradient of a pixel's transmittance.
fn compare_coverage(passed: f32, texel: u32) -> f32 {
    let loss = coverage_loss(passed, byte_of(texel, 3u));
    own_sums.z += loss.absolute;
    return loss.of_transmittance;
}

fn residual_grad(passed: f32) -> f32 {
    return coverage_loss(passed, 0.0).of_residual;
}

// Gradient of a pixel's colour.
fn compare_color(pixel: vec2u, c: u32, passed: f32, texel: u32, of_windows: vec3f) -> f32 {
    if !is_known(pixel) {
        return 0.0;
    }
    let color = colors[c * pixel_count() + place_of(pixel)];
    let pair = compared_colors(color, passed, byte_of(texel, c), byte_of(texel, 3u), settings.background[c]);
    let loss = color_loss(pair);
    own_sums += vec3f(loss.absolute, loss.squared, 0.0);
    return loss.grad + structure_grad(pair, of_windows);
}

fn put(plane: u32, pixel: vec2u, grad: f32) {
    if is_inside(pixel) {
        grads[plane * pixel_count() + place_of(pixel)] = grad;
    }
}

fn put_all(plane: u32, first: vec2u, grad: vec4f) {
    put(plane, first, grad.x);
    put(plane, first + vec2u(1u, 0u), grad.y);
    put(plane, first + vec2u(2u, 0u), grad.z);
    put(plane, first + vec2u(3u, 0u), grad.w);
}

@compute @workgroup_size(LOSS_GROUP)
fn compare_pixels(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    // Without a visible splat all gradients are zero.
    let number = number_of(tile.xy);
    let flows = (marks[number] & IS_RENDERED) != 0u;
    let a = own_pixels(tile.xy, local);
    let b = a + vec2u(1u, 0u);
    let c = a + vec2u(2u, 0u);
    let d = a + vec2u(3u, 0u);
    let passed = vec4f(passed_at(a), passed_at(b), passed_at(c), passed_at(d));
    let texel = vec4u(texel_at(a), texel_at(b), texel_at(c), texel_at(d));
    own_sums = vec3f(0.0);
    var of_passed = vec4f(
        compare_coverage(passed.x, texel.x),
        compare_coverage(passed.y, texel.y),
        compare_coverage(passed.z, texel.z),
        compare_coverage(passed.w, texel.w),
    );
    for (var color = 0u; color < 3u; color++) {
        var windows = Windows34();
        if HAS_STRUCTURE && flows {
            workgroupBarrier();
            if local < DOWN_GROUP {
                blur_down(first_down(tile.xy, local), color, place_down(local));
            }
            workgroupBarrier();
            windows = blur_across(place_across(local));
        }
        let grad = vec4f(
            compare_color(a, color, passed.x, texel.x, windows.mean_0),
            compare_color(b, color, passed.y, texel.y, windows.mean_1),
            compare_color(c, color, passed.z, texel.z, windows.mean_2),
            compare_color(d, color, passed.w, texel.w, windows.mean_3),
        );
        if flows {
            put_all(color, a, grad);
        }
        let behind = settings.background[color];
        of_passed = vec4f(
            with_background(behind, grad.x, of_passed.x),
            with_background(behind, grad.y, of_passed.y),
            with_background(behind, grad.z, of_passed.z),
            with_background(behind, grad.w, of_passed.w),
        );
    }
    if HAS_RESIDUAL && flows {
        let of_residual = vec4f(
            residual_grad(passed.x),
            residual_grad(passed.y),
            residual_grad(passed.z),
            residual_grad(passed.w),
        );
        put_all(RESIDUAL_CHANNEL, a, of_residual);
    }
    if flows {
        put_all(CHANNELS, a, of_passed);
    }

    let sum = sum_of_group(local, own_sums);
    if local == 0u {
        let tiles = settings.tiles.x * settings.tiles.y;
        sums[number] = sum.x;
        sums[tiles + number] = sum.y;
        sums[2u * tiles + number] = sum.z;
    }
}
