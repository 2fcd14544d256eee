// Sums of slots to gradients of splats: each Gaussian adds its slots in the order of emission.

// Emissions that have a slot, and the chunk of the sums.
struct Batch {
    first: u32,
    end: u32,
    first_gaussian: u32,
    // With the padding of its last block.
    gaussians_end: u32,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> batch: Batch;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read> offsets: array<u32>;
@group(0) @binding(5) var<storage, read> slots: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

// Index in its chunk.
var<private> gaussian: u32;

fn place_of(number: u32) -> u32 {
    return (gaussian / BLOCK * SLOT + number) * BLOCK + gaussian % BLOCK;
}

fn sum_of(number: u32) -> f32 {
    return sums[place_of(number)];
}

fn put_sum(number: u32, value: f32) {
    sums[place_of(number)] = value;
}

// Adds the slots of a batch to one number of one Gaussian; one invocation a number.
@compute @workgroup_size(GROUP)
fn sum_slots(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let index = linear_index(group, groups, local);
    let place = index / SLOT;
    let number = index % SLOT;
    // Padding of the last block.
    let is_filling = place >= camera.gaussian_count;
    var whose = place;
    if !is_filling {
        whose = order[place];
    }
    if whose < batch.first_gaussian || whose >= batch.gaussians_end {
        return;
    }
    gaussian = whose - batch.first_gaussian;
    if is_filling {
        put_sum(number, 0.0);
        return;
    }
    var sum = 0.0;
    if batch.first > 0u {
        sum = sum_of(number);
    }
    let end = min(offsets[place + 1u], batch.end);
    for (var emission = max(offsets[place], batch.first); emission < end; emission++) {
        sum += slots[(emission - batch.first) * SLOT + number];
    }
    put_sum(number, sum);
}

fn is_zero(number: f32) -> bool {
    return (bitcast<u32>(number) & 0x7fffffffu) == 0u;
}

// Converts moments to gradients; one invocation a Gaussian.
@compute @workgroup_size(GROUP)
fn finish_splats(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    let whose = batch.first_gaussian + gaussian;
    if whose >= min(camera.gaussian_count, batch.gaussians_end) {
        return;
    }
    var is_seen = false;
    for (var number = 0u; number < MOMENTS; number++) {
        is_seen |= !is_zero(sum_of(number));
    }
    if is_seen {
        let splat = splats[whose];
        moments_vjp(splat.root, splat.opacity);
    }
}
