// Declarations: replay of the splats of a tile, and their slots.

// Emissions that have a slot.
struct Batch {
    first: u32,
    end: u32,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> batch: Batch;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> colors: array<vec4f>;
@group(0) @binding(4) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(5) var<storage, read> gaussians_of: array<u32>;
@group(0) @binding(6) var<storage, read> emissions_of: array<u32>;
@group(0) @binding(7) var<storage, read> frame: array<f32>;
@group(0) @binding(8) var<storage, read> frame_grad: array<f32>;
@group(0) @binding(9) var<storage, read_write> slots: array<f32>;

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

fn blended(number: u32) -> f32 {
    if is_inside(number / (CHANNELS + 1u)) {
        return frame[index_of(number)];
    }
    return 0.0;
}

fn grad_of_blended(number: u32) -> f32 {
    if is_inside(number / (CHANNELS + 1u)) {
        return frame_grad[index_of(number)];
    }
    return 0.0;
}

fn has_slot(emission: u32) -> bool {
    return batch.first <= emission && emission < batch.end;
}

// Slots of splats behind terminated pixels, which an invocation of several clears.
fn clear_slots(first: u32, end: u32, local: u32, invocations: u32) {
    for (var row = local; row < (end - first) * SLOT; row += invocations) {
        let emission = emissions_of[first + row / SLOT];
        if has_slot(emission) {
            slots[(emission - batch.first) * SLOT + row % SLOT] = 0.0;
        }
    }
}
