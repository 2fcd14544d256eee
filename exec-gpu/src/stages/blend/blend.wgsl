// Tile rasteriser: composites the splats of each tile, front to back.
//
// Threads: one workgroup a tile, one invocation a block of BLOCK_WIDTH × BLOCK_HEIGHT pixels.
// Memory: an invocation keeps the state and channels of its pixels in registers, and reads splats
// from storage.
// Variants: size of the block, number of channels, surfaces of another renderer.
// Early exit: once the transmittance of all its pixels is below TRANSMITTANCE_MIN.

@compute @workgroup_size(BLOCKS)
fn blend(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(tile.xy, local);
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    before_tile();
    let point = vec2f(corner) + 0.5;
    for (var k = range.x; k < range.y; k++) {
        let gaussian = gaussians_of[k];
        let splat = splats[gaussian];
        before_splat(k);
        read_color(gaussian);
        if blend_splat(splat.root, splat.log2_opacity, point - splat.mean2d) < TRANSMITTANCE_MIN {
            break;
        }
    }
    blend_end();
}
