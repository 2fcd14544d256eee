// Declarations: inputs of a tile rasteriser, the state of its pixels, and the picture.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> colors: array<vec4f>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(4) var<storage, read> gaussians_of: array<u32>;
@group(0) @binding(5) var<storage, read_write> frame: array<f32>;

var<private> transmittance: Pixels;
var<private> final_transmittance: Pixels;
var<private> sums: array<vec4f, BLOCK_PIXELS * CHANNEL_VECTORS>;

fn store_pixel(pixel: u32, value: f32) {
    if !is_inside(pixel) {
        return;
    }
    let at = pixel_at(pixel);
    let size = camera.size.x * camera.size.y;
    let index = at.y * camera.size.x + at.x;
    store_channels(pixel * CHANNEL_VECTORS, size, index);
    frame[CHANNELS * size + index] = value;
}
