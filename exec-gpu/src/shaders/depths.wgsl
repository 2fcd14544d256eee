// Depths as keys of few bits.

struct Depths {
    count: u32,
    nearest: u32,
    not_drawn: u32,
}

@group(0) @binding(0) var<uniform> depths: Depths;
@group(0) @binding(1) var<storage, read> depth_keys: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<u32>;
// The nearest depth and the furthest of what is drawn, as bits, and in how many tiles all splats are.
@group(0) @binding(3) var<storage, read_write> measures: array<atomic<u32>, 3>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> order: array<u32>;

// One invocation for a column of Gaussians.
@compute @workgroup_size(GROUP)
fn measure(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * COLUMN;
    let end = min(first + COLUMN, depths.count);
    var nearest = NOT_DRAWN;
    var furthest = 0u;
    var tiles = 0u;
    for (var gaussian = first; gaussian < end; gaussian++) {
        let key = depth_keys[gaussian];
        nearest = min(nearest, key);
        furthest = max(furthest, select(key, 0u, key == NOT_DRAWN));
        tiles += tile_counts[gaussian];
    }
    if tiles > 0u {
        atomicMin(&measures[0], nearest);
        atomicMax(&measures[1], furthest);
        atomicAdd(&measures[2], tiles);
    }
}

// Keys from the nearest depth on, behind them what is not drawn; and all Gaussians in their order.
@compute @workgroup_size(GROUP)
fn shorten(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let gaussian = linear_index(group, groups, local);
    if gaussian >= depths.count {
        return;
    }
    let key = depth_keys[gaussian];
    keys[gaussian] = select(key - depths.nearest, depths.not_drawn, key == NOT_DRAWN);
    order[gaussian] = gaussian;
}
