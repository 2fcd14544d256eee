// Indices 0, 1, 2, … (used by the stages `bin` and `densify`).
//
// Threads: one invocation a number.
// Outputs: the numbers.

@group(0) @binding(0) var<uniform> size: Count;
@group(0) @binding(1) var<storage, read_write> numbers: array<u32>;

@compute @workgroup_size(GROUP)
fn iota(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    if index < size.count {
        numbers[index] = index;
    }
}
