// Sum of gradients (stage `add`).
//
// Threads: one invocation a number.
// Inputs: number of elements, the terms.
// Outputs: sums, in place.

@group(0) @binding(0) var<uniform> size: Count;
@group(0) @binding(1) var<storage, read> terms: array<f32>;
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(GROUP)
fn add(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    if index >= size.count {
        return;
    }
    sums[index] += terms[index];
}
