// Gradients of the weights of a light's network from their parts (stage `prefilter_vjp`).
//
// Threads: one invocation a weight, whose parts it sums in order.
// Inputs: weights, a sum for each weight of each part.
// Outputs: gradients of the weights.

@group(0) @binding(3) var<storage, read> parts: array<f32>;
@group(0) @binding(4) var<storage, read_write> grads: array<f32>;

@compute @workgroup_size(GROUP)
fn sum_network_parts(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let number = linear_index(group, groups, local);
    if number >= WEIGHT_COUNT {
        return;
    }
    var sum = 0.0;
    for (var part = 0u; part < texels.part_count; part++) {
        sum += parts[part * WEIGHT_COUNT + number];
    }
    grads[number] = bounded_weight_vjp(weights[number], sum);
}
