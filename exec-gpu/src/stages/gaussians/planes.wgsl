// One number of the Gaussian at hand: sixteen Gaussians make a block, plane after plane.

alias Stored = f32;

fn plane(number: u32) -> f32 {
    return values[(gaussian / BLOCK * PLANES + number) * BLOCK + gaussian % BLOCK];
}
