// Marks of tiles that show more than the background (stage `loss`).
//
// Threads: one workgroup a tile, one invocation four pixels in a row.
// Inputs: transmittance, texels of the target.
// Outputs: marks of each tile.

@group(0) @binding(4) var<storage, read_write> marks: array<u32>;

var<workgroup> found: atomic<u32>;

fn mark_of(pixel: vec2u) -> u32 {
    if !is_inside(pixel) {
        return 0u;
    }
    let index = index_of(pixel);
    let is_rendered = select(IS_RENDERED, 0u, transmittance_at(index) == 1.0);
    return is_rendered | select(0u, IS_TRUE, byte_of(texel_at(index), 3u) != 0.0);
}

@compute @workgroup_size(LOSS_GROUP)
fn mark_tiles(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&found, 0u);
    }
    workgroupBarrier();
    let first = first_pixel(tile.xy, local);
    let marks_of_four = mark_of(first) | mark_of(first + vec2u(1u, 0u)) | mark_of(first + vec2u(2u, 0u))
        | mark_of(first + vec2u(3u, 0u));
    if marks_of_four != 0u {
        atomicOr(&found, marks_of_four);
    }
    workgroupBarrier();
    if local == 0u {
        marks[tile_index(tile.xy)] = atomicLoad(&found);
    }
}
