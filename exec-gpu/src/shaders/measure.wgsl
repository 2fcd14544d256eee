// What must be known of splats before they are sorted.

struct MeasureSize {
    count: u32,
}

@group(0) @binding(0) var<uniform> size: MeasureSize;
@group(0) @binding(1) var<storage, read> depth_keys: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<u32>;
// The nearest depth and the furthest of what is drawn, as keys, and how many splats all tiles have.
@group(0) @binding(3) var<storage, read_write> measures: array<atomic<u32>, 3>;

// One invocation for a column of Gaussians.
@compute @workgroup_size(GROUP)
fn measure(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * COLUMN;
    let end = min(first + COLUMN, size.count);
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
