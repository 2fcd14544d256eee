// Declarations: texel of a light as stored halves; the fourth is zero.

alias Texel = vec2u;

// Bits of the nearest half, ties to even, as in `pack.rs`; `pack2x16float` may round towards zero.
// Finite numbers are clamped to the largest half; infinities and NaN are kept.
fn half_of(number: f32) -> u32 {
    let bits = bitcast<u32>(number);
    let sign = (bits >> 16u) & HALF_SIGN;
    let size = bits & ~F32_SIGN;
    if size >= F32_INFINITY {
        return sign | select(HALF_INFINITY, HALF_NOT_A_NUMBER, size > F32_INFINITY);
    }
    let limited = min(size, F32_OF_HALF_MAX);
    if limited < F32_OF_HALF_MIN {
        return sign | u32(round(bitcast<f32>(limited) * SMALLEST_HALVES));
    }
    // Rounds the dropped bits, ties to even.
    let rounded = limited + (1u << (DROPPED_BITS - 1u)) - 1u + ((limited >> DROPPED_BITS) & 1u);
    return sign | ((rounded - F32_OF_HALF_BIAS) >> DROPPED_BITS);
}

fn texel_of(numbers: vec4f) -> Texel {
    return vec2u(half_of(numbers.x) | (half_of(numbers.y) << 16u), half_of(numbers.z));
}

fn color_of(texel: Texel) -> vec3f {
    return vec3f(unpack2x16float(texel.x), unpack2x16float(texel.y).x);
}
