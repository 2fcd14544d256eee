// 3D filters from the sampling intervals of views (stage `sampling`).
//
// Threads: one invocation a Gaussian of the chunk, which reads all views in their order.
// Inputs: views, means of the Gaussians.
// Outputs: deviations of the filters, in place.

@group(0) @binding(0) var<uniform> counts: Counts;
@group(0) @binding(1) var<storage, read> views: array<Camera>;
@group(0) @binding(2) var<storage, read_write> values: array<f32>;

var<private> camera: Camera;

@compute @workgroup_size(GROUP)
fn sampling(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let gaussian = linear_index(group, groups, local);
    if gaussian >= counts.gaussians {
        return;
    }
    let first = gaussian / BLOCK * PLANES * BLOCK + gaussian % BLOCK;
    let mean = MEAN * BLOCK + first;
    let point = vec3f(values[mean], values[mean + BLOCK], values[mean + 2 * BLOCK]);
    var least = vec2f(FARTHEST);
    for (var view = 0u; view < counts.views; view++) {
        camera = views[view];
        let interval = interval_of(point);
        let smaller = least_interval(least, vec2f(interval.seen, interval.turned));
        least = vec2f(smaller.seen, smaller.turned);
    }
    values[first + FILTER * BLOCK] = deviation_of(least);
}
