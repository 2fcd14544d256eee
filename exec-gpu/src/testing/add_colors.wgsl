// Colours added to texels, to test the sums.
//
// Threads: one invocation a colour.
// Inputs: colours, and the texel of each.
// Outputs: sums of the light's texels.

@group(0) @binding(0) var<uniform> added: Count;
@group(0) @binding(1) var<storage, read> indices: array<u32>;
@group(0) @binding(2) var<storage, read> colors: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> light_sums: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn add_colors(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    if index < added.count {
        add_to_texel(indices[index], colors[index].xyz);
    }
}
