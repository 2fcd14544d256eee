// SSIM of two images, and its gradients with respect to the means of each window (stage `loss`).
//
// Threads: one workgroup a tile and colour, one invocation four pixels in a row.
// Memory: means over SSIM's windows of the tile's rows in workgroup memory.
// Inputs: colours, transmittance, target, marks of the tiles.
// Outputs: gradients of each window's means; sums of SSIM over each tile.
// Early exit: SSIM is 1 where both images show only the background.

@group(0) @binding(4) var<storage, read> marks: array<u32>;
@group(0) @binding(5) var<storage, read_write> partials: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

// Tests whether the windows of a tile cover more than the background; else both images are equal.
fn is_marked(tile: vec2u) -> bool {
    var found = 0u;
    for (var k = 0u; k < 9u; k++) {
        let neighbour = tile + vec2u(k % 3u, k / 3u) - 1u;
        if all(neighbour < settings.tiles) {
            found |= marks[tile_index(neighbour)];
        }
    }
    return found != 0u;
}

// Rendered and true colour; zero outside the image and where the target is masked.
fn tap_at(pixel: vec2u, c: u32) -> vec2f {
    if !is_known(pixel) {
        return vec2f(0.0);
    }
    let index = index_of(pixel);
    let alpha = byte_of(texel_at(index), 3u);
    let color = colors[c * pixel_count() + index];
    let transmittance = transmittance_at(index);
    return compared_colors(color, transmittance, true_color(index, c), alpha, settings.background[c]);
}

fn similarity(pixel: vec2u, c: u32, means: vec4f) -> f32 {
    if !is_inside(pixel) {
        return 0.0;
    }
    let structure = structure_of(means);
    let size = pixel_count();
    let index = 3u * c * size + index_of(pixel);
    partials[index] = structure.grads.x;
    partials[index + size] = structure.grads.y;
    partials[index + 2u * size] = structure.grads.z;
    return structure.similarity;
}

@compute @workgroup_size(LOSS_GROUP)
fn compare_structure(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let c = group.x % 3u;
    let tile = vec2u(group.x / 3u, group.y);
    let slot = (FIRST_STRUCTURE_SUM + c) * settings.tiles.x * settings.tiles.y + tile_index(tile);
    if !is_marked(tile) {
        if local == 0u {
            let shown = min(settings.size - tile * TILE_EDGE, vec2u(TILE_EDGE));
            sums[slot] = f32(shown.x * shown.y);
        }
        return;
    }
    if local < DOWN_GROUP {
        blur_down(tile, c, local);
    }
    workgroupBarrier();
    let means = blur_across(local);
    let pixel = first_pixel(tile, local);
    let near = similarity(pixel, c, means.mean_0) + similarity(pixel + vec2u(1u, 0u), c, means.mean_1);
    let far = similarity(pixel + vec2u(2u, 0u), c, means.mean_2) + similarity(pixel + vec2u(3u, 0u), c, means.mean_3);
    let sum = sum_of_group(local, near + far);
    if local == 0u {
        sums[slot] = sum;
    }
}
