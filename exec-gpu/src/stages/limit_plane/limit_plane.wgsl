// One plane, limited and without momentum, of Gaussians outside of a ball: one invocation a
// Gaussian.

struct Limit {
    center: vec3f,
    radius_squared: f32,
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
    let first = gaussian / BLOCK * PLANES * BLOCK + gaussian % BLOCK;
    let mean = MEAN * BLOCK + first;
    let from_center = vec3f(values[mean], values[mean + BLOCK], values[mean + 2 * BLOCK]) - limit.center;
    if !lies_outside(from_center) {
        return;
    }
    let place = first + limit.plane * BLOCK;
    // NaN is limited too.
    if !(values[place] <= limit.ceiling) {
        values[place] = limit.ceiling;
    }
    means[place] = 0.0;
    squares[place] = 0.0;
}

// Distances are not negative, and so neither are their bits as whole numbers: by those, what is not
// a number is farther than anything, where a compiler may take every number for finite.
fn lies_outside(from_center: vec3f) -> bool {
    return limit.radius_squared < 0.0 || bitcast<u32>(dot(from_center, from_center)) > bitcast<u32>(limit.radius_squared);
}
