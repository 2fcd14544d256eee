// Declarations: planes of the Gaussian `gaussian`. Sixteen Gaussians make a block, plane after
// plane.

alias Stored = f32;

fn plane(number: u32) -> f32 {
    return values[(gaussian / BLOCK * PLANES + number) * BLOCK + gaussian % BLOCK];
}
