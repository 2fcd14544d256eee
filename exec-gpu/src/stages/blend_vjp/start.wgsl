// Declarations: composited numbers of a pixel, the initial values of its replay.

fn blended(number: u32) -> f32 {
    if is_inside(number / (CHANNELS + 1u)) {
        return frame[index_of(number)];
    }
    return 0.0;
}
