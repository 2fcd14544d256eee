// States of the pixels in front of the segments of each tile: replays its splats, front to back.
//
// Threads: one workgroup a tile, one invocation a pixel.
// Memory: as the tile rasteriser of splats in batches, which divide segments.
// Outputs: segments, first that of each tile with its first splat, then those that begin at
// multiples of SEGMENT; states in front of them.
// Variants: number of channels.
// Early exit: once all pixels of the tile have terminated.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> kept: Kept;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> colors: array<vec4f>;
@group(0) @binding(4) var<storage, read> gaussians_of: array<u32>;
@group(0) @binding(5) var<storage, read> frame_grad: array<f32>;
@group(0) @binding(6) var<storage, read> ranges: array<vec2u>;
@group(0) @binding(7) var<storage, read> frame: array<f32>;
@group(0) @binding(8) var<storage, read_write> segments: array<Segment>;
@group(0) @binding(9) var<storage, read_write> states: array<vec2f>;

// End of the segment with a splat.
fn segment_end(splat: u32, range: vec2u) -> u32 {
    return min(splat / SEGMENT * SEGMENT + SEGMENT, range.y);
}

// Number of the segment that begins with a splat.
fn segment_at(splat: u32, range: vec2u, tile: u32) -> u32 {
    return select(camera.tiles.x * camera.tiles.y + splat / SEGMENT, tile, splat == range.x);
}

fn keep_segment(splat: u32, range: vec2u, tile: u32, is_over: u32) {
    let segment = segment_at(splat, range, tile);
    if kept.first <= segment && segment < kept.end {
        segments[segment - kept.first] = Segment(tile, splat, segment_end(splat, range), is_over);
    }
}

fn keep_state(splat: u32, range: vec2u, tile: u32, local: u32) {
    let segment = segment_at(splat, range, tile);
    if kept.first <= segment && segment < kept.end {
        states[(segment - kept.first) * BLOCKS + local] = vec2f(transmittance, remaining);
    }
}

fn replay_staged(k: u32, point: vec2f) -> f32 {
    let splat = staged[k];
    read_staged_color(k);
    replay_state(splat.root, splat.log2_opacity, point - splat.mean2d);
    return transmittance;
}

// Replays a batch of splats; returns whether the pixel takes further splats.
fn replay_splats(count: u32) -> bool {
    let point = vec2f(corner) + 0.5;
    for (var k = 0u; k < count; k += SPLATS_A_ROUND) {
        if replay_round(k, point) == 0.0 {
            return false;
        }
    }
    return true;
}

@compute @workgroup_size(BLOCKS)
fn replay_states(@builtin(workgroup_id) at: vec3u, @builtin(local_invocation_index) local: u32) {
    corner = corner_of(at.xy, local);
    let tile = at.y * camera.tiles.x + at.x;
    let range = ranges[tile];
    replay_start();
    start_tile(local);
    var is_active = true;
    var first = range.x;
    while first < range.y {
        let end = min(first / BATCH * BATCH + BATCH, range.y);
        if first == range.x || first % SEGMENT == 0u {
            if local == 0u {
                keep_segment(first, range, tile, 0u);
            }
            keep_state(first, range, tile, local);
        }
        stage_splats(first, end - first, local);
        workgroupBarrier();
        if is_active {
            is_active = replay_splats(end - first);
            if !is_active {
                atomicSub(&active_count, 1u);
            }
        }
        first = end;
        if is_tile_over(local) {
            break;
        }
    }
    for (var splat = (first + SEGMENT - 1u) / SEGMENT * SEGMENT + local * SEGMENT; splat < range.y; splat += BLOCKS * SEGMENT) {
        keep_segment(splat, range, tile, 1u);
    }
}
