// Sums of colours to colours: one invocation a texel.

@group(0) @binding(0) var<storage, read> light_sums: array<u32>;
@group(0) @binding(1) var<storage, read_write> grads: array<vec4f>;

fn sum_of(first: u32, color: u32) -> f32 {
    let place = first + color * SUM_WORDS;
    var words = vec3u(light_sums[place], light_sums[place + 1u], light_sums[place + 2u]);
    let is_negative = (words.z >> 31u) == 1u;
    if is_negative {
        words.x = 0u - words.x;
        words.y = ~words.y + u32(words.x == 0u);
        words.z = ~words.z + u32(words.x == 0u && words.y == 0u);
    }
    let steps = f32(words.z) * WORD + (f32(words.y) + f32(words.x) / WORD);
    let sum = select(steps, -steps, is_negative) / MIDDLE_STEPS;
    // What was added and was no number has made the sum none.
    let faults = light_sums[first + SUM_FAULTS];
    return select(sum, bitcast<f32>(faults | NOT_A_NUMBER), (faults >> color & 1u) == 1u);
}

@compute @workgroup_size(GROUP)
fn finish_sums(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let texel = linear_index(group, groups, local);
    if texel < LIGHT_TEXELS {
        let first = texel * SUM_LEN;
        grads[texel] = vec4f(sum_of(first, 0u), sum_of(first, 1u), sum_of(first, 2u), 0.0);
    }
}
