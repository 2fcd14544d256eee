// Activation of an environment (stage `prefilter`).
//
// Threads: one invocation a texel.
// Inputs: numbers of the environment.
// Outputs: radiance of each texel.

@group(0) @binding(2) var<storage, read_write> texels: array<vec4f>;

@compute @workgroup_size(GROUP)
fn activate_texels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let texel = linear_index(group, groups, local);
    if texel < size.count {
        texels[texel] = vec4f(radiance_of(texel), 0.0);
    }
}
