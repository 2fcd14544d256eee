// Losses of pixels, and their gradients (stage `loss`).
//
// Threads: one workgroup a tile, one invocation four pixels in a row.
// Memory: means over SSIM's windows of the tile's rows in workgroup memory, colour by colour.
// Inputs: colours, transmittance, target, marks of the tiles, gradients of SSIM's window means.
// Outputs: gradients of the colours and of the transmittance, zero so far; sums over each tile.
// Variants: number of channels, meaning of white, with or without SSIM and residual layer.
// Early exit: tiles without a visible splat keep zero gradients.

@group(0) @binding(4) var<storage, read> marks: array<u32>;
@group(0) @binding(5) var<storage, read> partials: array<f32>;
@group(0) @binding(6) var<storage, read_write> grads: array<f32>;
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

// Sums over the invocation's pixels: L1 and L2 losses of colour, and coverage loss.
var<private> pixel_sums: vec3f;

// Gradients of a window's means; zero outside the image.
fn tap_at(pixel: vec2u, c: u32) -> vec3f {
    if !is_inside(pixel) {
        return vec3f(0.0);
    }
    let size = pixel_count();
    let index = 3u * c * size + index_of(pixel);
    return vec3f(partials[index], partials[index + size], partials[index + 2u * size]);
}

// Alpha of a target's pixel as a byte; zero outside the image.
fn alpha_at(pixel: vec2u) -> f32 {
    if is_inside(pixel) {
        return byte_of(texel_at(index_of(pixel)), 3u);
    }
    return 0.0;
}

// Gradient of a pixel's transmittance.
fn coverage_grad(transmittance: f32, alpha: f32) -> f32 {
    let loss = coverage_loss(transmittance, alpha);
    pixel_sums.z += loss.absolute;
    return loss.of_transmittance;
}

fn residual_grad(transmittance: f32) -> f32 {
    return coverage_loss(transmittance, 0.0).of_residual;
}

// Gradient of a pixel's colour.
fn color_grad(pixel: vec2u, c: u32, transmittance: f32, alpha: f32, grad_windows: vec3f) -> f32 {
    if !is_known(pixel) {
        return 0.0;
    }
    let index = index_of(pixel);
    let color = colors[c * pixel_count() + index];
    let pair = compared_colors(color, transmittance, true_color(index, c), alpha, settings.background[c]);
    let loss = color_loss(pair);
    pixel_sums += vec3f(loss.absolute, loss.squared, 0.0);
    let grad = loss.grad + structure_grad(pair, grad_windows);
    if IS_UNCLIPPED {
        return grad * unclipped_scale(true_color(index, c), alpha, settings.background[c]);
    }
    return grad;
}

fn store_grad(plane: u32, pixel: vec2u, grad: f32) {
    if is_inside(pixel) {
        grads[plane * pixel_count() + index_of(pixel)] = grad;
    }
}

fn store_grads(plane: u32, first: vec2u, grad: vec4f) {
    store_grad(plane, first, grad.x);
    store_grad(plane, first + vec2u(1u, 0u), grad.y);
    store_grad(plane, first + vec2u(2u, 0u), grad.z);
    store_grad(plane, first + vec2u(3u, 0u), grad.w);
}

@compute @workgroup_size(LOSS_GROUP)
fn compare_pixels(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    // Without a visible splat all gradients are zero.
    let number = tile_index(tile.xy);
    let is_rendered = (marks[number] & IS_RENDERED) != 0u;
    let a = first_pixel(tile.xy, local);
    let b = a + vec2u(1u, 0u);
    let c = a + vec2u(2u, 0u);
    let d = a + vec2u(3u, 0u);
    let transmittance = vec4f(
        known_transmittance(a),
        known_transmittance(b),
        known_transmittance(c),
        known_transmittance(d),
    );
    let alpha = vec4f(alpha_at(a), alpha_at(b), alpha_at(c), alpha_at(d));
    pixel_sums = vec3f(0.0);
    var grad_transmittance = vec4f(
        coverage_grad(transmittance.x, alpha.x),
        coverage_grad(transmittance.y, alpha.y),
        coverage_grad(transmittance.z, alpha.z),
        coverage_grad(transmittance.w, alpha.w),
    );
    for (var color = 0u; color < 3u; color++) {
        var windows = MeansAcross();
        if HAS_STRUCTURE && is_rendered {
            workgroupBarrier();
            if local < DOWN_GROUP {
                blur_down(tile.xy, color, local);
            }
            workgroupBarrier();
            windows = blur_across(local);
        }
        let grad = vec4f(
            color_grad(a, color, transmittance.x, alpha.x, windows.mean_0),
            color_grad(b, color, transmittance.y, alpha.y, windows.mean_1),
            color_grad(c, color, transmittance.z, alpha.z, windows.mean_2),
            color_grad(d, color, transmittance.w, alpha.w, windows.mean_3),
        );
        if is_rendered {
            store_grads(color, a, grad);
        }
        let background = settings.background[color];
        grad_transmittance = vec4f(
            with_background(background, grad.x, grad_transmittance.x),
            with_background(background, grad.y, grad_transmittance.y),
            with_background(background, grad.z, grad_transmittance.z),
            with_background(background, grad.w, grad_transmittance.w),
        );
    }
    if HAS_RESIDUAL && is_rendered {
        let grad_residual = vec4f(
            residual_grad(transmittance.x),
            residual_grad(transmittance.y),
            residual_grad(transmittance.z),
            residual_grad(transmittance.w),
        );
        store_grads(RESIDUAL_CHANNEL, a, grad_residual);
    }
    if is_rendered {
        store_grads(CHANNELS, a, grad_transmittance);
    }

    let sum = sum_of_group(local, pixel_sums);
    if local == 0u {
        let tiles = settings.tiles.x * settings.tiles.y;
        sums[number] = sum.x;
        sums[tiles + number] = sum.y;
        sums[2u * tiles + number] = sum.z;
    }
}
