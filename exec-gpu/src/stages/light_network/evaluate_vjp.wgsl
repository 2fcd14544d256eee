// Gradients of a light's network in some texels (stage `prefilter_vjp`): outputs of the layers and
// gradients of their sums; the weights' gradients are products of both.
//
// Threads: one invocation a texel.
// Inputs: weights, encodings, gradient of each texel's radiance.
// Outputs: a record for each texel.

@group(0) @binding(3) var<storage, read> grads: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> records: array<f32>;

@compute @workgroup_size(GROUP)
fn evaluate_network_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    if index >= texels.count {
        return;
    }
    let texel = texels.first + index;
    let record = index * RECORD;
    let sums = sums_of(texel);
    let radiance = radiance_of_sums(sums);
    let grad = grads[node_of(texel)].xyz;
    let grad_sums = vec3f(
        bounded_number_vjp(sums.x, radiance_vjp(radiance.x, grad.x)),
        bounded_number_vjp(sums.y, radiance_vjp(radiance.y, grad.y)),
        bounded_number_vjp(sums.z, radiance_vjp(radiance.z, grad.z)),
    );
    records[record + OF_SUMS] = grad_sums.x;
    records[record + OF_SUMS + 1u] = grad_sums.y;
    records[record + OF_SUMS + 2u] = grad_sums.z;
    for (var k = 0u; k < WIDTH; k++) {
        records[record + NEAR + k] = near_answers[k];
        records[record + FAR + k] = far_answers[k];
        // From here on the variable is the gradient of the far sum.
        far_answers[k] = rectify_vjp(far_answers[k], dot(weights_of_channels(k), grad_sums));
        records[record + OF_FAR + k] = far_answers[k];
    }
    for (var input = 0u; input < WIDTH; input++) {
        var grad_near = 0.0;
        for (var k = 0u; k < WIDTH; k++) {
            grad_near += weight(SECOND + input * WIDTH + k) * far_answers[k];
        }
        records[record + OF_NEAR + input] = rectify_vjp(near_answers[input], grad_near);
    }
}
