// What must be known of splats before they are sorted, and whether there is room for that.

struct Measured {
    count: u32,
    // Room for pairs of a tile and a splat, and the key of what is not drawn.
    pairs_max: u32,
    not_drawn: u32,
}

@group(0) @binding(0) var<uniform> measured: Measured;
@group(0) @binding(1) var<storage, read> depth_keys: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> ledger: array<atomic<u32>>;

// One invocation for a column of Gaussians.
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
    var is_too_much = false;
    for (var gaussian = first; gaussian < end; gaussian++) {
        let key = depth_keys[gaussian];
        nearest = min(nearest, key);
        furthest = max(furthest, select(key, 0u, key == NOT_DRAWN));
        let own = tile_counts[gaussian];
        is_too_much |= tiles > ~own;
        tiles += own;
    }
    if tiles > 0u || is_too_much {
        atomicMin(&ledger[NEAREST], nearest);
        atomicMax(&ledger[FURTHEST], furthest);
        let before = atomicAdd(&ledger[PAIRS], tiles);
        if is_too_much || before > ~tiles {
            atomicStore(&ledger[IS_TOO_MUCH], 1u);
        }
    }
}

// One invocation: whether all that is needed fits.
@compute @workgroup_size(1)
fn settle() {
    let nearest = atomicLoad(&ledger[NEAREST]);
    let furthest = atomicLoad(&ledger[FURTHEST]);
    let pairs = atomicLoad(&ledger[PAIRS]);
    let has_room = atomicLoad(&ledger[IS_TOO_MUCH]) == 0u && pairs <= measured.pairs_max;
    let fits = has_room && (furthest < nearest || furthest - nearest < measured.not_drawn);
    atomicStore(&ledger[HELD], select(0u, pairs, fits));
    atomicStore(&ledger[IS_SHORT], select(1u, 0u, fits));
}
