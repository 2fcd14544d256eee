// Gradient of the activation of an environment (stage `prefilter_vjp`).
//
// Threads: one invocation a texel.
// Inputs: numbers of the environment, gradient of its radiance.
// Outputs: gradients of the numbers.

@group(0) @binding(2) var<storage, read> texels: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> grads: array<f32>;

@compute @workgroup_size(GROUP)
fn activate_texels_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let texel = linear_index(group, groups, local);
    if texel >= size.count {
        return;
    }
    let grad = texels[texel].xyz;
    let radiance = radiance_of(texel);
    grads[3u * texel] = radiance_vjp(radiance.x, grad.x);
    grads[3u * texel + 1u] = radiance_vjp(radiance.y, grad.y);
    grads[3u * texel + 2u] = radiance_vjp(radiance.z, grad.z);
}
