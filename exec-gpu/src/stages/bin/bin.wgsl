// Emission of tile-splat pairs, front to back.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(5) var<storage, read_write> tiles_of: array<u32>;
@group(0) @binding(6) var<storage, read_write> emissions: array<u32>;
@group(0) @binding(7) var<storage, read_write> emitted: array<u32>;
@group(0) @binding(8) var<storage, read> counters: array<u32>;

// Numbers of tiles in the order of depth, and a zero behind them, whose exclusive sum is that of
// all.
@compute @workgroup_size(GROUP)
fn counts_in_order(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let place = linear_index(group, groups, local);
    if place < camera.gaussian_count {
        offsets[place] = tile_counts[order[place]];
    } else if place == camera.gaussian_count {
        offsets[place] = 0u;
    }
}

// Emits a pair for each tile of each splat, numbered in the order of depth, with its Gaussian; none
// where the capacity is exceeded.
@compute @workgroup_size(GROUP)
fn emit(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let place = linear_index(group, groups, local);
    if place >= camera.gaussian_count || counters[EXCEEDS_CAPACITY] != 0u {
        return;
    }
    var next = offsets[place];
    if next == offsets[place + 1u] {
        return;
    }
    let gaussian = order[place];
    let splat = splats[gaussian];
    let shape = outline_of(splat.mean2d, splat.root, splat.reach);
    let rows = rows_of(splat);
    for (var row = rows.x; row < rows.y; row++) {
        let columns = columns_in_row(shape, row);
        for (var column = columns.x; column < columns.y; column++) {
            tiles_of[next] = row * camera.tiles.x + column;
            emissions[next] = next;
            emitted[next] = gaussian;
            next++;
        }
    }
}
