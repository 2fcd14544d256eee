// Limit of one plane, whose momentum is reset, for Gaussians outside a ball (stage `limit_plane`).
//
// Threads: one invocation a Gaussian of the chunk.
// Inputs: ball, plane, largest value.
// Outputs: the plane and its Adam moments, in place.

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
    let first = gaussian / BLOCK * PLANES * BLOCK + gaussian % BLOCK;
    let mean = MEAN * BLOCK + first;
    let from_center = vec3f(values[mean], values[mean + BLOCK], values[mean + 2 * BLOCK]) - limit.center;
    if !lies_outside(from_center) {
        return;
    }
    let index = first + limit.plane * BLOCK;
    // NaN is also replaced.
    if !(values[index] <= limit.ceiling) {
        values[index] = limit.ceiling;
    }
    means[index] = 0.0;
    squares[index] = 0.0;
}

// Compares the bits, which sort like the numbers, because squared distances are not negative. NaN
// is beyond all numbers; compilers may assume that numbers are finite.
fn lies_outside(from_center: vec3f) -> bool {
    return limit.radius_squared < 0.0 || bitcast<u32>(dot(from_center, from_center)) > bitcast<u32>(limit.radius_squared);
}
