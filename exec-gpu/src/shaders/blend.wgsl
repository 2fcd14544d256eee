// Tiles to a picture: one workgroup a tile, one invocation a pixel.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> colors: array<vec4f>;
@group(0) @binding(3) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(4) var<storage, read> gaussians_of: array<u32>;
@group(0) @binding(5) var<storage, read_write> frame: array<f32>;

@compute @workgroup_size(TILE_EDGE, TILE_EDGE)
fn blend(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let pixel = tile.xy * TILE_EDGE + local.xy;
    if any(pixel >= camera.size) {
        return;
    }
    let point = vec2f(pixel) + 0.5;
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    var sums: array<vec4f, CHANNEL_VECTORS>;
    var transmittance = 1.0;
    var left = 1.0;
    for (var k = range.x; k < range.y; k++) {
        let gaussian = gaussians_of[k];
        let splat = splats[gaussian];
        let strength = falloff_at(splat.root, splat.log2_opacity, point - splat.mean2d).log2_strength;
        if !(strength >= LOG2_ALPHA_MIN) {
            continue;
        }
        let over = blend_step(strength, transmittance, left);
        transmittance = over.transmittance;
        left = over.left;
        for (var v = 0u; v < CHANNEL_VECTORS; v++) {
            sums[v] += over.weight * colors[gaussian * CHANNEL_VECTORS + v];
        }
        if transmittance < TRANSMITTANCE_MIN {
            break;
        }
    }
    let size = camera.size.x * camera.size.y;
    let place = pixel.y * camera.size.x + pixel.x;
    for (var c = 0u; c < CHANNELS; c++) {
        frame[c * size + place] = sums[c / 4u][c % 4u];
    }
    frame[CHANNELS * size + place] = left;
}
