// Sums of colours that many invocations add to at once. A number is so many whole steps, kept in three words and taken
// away rather than added where it is negative: whoever comes first, the words end up the same.

// One word with what the word before carried on; returns what it carries on itself.
fn add_word(place: u32, word: u32, carried: u32, is_negative: bool) -> u32 {
    let amount = word + carried;
    if amount == 0u {
        return carried;
    }
    let before = atomicAdd(&light_sums[place], select(amount, 0u - amount, is_negative));
    return u32(select(before > ~amount, before < amount, is_negative));
}

fn add_number(first: u32, color: u32, number: f32) {
    let place = first + color * SUM_WORDS;
    if (bitcast<u32>(number) & EXPONENT_BITS) == EXPONENT_BITS {
        atomicOr(&light_sums[first + SUM_FAULTS], 1u << color);
        return;
    }
    let steps = min(abs(number), NUMBER_MAX) * MIDDLE_STEPS;
    let whole = floor(steps);
    let is_negative = number < 0.0;
    var carried = add_word(place, u32(round((steps - whole) * WORD)), 0u, is_negative);
    if whole > 0.0 || carried > 0u {
        let high = floor(whole / WORD);
        carried = add_word(place + 1u, u32(whole - high * WORD), carried, is_negative);
        add_word(place + 2u, u32(high), carried, is_negative);
    }
}

fn add_to_texel(texel: u32, color: vec3f) {
    let first = min(texel, LIGHT_TEXELS - 1u) * SUM_LEN;
    add_number(first, 0u, color.x);
    add_number(first, 1u, color.y);
    add_number(first, 2u, color.z);
}
