// Range of each tile among the sorted pairs, and the Gaussian of each pair (stage `bin`).
//
// Threads: one invocation a pair.
// Inputs: tiles and emission indices of the sorted pairs; Gaussians by emission index.
// Outputs: first and past-the-last pair of each tile, zeros for tiles without splats; Gaussians.

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
    let pair = linear_index(group, groups, local);
    let count = counters[STORED_PAIRS];
    if pair >= count {
        return;
    }
    gaussians_of[pair] = emitted[emissions_of[pair]];
    let tile = tiles_of[pair];
    if pair == 0u || tiles_of[pair - 1u] != tile {
        ranges[tile].x = pair;
    }
    if pair + 1u == count || tiles_of[pair + 1u] != tile {
        ranges[tile].y = pair + 1u;
    }
}
