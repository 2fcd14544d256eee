// Tile rasteriser in the order of a window: the visible splats of a tile are read by the depth of
// their means, and the nearest of HITS is composited.
//
// Threads: one workgroup a tile, one invocation a pixel.
// Memory: an invocation keeps its window as a ring in private memory.
// Variants: number of channels, size of the window.
// Early exit: once the transmittance of the pixel is below TRANSMITTANCE_MIN.

@compute @workgroup_size(BLOCKS)
fn blend_window(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(tile.xy, local);
    let range = ranges[tile.y * camera.tiles.x + tile.x];
    blend_start();
    let point = vec2f(corner) + 0.5;
    var first = 0u;
    var count = 0u;
    for (var k = range.x; k < range.y && transmittance >= TRANSMITTANCE_MIN; k++) {
        let hit = hit_at(k, point);
        if hit.alpha == 0.0 {
            continue;
        }
        var place = count;
        while place > 0u && hits[(first + place - 1u) % HITS].depth > hit.depth {
            hits[(first + place) % HITS] = hits[(first + place - 1u) % HITS];
            place--;
        }
        hits[(first + place) % HITS] = hit;
        count++;
        if count == HITS {
            blend_hit(hits[first]);
            first = (first + 1u) % HITS;
            count--;
        }
    }
    for (var k = 0u; k < count && transmittance >= TRANSMITTANCE_MIN; k++) {
        blend_hit(hits[(first + k) % HITS]);
    }
    blend_end();
}
