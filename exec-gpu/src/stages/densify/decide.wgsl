// Action of densification on each Gaussian (stage `densify`).
//
// Threads: one invocation a Gaussian of the chunk.
// Inputs: planes of the Gaussians, and statistics of their gradients.
// Outputs: actions, their counts, and sort keys of Gaussians that grow.

@group(0) @binding(0) var<uniform> rules: Rules;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read> grad_sums: array<f32>;
@group(0) @binding(3) var<storage, read> view_counts: array<f32>;
@group(0) @binding(4) var<storage, read_write> actions: array<u32>;
// Sort keys: Gaussians that grow, by descending mean gradient, before all others.
@group(0) @binding(5) var<storage, read_write> growth_keys: array<u32>;
// Number of Gaussians of each action.
@group(0) @binding(6) var<storage, read_write> counts: array<atomic<u32>>;

// Index in its chunk.
var<private> gaussian: u32;

@compute @workgroup_size(GROUP)
fn decide_all(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= rules.count {
        return;
    }
    let index = rules.first + gaussian;
    let measures = measures_of(grad_sums[index], view_counts[index]);
    let action = u32(decide(measures.mean_grad, measures.opacity, measures.largest_scale));
    actions[index] = action;
    growth_keys[index] = select(0xffffffffu, ~ordered_bits(measures.mean_grad), action == CLONE || action == SPLIT);
    atomicAdd(&counts[action], 1u);
}
