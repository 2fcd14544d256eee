// Declarations: tests and sort keys of numbers by their bits. Compilers may assume that every
// number is finite, so comparisons of floats are unreliable.

const SIGN: u32 = 0x80000000u;
const INFINITY: u32 = 0x7f800000u;

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & ~SIGN) < INFINITY;
}

// Bits that sort like the numbers: `f32::total_cmp`.
fn ordered_bits(x: f32) -> u32 {
    let bits = bitcast<u32>(x);
    return select(bits | SIGN, ~bits, (bits & SIGN) != 0u);
}

fn number_of_ordered(bits: u32) -> f32 {
    return bitcast<f32>(select(~bits, bits & ~SIGN, (bits & SIGN) != 0u));
}
