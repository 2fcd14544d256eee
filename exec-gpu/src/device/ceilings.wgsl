// Peak rates of the device: kernels that only copy, or only multiply and add.
//
// Threads: one invocation a vector of four numbers.
// Inputs: vectors.
// Outputs: their copies, or the sums of the multiply-adds.

@group(0) @binding(0) var<uniform> rounds: Rounds;
@group(0) @binding(1) var<storage, read> source: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> copied: array<vec4f>;

@compute @workgroup_size(GROUP)
fn copy_numbers(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    if index < rounds.count {
        copied[index] = source[index];
    }
}

// Four vectors of four sums each, side by side, so no multiply-add waits for another.
@compute @workgroup_size(GROUP)
fn multiply_add(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    if index >= rounds.count {
        return;
    }
    let factor = source[index] * 0.5 + 0.25;
    let addend = vec4f(1e-3);
    var a = factor;
    var b = factor + 1.0;
    var c = factor + 2.0;
    var d = factor + 3.0;
    for (var step = 0u; step < rounds.steps; step++) {
        a = fma(a, factor, addend);
        b = fma(b, factor, addend);
        c = fma(c, factor, addend);
        d = fma(d, factor, addend);
    }
    copied[index] = (a + b) + (c + d);
}
