// Tile rasteriser, splats in batches: composites the splats of each tile, front to back.
//
// Threads: one workgroup a tile, one invocation a block of BLOCK_WIDTH × BLOCK_HEIGHT pixels.
// Memory: invocations read a batch of splats into workgroup memory, one each, and all of them read
// it there; an invocation keeps the state and channels of its pixels in registers.
// Variants: size of the block, number of channels.
// Early exit: once the transmittance of all pixels of the tile is below TRANSMITTANCE_MIN.

// Splat in workgroup memory.
struct StagedSplat {
    mean2d: vec2f,
    log2_opacity: f32,
    root: vec3f,
}

var<workgroup> staged: array<StagedSplat, BATCH>;
// The vectors of one splat after the other.
var<workgroup> staged_colors: array<vec4f, BATCH * CHANNEL_VECTORS>;
// Invocations whose pixels take further splats.
var<workgroup> active_count: atomic<u32>;
var<workgroup> is_over: u32;

fn stage_splats(first: u32, count: u32, local: u32) {
    for (var k = local; k < count; k += BLOCKS) {
        let splat = splats[gaussians_of[first + k]];
        staged[k] = StagedSplat(splat.mean2d, splat.log2_opacity, splat.root);
    }
    for (var k = local; k < count * CHANNEL_VECTORS; k += BLOCKS) {
        let gaussian = gaussians_of[first + k / CHANNEL_VECTORS];
        staged_colors[k] = colors[gaussian * CHANNEL_VECTORS + k % CHANNEL_VECTORS];
    }
}

// Composites a batch of splats; returns whether pixels take further splats.
fn blend_splats(count: u32) -> bool {
    let point = vec2f(corner) + 0.5;
    for (var k = 0u; k < count; k++) {
        let splat = staged[k];
        for (var vector = 0u; vector < CHANNEL_VECTORS; vector++) {
            color[vector] = staged_colors[k * CHANNEL_VECTORS + vector];
        }
        if blend_splat(splat.root, splat.log2_opacity, point - splat.mean2d) < TRANSMITTANCE_MIN {
            return false;
        }
    }
    return true;
}

@compute @workgroup_size(BLOCKS)
fn blend(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(tile.xy, local);
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    blend_start();
    if local == 0u {
        atomicStore(&active_count, BLOCKS);
    }
    var is_active = true;
    for (var first = range.x; first < range.y; first += BATCH) {
        let count = min(BATCH, range.y - first);
        stage_splats(first, count, local);
        workgroupBarrier();
        if is_active {
            is_active = blend_splats(count);
            if !is_active {
                atomicSub(&active_count, 1u);
            }
        }
        workgroupBarrier();
        if local == 0u {
            is_over = select(0u, 1u, atomicLoad(&active_count) == 0u);
        }
        if workgroupUniformLoad(&is_over) != 0u {
            break;
        }
    }
    blend_end();
}
