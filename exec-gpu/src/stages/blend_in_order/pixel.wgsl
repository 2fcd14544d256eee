// Tile rasteriser in the exact order of each pixel: passes over the splats of a tile select the
// next HITS by depth, after those of the previous pass.
//
// Threads: one workgroup a tile, one invocation a pixel.
// Memory: an invocation keeps the selected splats, sorted, in private memory.
// Variants: number of channels.
// Early exit: once the transmittance of the pixel is below TRANSMITTANCE_MIN.

// Whether a splat is behind another in this pixel.
fn is_behind(hit: Hit, other: Hit) -> bool {
    return hit.depth > other.depth || (hit.depth == other.depth && hit.position > other.position);
}

@compute @workgroup_size(BLOCKS)
fn blend_pixel(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(tile.xy, local);
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    blend_start();
    let point = vec2f(corner) + 0.5;
    // Before all splats: depths are not negative.
    var last = Hit(-1.0, 0.0, 0u, 0u);
    var count = HITS;
    while count == HITS && transmittance >= TRANSMITTANCE_MIN {
        count = 0u;
        for (var k = range.x; k < range.y; k++) {
            let hit = hit_at(k, point);
            if hit.alpha == 0.0 || !is_behind(hit, last) {
                continue;
            }
            // Replaces the farthest of a full selection.
            var place = min(count, HITS - 1u);
            if count == HITS && !(hits[place].depth > hit.depth) {
                continue;
            }
            count = place + 1u;
            while place > 0u && hits[place - 1u].depth > hit.depth {
                hits[place] = hits[place - 1u];
                place--;
            }
            hits[place] = hit;
        }
        for (var k = 0u; k < count && transmittance >= TRANSMITTANCE_MIN; k++) {
            blend_hit(hits[k]);
        }
        last = hits[HITS - 1u];
    }
    blend_end();
}
