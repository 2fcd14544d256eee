// Declarations: a batch of splats in workgroup memory, loaded by all invocations.

struct StagedSplat {
    mean2d: vec2f,
    log2_opacity: f32,
    root: vec3f,
}

// Strength of the padding splats of a batch, which are invisible.
const INVISIBLE: f32 = -1e30;

var<workgroup> staged: array<StagedSplat, BATCH>;
// The vectors of one splat after the other.
var<workgroup> staged_colors: array<vec4f, BATCH * CHANNEL_VECTORS>;
// Invocations whose pixels take further splats.
var<workgroup> active_count: atomic<u32>;
var<workgroup> is_over: u32;

// Stages `count` splats from index `first` on, filled up to whole rounds of the loop over them.
fn stage_splats(first: u32, count: u32, local: u32) {
    let filled = (count + SPLATS_A_ROUND - 1u) / SPLATS_A_ROUND * SPLATS_A_ROUND;
    for (var k = local; k < filled; k += BLOCKS) {
        if k < count {
            let splat = splats[gaussians_of[first + k]];
            staged[k] = StagedSplat(splat.mean2d, splat.log2_opacity, splat.root);
        } else {
            staged[k] = StagedSplat(vec2f(0.0), INVISIBLE, vec3f(0.0));
        }
    }
    for (var k = local; k < filled * CHANNEL_VECTORS; k += BLOCKS) {
        var vector = vec4f(0.0);
        if k < count * CHANNEL_VECTORS {
            vector = colors[gaussians_of[first + k / CHANNEL_VECTORS] * CHANNEL_VECTORS + k % CHANNEL_VECTORS];
        }
        staged_colors[k] = vector;
    }
}

fn start_tile(local: u32) {
    if local == 0u {
        atomicStore(&active_count, BLOCKS);
    }
}

// True if no pixel of the tile takes further splats; then all invocations are done with the batch.
fn is_tile_over(local: u32) -> bool {
    workgroupBarrier();
    if local == 0u {
        is_over = select(0u, 1u, atomicLoad(&active_count) == 0u);
    }
    return workgroupUniformLoad(&is_over) != 0u;
}
