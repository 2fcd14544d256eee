// One plane, limited and without momentum: one invocation a Gaussian.

struct Limit {
    count: u32,
    plane: u32,
    ceiling: f32,
}

@group(0) @binding(0) var<uniform> limit: Limit;
@group(0) @binding(1) var<storage, read_write> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> means: array<f32>;
@group(0) @binding(3) var<storage, read_write> squares: array<f32>;

@compute @workgroup_size(GROUP)
fn limit_plane(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let gaussian = linear_index(group, groups, local);
    if gaussian >= limit.count {
        return;
    }
    let place = (gaussian / BLOCK * PLANES + limit.plane) * BLOCK + gaussian % BLOCK;
    // What is not a number is limited too.
    if !(values[place] <= limit.ceiling) {
        values[place] = limit.ceiling;
    }
    means[place] = 0.0;
    squares[place] = 0.0;
}
