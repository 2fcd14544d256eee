// Declarations: a light's network, evaluated in a texel.

@group(0) @binding(0) var<uniform> texels: Texels;
@group(0) @binding(1) var<storage, read> weights: array<f32>;
@group(0) @binding(2) var<storage, read> encodings: array<f32>;

// Outputs of the hidden layers.
var<private> near_answers: array<f32, WIDTH>;
var<private> far_answers: array<f32, WIDTH>;

fn weight(index: u32) -> f32 {
    return bounded_weight(weights[index]);
}

// Node of an encoded texel.
fn node_of(texel: u32) -> u32 {
    if texel < texels.base_count {
        return texels.base_first + texel;
    }
    return texels.row_first + (texel - texels.base_count);
}

// Sums of the last layer; stores the hidden outputs.
fn sums_of(texel: u32) -> vec3f {
    for (var k = 0u; k < WIDTH; k++) {
        var sum = weight(ENCODING * WIDTH + k);
        for (var input = 0u; input < ENCODING; input++) {
            sum += encodings[texel * ENCODING + input] * weight(input * WIDTH + k);
        }
        near_answers[k] = rectify(sum);
    }
    for (var k = 0u; k < WIDTH; k++) {
        var sum = weight(SECOND + WIDTH * WIDTH + k);
        for (var input = 0u; input < WIDTH; input++) {
            sum += near_answers[input] * weight(SECOND + input * WIDTH + k);
        }
        far_answers[k] = rectify(sum);
    }
    let biases = THIRD + WIDTH * CHANNELS;
    var sums = vec3f(weight(biases), weight(biases + 1u), weight(biases + 2u));
    for (var input = 0u; input < WIDTH; input++) {
        sums += far_answers[input] * weights_of_channels(input);
    }
    return sums;
}

// Weights of the last layer from a hidden output.
fn weights_of_channels(input: u32) -> vec3f {
    let first = THIRD + input * CHANNELS;
    return vec3f(weight(first), weight(first + 1u), weight(first + 2u));
}

fn radiance_of_sums(sums: vec3f) -> vec3f {
    return vec3f(
        radiance_of_number(bounded_number(sums.x)),
        radiance_of_number(bounded_number(sums.y)),
        radiance_of_number(bounded_number(sums.z)),
    );
}
