// Marks of tiles that show anything but the background: one workgroup a tile, four pixels an
// invocation.

@group(0) @binding(4) var<storage, read_write> marks: array<u32>;

var<workgroup> found: atomic<u32>;

fn mark_of(pixel: vec2u) -> u32 {
    if !is_inside(pixel) {
        return 0u;
    }
    let place = place_of(pixel);
    let is_rendered = select(IS_RENDERED, 0u, transmittance_at(place) == 1.0);
    return is_rendered | select(0u, IS_TRUE, byte_of(texels[place], 3u) != 0.0);
}

@compute @workgroup_size(LOSS_GROUP)
fn mark_tiles(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&found, 0u);
    }
    workgroupBarrier();
    let first = own_pixels(tile.xy, local);
    let own = mark_of(first) | mark_of(first + vec2u(1u, 0u)) | mark_of(first + vec2u(2u, 0u))
        | mark_of(first + vec2u(3u, 0u));
    if own != 0u {
        atomicOr(&found, own);
    }
    workgroupBarrier();
    if local == 0u {
        marks[number_of(tile.xy)] = atomicLoad(&found);
    }
}
