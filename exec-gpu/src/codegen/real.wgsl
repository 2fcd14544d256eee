// Declarations: functions of `specula_core::real` without exact hardware instructions, operation by
// operation as in core.

// `round` is built in: a compiler may remove the addition and subtraction of a large number.
fn real_exp2(power: f32) -> f32 {
    let x = clamp(power, EXP2_MIN, EXP2_MAX);
    let whole = round(x);
    return exp2_fraction(x - whole) * bitcast<f32>(u32(i32(whole) + 127) << 23u);
}

fn real_log2(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let exponent = bitcast<i32>(bits - FRAC_1_SQRT_2_BITS) >> 23u;
    let mantissa = bitcast<f32>(bits - (bitcast<u32>(exponent) << 23u));
    return log2_mantissa(mantissa) + f32(exponent);
}

// Tested by its bits: compilers may assume that numbers are finite.
fn real_is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
