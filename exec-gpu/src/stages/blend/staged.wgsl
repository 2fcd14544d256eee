// Tile rasteriser, splats in batches: composites the splats of each tile, front to back.
//
// Threads: one workgroup a tile, one invocation a block of BLOCK_WIDTH × BLOCK_HEIGHT pixels.
// Memory: invocations load a batch of splats into workgroup memory, one each, and share it; an
// invocation keeps the state and channels of its pixels in registers.
// Variants: size of the block, number of channels, surfaces of another renderer.
// Early exit: once the transmittance of all pixels of the tile is below TRANSMITTANCE_MIN.

// Index of the first splat of the batch.
var<private> batch_start: u32;

fn blend_staged(k: u32, point: vec2f) -> f32 {
    before_splat(batch_start + k);
    let splat = staged[k];
    read_staged_color(k);
    return blend_splat(splat.root, splat.log2_opacity, point - splat.mean2d);
}

// Composites a batch of splats; returns whether pixels take further splats. The falloffs of a round
// are independent; splats after the termination of a pixel change nothing.
fn blend_splats(count: u32) -> bool {
    let point = vec2f(corner) + 0.5;
    for (var k = 0u; k < count; k += SPLATS_A_ROUND) {
        if blend_round(k, point) < TRANSMITTANCE_MIN {
            return false;
        }
    }
    return true;
}

@compute @workgroup_size(BLOCKS)
fn blend(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(tile.xy, local);
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    before_tile();
    start_tile(local);
    var is_active = true;
    for (var first = range.x; first < range.y; first += BATCH) {
        let count = min(BATCH, range.y - first);
        stage_splats(first, count, local);
        workgroupBarrier();
        batch_start = first;
        if is_active {
            is_active = blend_splats(count);
            if !is_active {
                atomicSub(&active_count, 1u);
            }
        }
        if is_tile_over(local) {
            break;
        }
    }
    blend_end();
}
