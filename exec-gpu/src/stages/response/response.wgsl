// Depths of the largest responses of Gaussians (a part of stage `project`).
//
// Threads: one invocation a Gaussian of the chunk.
// Inputs: camera, planes of the Gaussians.
// Outputs: responses, also of Gaussians that are not drawn.
// Variants: layout and storage format of the planes.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> values: array<Stored>;
@group(0) @binding(2) var<storage, read_write> responses: array<Response>;

// Index in its chunk.
var<private> gaussian: u32;

@compute @workgroup_size(GROUP)
fn respond(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= camera.gaussian_count {
        return;
    }
    let r = response_of();
    responses[camera.first_gaussian + gaussian] = Response(r.mean2d, r.slope, r.root, r.depth);
}
