// Declarations: planes of the Gaussian `gaussian`. Sixteen Gaussians make a block, with the first
// planes stored as `f32`, and the others as halves, two planes in a word.

alias Stored = u32;

fn stored_word(word: u32) -> u32 {
    return values[(gaussian / BLOCK * WORDS + word) * BLOCK + gaussian % BLOCK];
}

fn plane(number: u32) -> f32 {
    if number < FULL_PLANES {
        return bitcast<f32>(stored_word(number));
    }
    let half = number - FULL_PLANES;
    return unpack2x16float(stored_word(FULL_PLANES + half / 2u))[half % 2u];
}
