// Statistics of densification for a view (stage `observe`).
//
// Threads: one invocation a Gaussian of the chunk.
// Inputs: camera, splats and their gradients, the step counters.
// Outputs: sums of gradient lengths and numbers of views, in place.
// Early exit: nothing changes if the step exceeded the capacity.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> grads: array<f32>;
@group(0) @binding(3) var<storage, read_write> grad_sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> view_counts: array<f32>;
@group(0) @binding(5) var<storage, read> counters: array<u32>;

@compute @workgroup_size(GROUP)
fn observe(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let gaussian = linear_index(group, groups, local);
    if gaussian >= camera.gaussian_count || counters[EXCEEDS_CAPACITY] != 0u {
        return;
    }
    let index = camera.first_gaussian + gaussian;
    let first = gaussian / BLOCK * GRAD_PLANES * BLOCK + gaussian % BLOCK;
    let length = grad_length(vec2f(grads[first], grads[first + BLOCK]), vec2f(camera.size) / 2.0);
    if splats[index].reach > 0.0 && is_finite(length) {
        grad_sums[index] += length;
        view_counts[index] += 1.0;
    }
}
