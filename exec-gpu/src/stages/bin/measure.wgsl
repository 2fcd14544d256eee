// Number of tile-splat pairs and range of depths, compared with the capacity (stage `bin`).
//
// Threads: `measure`: one invocation a column of COLUMN Gaussians; `settle`: one invocation.
// Inputs: depths as bits that sort, and the number of tiles of each Gaussian.
// Outputs: step counters.

@group(0) @binding(0) var<uniform> measured: Measured;
@group(0) @binding(1) var<storage, read> depth_keys: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> counters: array<atomic<u32>>;

// Adds the pairs of a column of Gaussians, and extends the range of depths.
@compute @workgroup_size(GROUP)
fn measure(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let first = linear_index(group, groups, local) * COLUMN;
    let end = min(first + COLUMN, measured.count);
    var nearest = NOT_DRAWN;
    var furthest = 0u;
    var tiles = 0u;
    var overflows = false;
    for (var gaussian = first; gaussian < end; gaussian++) {
        let key = depth_keys[gaussian];
        nearest = min(nearest, key);
        furthest = max(furthest, select(key, 0u, key == NOT_DRAWN));
        let tile_count = tile_counts[gaussian];
        overflows |= tiles > ~tile_count;
        tiles += tile_count;
    }
    if tiles > 0u || overflows {
        atomicMin(&counters[NEAREST], nearest);
        atomicMax(&counters[FURTHEST], furthest);
        let before = atomicAdd(&counters[PAIRS], tiles);
        if overflows || before > ~tiles {
            atomicStore(&counters[OVERFLOWS], 1u);
        }
    }
}

// Compares the counts with the capacity.
@compute @workgroup_size(1)
fn settle() {
    let nearest = atomicLoad(&counters[NEAREST]);
    let furthest = atomicLoad(&counters[FURTHEST]);
    let pairs = atomicLoad(&counters[PAIRS]);
    let is_within = atomicLoad(&counters[OVERFLOWS]) == 0u && pairs <= measured.pairs_max;
    let fits = is_within && (furthest < nearest || furthest - nearest < measured.not_drawn);
    atomicStore(&counters[STORED_PAIRS], select(0u, pairs, fits));
    atomicStore(&counters[EXCEEDS_CAPACITY], select(1u, 0u, fits));
}
