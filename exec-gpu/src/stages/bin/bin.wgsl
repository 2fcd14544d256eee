// Emission of tile-splat pairs, front to back (stage `bin`).
//
// Threads: one invocation a Gaussian, by its rank in the order of depth.
// Inputs: splats, their order and numbers of tiles; the step counters.
// Outputs: offsets of each Gaussian's pairs; tile, emission index and Gaussian of each pair.
// Early exit: no pair is emitted if the capacity is exceeded.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(5) var<storage, read_write> tiles_of: array<u32>;
@group(0) @binding(6) var<storage, read_write> emissions: array<u32>;
@group(0) @binding(7) var<storage, read_write> emitted: array<u32>;
@group(0) @binding(8) var<storage, read> counters: array<u32>;

// Writes the numbers of tiles in the order of depth, followed by a zero: its exclusive prefix sum
// is the number of pairs.
@compute @workgroup_size(GROUP)
fn counts_in_order(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let rank = linear_index(group, groups, local);
    if rank < camera.gaussian_count {
        offsets[rank] = tile_counts[order[rank]];
    } else if rank == camera.gaussian_count {
        offsets[rank] = 0u;
    }
}

// Emits a pair for each tile of each splat, numbered in the order of depth. `offsets` are exclusive
// prefix sums.
@compute @workgroup_size(GROUP)
fn emit(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let rank = linear_index(group, groups, local);
    if rank >= camera.gaussian_count || counters[EXCEEDS_CAPACITY] != 0u {
        return;
    }
    var next = offsets[rank];
    let end = offsets[rank + 1u];
    if next == end {
        return;
    }
    let gaussian = order[rank];
    let splat = splats[gaussian];
    let shape = outline_of(splat.mean2d, splat.root, splat.reach);
    let rows = rows_of(splat);
    var before = camera.tiles.x * camera.tiles.y;
    var after = 0u;
    for (var row = rows.x; row < rows.y; row++) {
        let columns = columns_in_row(shape, row);
        for (var column = columns.x; column < columns.y && next < end; column++) {
            let tile = row * camera.tiles.x + column;
            emit_pair(next, tile, gaussian);
            before = min(before, tile);
            after = tile + 1u;
            next++;
        }
    }
    // Another kernel counted the tiles, and may round the edge of an outline differently. If this
    // one finds fewer, tiles outside of the splat are emitted instead: those after the last one, or
    // before the first.
    for (; next < end; next++) {
        if after < camera.tiles.x * camera.tiles.y {
            emit_pair(next, after, gaussian);
            after++;
        } else {
            before = max(before, 1u) - 1u;
            emit_pair(next, before, gaussian);
        }
    }
}

fn emit_pair(emission: u32, tile: u32, gaussian: u32) {
    tiles_of[emission] = tile;
    emissions[emission] = emission;
    emitted[emission] = gaussian;
}
