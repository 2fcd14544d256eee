// The numbers of a light to its radiance: one invocation a texel.

struct Base {
    texel_count: u32,
    is_exponential: u32,
}

@group(0) @binding(0) var<uniform> base: Base;
@group(0) @binding(1) var<storage, read> numbers: array<f32>;
@group(0) @binding(2) var<storage, read_write> texels: array<vec4f>;

@compute @workgroup_size(GROUP)
fn activate_texels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let texel = linear_index(group, groups, local);
    if texel >= base.texel_count {
        return;
    }
    var radiance = vec3f(numbers[3u * texel], numbers[3u * texel + 1u], numbers[3u * texel + 2u]);
    if base.is_exponential != 0u {
        let power = radiance * LOG2_E;
        radiance = vec3f(real_exp2(power.x), real_exp2(power.y), real_exp2(power.z));
    }
    texels[texel] = vec4f(radiance, 0.0);
}
