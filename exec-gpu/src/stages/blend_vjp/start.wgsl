// Declarations: composited numbers of a pixel, from which its replay starts.

fn blended(number: u32) -> f32 {
    if is_inside(number / (CHANNELS + 1u)) {
        return frame[index_of(number)];
    }
    return 0.0;
}
