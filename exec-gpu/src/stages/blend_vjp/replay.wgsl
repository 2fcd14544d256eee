// Declarations: state of the pixels while the splats of a tile are replayed, front to back.

// Vectors of four channels of a block of pixels.
const BLOCK_VECTORS: u32 = BLOCK_PIXELS * CHANNEL_VECTORS;

var<private> pixel_grads: array<vec4f, BLOCK_VECTORS>;
var<private> transmittance: Pixels;
var<private> remaining: Pixels;

// Index in an image of a number of a pixel; `number` enumerates the numbers of one pixel after the
// other.
fn index_of(number: u32) -> u32 {
    let pixel = pixel_at(number / (CHANNELS + 1u));
    return number % (CHANNELS + 1u) * camera.size.x * camera.size.y + pixel.y * camera.size.x + pixel.x;
}

fn grad_of_blended(number: u32) -> f32 {
    if is_inside(number / (CHANNELS + 1u)) {
        return frame_grad[index_of(number)];
    }
    return 0.0;
}
