// Declarations: sums of the gradient of the camera, one for each workgroup. Their binding is
// declared by the host, since it follows those of the light.

var<private> camera_grad: array<f32, CAMERA_GRADS>;
var<workgroup> camera_grads: array<array<f32, CAMERA_GRADS>, GROUP>;

fn store_camera_grad(number: u32, grad: f32) {
    camera_grad[number] = grad;
}

// Adds the gradients of all Gaussians of a workgroup, in their order.
fn add_up_camera_grads(group: u32, local: u32) {
    camera_grads[local] = camera_grad;
    workgroupBarrier();
    if local < CAMERA_GRADS {
        var sum = 0.0;
        for (var k = 0u; k < GROUP; k++) {
            sum += camera_grads[k][local];
        }
        camera_sums[group * CAMERA_GRADS + local] = sum;
    }
}
