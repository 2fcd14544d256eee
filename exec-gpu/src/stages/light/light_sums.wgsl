// Declarations: sums of colours to which many invocations add concurrently. A number is an integer
// of steps: three words are its signed digits, and the fourth counts numbers that were not finite.
// The order of additions does not change the sum. Factors are powers of two, because their products
// are exact on all devices, unlike divisions.

fn add_number(first: u32, number: f32) {
    let is_fault = (bitcast<u32>(number) & EXPONENT_BITS) == EXPONENT_BITS;
    let is_negative = number < 0.0 && !is_fault;
    let steps = min(abs(number), NUMBER_MAX) * MIDDLE_STEPS;
    let whole = floor(steps);
    let high = floor(whole * PER_WORD);
    var index = first + select(0u, SUM_FAULTS, is_fault);
    var word = select(u32(round((steps - whole) * WORD)), 1u, is_fault);
    var rest = select(vec2u(u32(whole - high * WORD), u32(high)), vec2u(0u), is_fault);
    var carried = 0u;
    // One iteration for most numbers: they fit a word, and signed digits seldom carry.
    loop {
        let amount = word + carried;
        let before = atomicAdd(&light_sums[index], select(amount, 0u - amount, is_negative)) ^ SIGN_BIT;
        carried = u32(select(before > ~amount, before < amount, is_negative) || amount < word);
        if carried == 0u && all(rest == vec2u(0u)) {
            break;
        }
        word = rest.x;
        rest = vec2u(rest.y, 0u);
        index++;
    }
}

fn add_to_texel(texel: u32, color: vec3f) {
    let first = min(texel, LIGHT_TEXELS - 1u) * 3u * SUM_WORDS;
    add_number(first, color.x);
    add_number(first + SUM_WORDS, color.y);
    add_number(first + 2u * SUM_WORDS, color.z);
}
