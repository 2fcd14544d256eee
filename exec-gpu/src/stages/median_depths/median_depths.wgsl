// Median depths: in each pixel the depth of the splat that brings the transmittance to one half or
// less, infinite without one.
//
// Threads: one workgroup a tile, one invocation a pixel.
// Memory: an invocation reads the splats of its tile from storage.
// Early exit: at the median.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(3) var<storage, read> gaussians_of: array<u32>;
// Bits of the depths.
@group(0) @binding(4) var<storage, read_write> medians: array<u32>;

@compute @workgroup_size(BLOCKS)
fn median_depths(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(tile.xy, local);
    if !is_inside(0u) {
        return;
    }
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    let point = vec2f(corner) + 0.5;
    var transmittance = 1.0;
    var median = INFINITY;
    for (var k = range.x; k < range.y && median == INFINITY; k++) {
        let splat = splats[gaussians_of[k]];
        let alpha = alpha_of(splat.root, splat.log2_opacity, point - splat.mean2d);
        let step = median_step(alpha, transmittance);
        if step.is_median != 0.0 {
            median = bitcast<u32>(splat.depth);
        }
        transmittance = step.behind;
    }
    medians[corner.y * camera.size.x + corner.x] = median;
}
