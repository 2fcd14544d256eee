// Declarations: texel of a light as stored: colour and padding.

alias Texel = vec4f;

fn texel_of(numbers: vec4f) -> Texel {
    return numbers;
}

fn color_of(texel: Texel) -> vec3f {
    return texel.xyz;
}
