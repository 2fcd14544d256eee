// Conversion of sums to the gradient of a light (stages `shade_pixels_vjp` and `gaussians_vjp`).
//
// Threads: one invocation a texel.
// Inputs: sums in fixed point, from `light_sums.wgsl`.
// Outputs: gradient of each texel.

@group(0) @binding(0) var<storage, read> light_sums: array<u32>;
@group(0) @binding(1) var<storage, read_write> grads: array<vec4f>;

fn digit(index: u32) -> f32 {
    return f32(bitcast<i32>(light_sums[index]));
}

fn sum_of(first: u32) -> f32 {
    let steps = digit(first + 2u) * WORD + (digit(first + 1u) + digit(first) * PER_WORD);
    let faults = light_sums[first + SUM_FAULTS];
    return select(steps * MIDDLE_STEP, bitcast<f32>(faults | NOT_A_NUMBER), faults > 0u);
}

@compute @workgroup_size(GROUP)
fn finish_sums(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let texel = linear_index(group, groups, local);
    if texel < LIGHT_TEXELS {
        let first = texel * 3u * SUM_WORDS;
        grads[texel] = vec4f(sum_of(first), sum_of(first + SUM_WORDS), sum_of(first + 2u * SUM_WORDS), 0.0);
    }
}
