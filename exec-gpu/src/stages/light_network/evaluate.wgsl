// A light's network in the texels of all levels (stage `prefilter`).
//
// Threads: one invocation a texel.
// Inputs: weights, encodings of the texels.
// Outputs: radiance of each texel.

@group(0) @binding(3) var<storage, read_write> nodes: array<vec4f>;

@compute @workgroup_size(GROUP)
fn evaluate_network(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let texel = linear_index(group, groups, local);
    if texel < texels.count {
        nodes[node_of(texel)] = vec4f(radiance_of_sums(sums_of(texel)), 0.0);
    }
}
