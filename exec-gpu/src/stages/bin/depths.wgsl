// Depth keys of few bits (stage `bin`).
//
// Threads: one invocation a Gaussian.
// Inputs: depths as bits that sort; the nearest of them, from the step counters.
// Outputs: sort keys, and the Gaussians in their order as items.

@group(0) @binding(0) var<uniform> depths: Depths;
@group(0) @binding(1) var<storage, read> depth_keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> order: array<u32>;
@group(0) @binding(4) var<storage, read> counters: array<u32>;

// Subtracts the nearest depth; Gaussians that are not drawn have the largest key.
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
    keys[gaussian] = select(key - counters[NEAREST], depths.not_drawn, key == NOT_DRAWN);
    order[gaussian] = gaussian;
}
