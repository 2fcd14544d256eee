// Adam's step (stage `optimise`).
//
// Threads: one invocation a number.
// Inputs: learning rate of each plane, gradients, the step counters.
// Outputs: values and their Adam moments, in place; count of gradients that are not finite.
// Early exit: nothing changes if the step exceeded the capacity, or in planes at rest.

@group(0) @binding(0) var<uniform> size: StepSize;
@group(0) @binding(1) var<storage, read> rates: array<f32>;
@group(0) @binding(2) var<storage, read> grads: array<f32>;
@group(0) @binding(3) var<storage, read_write> values: array<f32>;
@group(0) @binding(4) var<storage, read_write> means: array<f32>;
@group(0) @binding(5) var<storage, read_write> squares: array<f32>;
@group(0) @binding(6) var<storage, read_write> counters: array<atomic<u32>>;

// Tested by its bits: compilers may assume that numbers are finite.
fn is_usable(grad: f32) -> bool {
    return (bitcast<u32>(grad) & 0x7fffffffu) <= GRAD_MAX_BITS;
}

@compute @workgroup_size(GROUP)
fn optimise(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    if index >= size.count || atomicLoad(&counters[EXCEEDS_CAPACITY]) != 0u {
        return;
    }
    let rate = rates[index / BLOCK % size.planes];
    if rate < 0.0 {
        return;
    }
    let grad = grads[index];
    if is_usable(grad) {
        let next = adam_step(values[index], means[index], squares[index], grad, rate, size.epsilon);
        values[index] = next.value;
        means[index] = next.mean;
        squares[index] = next.square;
    } else {
        atomicAdd(&counters[NONFINITE], 1u);
    }
    if size.is_limited != 0u {
        values[index] = clamp(values[index], 0.0, size.value_max);
    }
}
