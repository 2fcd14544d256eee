// Limit of growth: Gaussians after the first `growth_max` are kept unchanged (stage `densify`).
//
// Threads: one invocation a Gaussian, by its rank in descending order of gradients.
// Inputs: order of the Gaussians.
// Outputs: actions and their counts, in place.

@group(0) @binding(0) var<uniform> growth: Growth;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read_write> actions: array<u32>;
@group(0) @binding(3) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn limit_growth(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let rank = linear_index(group, groups, local);
    if rank < growth.growth_max || rank >= growth.count {
        return;
    }
    let gaussian = order[rank];
    let action = actions[gaussian];
    if action == CLONE || action == SPLIT {
        actions[gaussian] = KEEP;
        atomicSub(&counts[action], 1u);
        atomicAdd(&counts[KEEP], 1u);
    }
}
