// Gradients of the weights of a light's network, summed over parts of the texels (stage
// `prefilter_vjp`).
//
// Threads: one invocation a weight of a part, whose texels it sums in order.
// Inputs: encodings, a record for each texel.
// Outputs: a sum for each weight of each part.

@group(0) @binding(3) var<storage, read> records: array<f32>;
@group(0) @binding(4) var<storage, read_write> parts: array<f32>;

// Sum over texels of an input of a layer, or of one for biases, times the gradient of a sum.
fn sum_of_products(begin: u32, end: u32, input: u32, inputs: u32, of_input: u32, grad_offset: u32) -> f32 {
    var sum = 0.0;
    for (var index = begin; index < end; index++) {
        let record = index * RECORD;
        var factor = 1.0;
        if input < inputs {
            factor = records[record + of_input + input];
        }
        sum += factor * records[record + grad_offset];
    }
    return sum;
}

@compute @workgroup_size(GROUP)
fn network_weights_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    let part = index / WEIGHT_COUNT;
    let number = index % WEIGHT_COUNT;
    let begin = part * PART;
    if begin >= texels.count {
        return;
    }
    let end = min(begin + PART, texels.count);
    var sum = 0.0;
    if number >= THIRD {
        let place = number - THIRD;
        sum = sum_of_products(begin, end, place / CHANNELS, WIDTH, FAR, OF_SUMS + place % CHANNELS);
    } else if number >= SECOND {
        let place = number - SECOND;
        sum = sum_of_products(begin, end, place / WIDTH, WIDTH, NEAR, OF_FAR + place % WIDTH);
    } else if number >= ENCODING * WIDTH {
        sum = sum_of_products(begin, end, ENCODING, ENCODING, NEAR, OF_NEAR + number % WIDTH);
    } else {
        let input = number / WIDTH;
        let grad_offset = OF_NEAR + number % WIDTH;
        for (var texel = begin; texel < end; texel++) {
            sum += encodings[(texels.first + texel) * ENCODING + input] * records[texel * RECORD + grad_offset];
        }
    }
    parts[(texels.part_first + part) * WEIGHT_COUNT + number] = sum;
}
