// Gradients of the losses on attributes (stage `gaussians_vjp`).
//
// Threads: one invocation a Gaussian of the chunk.
// Inputs: planes of the Gaussians, weights of the losses.
// Outputs: gradients, added in place.

@group(0) @binding(0) var<uniform> attributes: Attributes;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> grads: array<f32>;

var<private> gaussian: u32;

fn add(plane: u32, grad: f32) {
    grads[(gaussian / BLOCK * PLANES + plane) * BLOCK + gaussian % BLOCK] += grad;
}

fn add_to_opacity(number: u32, grad: f32) {
    add(OPACITY_PLANE + number, grad);
}

fn add_to_residuals(number: u32, grad: f32) {
    add(RESIDUAL_PLANE + number, grad);
}

fn add_to_metalness(number: u32, grad: f32) {
    add(METALNESS_PLANE + number, grad);
}

@compute @workgroup_size(GROUP)
fn attribute_losses(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian < attributes.gaussian_count {
        attribute_losses_vjp();
    }
}
