// SSIM of two images, and its gradients with respect to the means of each window: one workgroup a
// tile and colour.

@group(0) @binding(4) var<storage, read> marks: array<u32>;
@group(0) @binding(5) var<storage, read_write> partials: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

// Whether a window of the tile sees more than the background; else both images are equal.
fn sees_a_mark(tile: vec2u) -> bool {
    var found = 0u;
    for (var k = 0u; k < 9u; k++) {
        let neighbour = tile + vec2u(k % 3u, k / 3u) - 1u;
        if all(neighbour < settings.tiles) {
            found |= marks[number_of(neighbour)];
        }
    }
    return found != 0u;
}

// Outside the picture, and where nothing is known of it, both colours are zero.
fn pair_at(pixel: vec2u, c: u32) -> vec2f {
    if !is_known(pixel) {
        return vec2f(0.0);
    }
    let place = place_of(pixel);
    let texel = texels[place];
    let color = colors[c * pixel_count() + place];
    let passed = transmittance_at(place);
    return compared_colors(color, passed, byte_of(texel, c), byte_of(texel, 3u), settings.background[c]);
}

fn blur_down(first: vec2u, c: u32, place: u32) {
    let step = vec2u(0u, 1u);
    put_down(place, moments_down(
        pair_at(first, c),
        pair_at(first + step, c),
        pair_at(first + 2u * step, c),
        pair_at(first + 3u * step, c),
        pair_at(first + 4u * step, c),
        pair_at(first + 5u * step, c),
        pair_at(first + 6u * step, c),
        pair_at(first + 7u * step, c),
        pair_at(first + 8u * step, c),
        pair_at(first + 9u * step, c),
        pair_at(first + 10u * step, c),
        pair_at(first + 11u * step, c),
        pair_at(first + 12u * step, c),
        pair_at(first + 13u * step, c),
        pair_at(first + 14u * step, c),
        pair_at(first + 15u * step, c),
        pair_at(first + 16u * step, c),
        pair_at(first + 17u * step, c),
    ));
}

fn similarity(pixel: vec2u, c: u32, means: vec4f) -> f32 {
    if !is_inside(pixel) {
        return 0.0;
    }
    let structure = structure_of(means);
    let size = pixel_count();
    let place = 3u * c * size + place_of(pixel);
    partials[place] = structure.grads.x;
    partials[place + size] = structure.grads.y;
    partials[place + 2u * size] = structure.grads.z;
    return structure.similarity;
}

@compute @workgroup_size(LOSS_GROUP)
fn compare_structure(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let c = group.x % 3u;
    let tile = vec2u(group.x / 3u, group.y);
    let slot = (FIRST_STRUCTURE_SUM + c) * settings.tiles.x * settings.tiles.y + number_of(tile);
    if !sees_a_mark(tile) {
        if local == 0u {
            let shown = min(settings.size - tile * TILE_EDGE, vec2u(TILE_EDGE));
            sums[slot] = f32(shown.x * shown.y);
        }
        return;
    }
    if local < DOWN_GROUP {
        blur_down(first_down(tile, local), c, place_down(local));
    }
    workgroupBarrier();
    let place = place_across(local);
    let means = windows_4_4(
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
    let pixel = own_pixels(tile, local);
    let near = similarity(pixel, c, means.mean_0) + similarity(pixel + vec2u(1u, 0u), c, means.mean_1);
    let far = similarity(pixel + vec2u(2u, 0u), c, means.mean_2) + similarity(pixel + vec2u(3u, 0u), c, means.mean_3);
    let sum = sum_of_group(local, near + far);
    if local == 0u {
        sums[slot] = sum;
    }
}
