// Formula for many rows of inputs, to test it.
//
// Threads: one invocation a row.
// Inputs, outputs: rows of numbers.

@group(0) @binding(0) var<uniform> rows: Count;
@group(0) @binding(1) var<storage, read> inputs: array<f32>;
@group(0) @binding(2) var<storage, read_write> outputs: array<f32>;

@compute @workgroup_size(GROUP)
fn probe(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear_index(group, groups, local);
    if row >= rows.count {
        return;
    }
    // STATEMENTS
}
