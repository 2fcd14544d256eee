// The numbers of a light, and the radiance that they stand for.

struct Base {
    texel_count: u32,
    is_exponential: u32,
}

@group(0) @binding(0) var<uniform> base: Base;
@group(0) @binding(1) var<storage, read> numbers: array<f32>;

fn radiance_of(texel: u32) -> vec3f {
    let radiance = vec3f(numbers[3u * texel], numbers[3u * texel + 1u], numbers[3u * texel + 2u]);
    if base.is_exponential == 0u {
        return radiance;
    }
    let power = radiance * LOG2_E;
    return vec3f(real_exp2(power.x), real_exp2(power.y), real_exp2(power.z));
}
