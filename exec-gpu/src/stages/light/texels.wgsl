// A texel of a light as it is stored: its colour and nothing.

alias Texel = vec4f;

fn texel_of(numbers: vec4f) -> Texel {
    return numbers;
}

fn color_of(texel: Texel) -> vec3f {
    return texel.xyz;
}
