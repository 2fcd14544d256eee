// Declarations: radiance of an environment's texels.

@group(0) @binding(0) var<uniform> size: Count;
@group(0) @binding(1) var<storage, read> numbers: array<f32>;

fn radiance_of(texel: u32) -> vec3f {
    return vec3f(
        radiance_of_number(numbers[3u * texel]),
        radiance_of_number(numbers[3u * texel + 1u]),
        radiance_of_number(numbers[3u * texel + 2u]),
    );
}
