// Range of each tile's splats among the sorted pairs, and their Gaussians: one invocation a pair.
// Tiles without splats keep their initial zeros.

@group(0) @binding(0) var<storage, read> counters: array<u32>;
@group(0) @binding(1) var<storage, read> tiles_of: array<u32>;
@group(0) @binding(2) var<storage, read> emissions_of: array<u32>;
@group(0) @binding(3) var<storage, read> emitted: array<u32>;
@group(0) @binding(4) var<storage, read_write> ranges: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> gaussians_of: array<u32>;

@compute @workgroup_size(GROUP)
fn find_ranges(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let place = linear_index(group, groups, local);
    let count = counters[STORED_PAIRS];
    if place >= count {
        return;
    }
    gaussians_of[place] = emitted[emissions_of[place]];
    let tile = tiles_of[place];
    if place == 0u || tiles_of[place - 1u] != tile {
        ranges[tile].x = place;
    }
    if place + 1u == count || tiles_of[place + 1u] != tile {
        ranges[tile].y = place + 1u;
    }
}
