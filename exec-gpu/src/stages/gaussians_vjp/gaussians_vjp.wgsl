// Gradients of shading and projection (stage `gaussians_vjp`).
//
// Threads: one invocation a Gaussian of the chunk, padding of the last block included.
// Inputs: camera, planes of the Gaussians, gradients of splats; with a light, its texels and the
// split-sum table.
// Outputs: gradients of all planes; with a light, sums of the gradients of its texels; for a camera
// that moves, sums of its gradients.
// Variants: shading, layout of the planes, with or without a light, still or moving camera.
// Early exit: Gaussians without a gradient of their splat have zeros.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read> splat_grads: array<f32>;
@group(0) @binding(3) var<storage, read_write> grads: array<f32>;

// Index in its chunk.
var<private> gaussian: u32;

fn splat_grad(number: u32) -> f32 {
    let index = camera.first_gaussian + gaussian;
    return splat_grads[(index / BLOCK * SPLAT_PLANES + number) * BLOCK + index % BLOCK];
}

fn store_plane_grad(plane: u32, grad: f32) {
    grads[(gaussian / BLOCK * PLANES + plane) * BLOCK + gaussian % BLOCK] = grad;
}

// True if any gradient of the splat is not zero, including NaN.
fn is_touched() -> bool {
    var bits = 0u;
    for (var number = 0u; number < SPLAT_PLANES; number++) {
        bits |= bitcast<u32>(splat_grad(number)) & 0x7fffffffu;
    }
    return bits != 0u;
}

// Gaussians of the chunk, and those that fill its last block up.
fn padded_count() -> u32 {
    return (camera.gaussian_count + BLOCK - 1u) / BLOCK * BLOCK;
}

@compute @workgroup_size(GROUP)
fn gaussians_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian < camera.gaussian_count && is_touched() {
        store_plane_grads();
    } else if gaussian < padded_count() {
        for (var plane = 0u; plane < PLANES; plane++) {
            store_plane_grad(plane, 0.0);
        }
    }
    let first = linear_index(group, groups, 0u);
    if first < padded_count() {
        add_up_camera_grads(first / GROUP, local);
    }
}
