// Tile rasteriser: composites the splats of each tile, front to back.
//
// Threads: one workgroup a tile, one invocation a block of BLOCK_WIDTH × BLOCK_HEIGHT pixels.
// Memory: an invocation keeps the state and channels of its pixels in registers, and reads splats
// from storage.
// Variants: size of the block, number of channels.
// Early exit: once the transmittance of all its pixels is below TRANSMITTANCE_MIN.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> colors: array<vec4f>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(4) var<storage, read> gaussians_of: array<u32>;
@group(0) @binding(5) var<storage, read_write> frame: array<f32>;

var<private> transmittance: Pixels;
var<private> final_transmittance: Pixels;
var<private> sums: array<vec4f, BLOCK_PIXELS * CHANNEL_VECTORS>;
var<private> first_color: u32;

fn store_pixel(pixel: u32, value: f32) {
    if !is_inside(pixel) {
        return;
    }
    let at = pixel_at(pixel);
    let size = camera.size.x * camera.size.y;
    let index = at.y * camera.size.x + at.x;
    for (var c = 0u; c < CHANNELS; c++) {
        frame[c * size + index] = sums[pixel * CHANNEL_VECTORS + c / 4u][c % 4u];
    }
    frame[CHANNELS * size + index] = value;
}

@compute @workgroup_size(INVOCATIONS)
fn blend(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(tile.xy, local);
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    blend_start();
    let point = vec2f(corner) + 0.5;
    for (var k = range.x; k < range.y; k++) {
        let gaussian = gaussians_of[k];
        let splat = splats[gaussian];
        first_color = gaussian * CHANNEL_VECTORS;
        if blend_splat(splat.root, splat.log2_opacity, point - splat.mean2d) < TRANSMITTANCE_MIN {
            break;
        }
    }
    blend_end();
}
