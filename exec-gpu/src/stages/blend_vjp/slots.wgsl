// Sums of slots, and their conversion to gradients of splats (stage `blend_vjp`).
//
// Threads: `sum_slots`: one invocation a number of a Gaussian, Gaussians by their rank in the order
// of depth; `finish_splats`: one invocation a Gaussian of the chunk.
// Inputs: slots of a batch of emissions, by emission index; offsets of each Gaussian's emissions.
// Outputs: sums of each Gaussian's slots in the order of emission, then gradients in their place.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> batch: SlotBatch;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read> offsets: array<u32>;
@group(0) @binding(5) var<storage, read> slots: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

// Index in its chunk.
var<private> gaussian: u32;

fn sum_index(number: u32) -> u32 {
    return (gaussian / BLOCK * SLOT + number) * BLOCK + gaussian % BLOCK;
}

fn sum_of(number: u32) -> f32 {
    return sums[sum_index(number)];
}

fn store_sum(number: u32, value: f32) {
    sums[sum_index(number)] = value;
}

// Adds the slots of a batch to one number of one Gaussian.
@compute @workgroup_size(GROUP)
fn sum_slots(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let invocation = linear_index(group, groups, local);
    let rank = invocation / SLOT;
    let number = invocation % SLOT;
    // Padding of the last block.
    let is_padding = rank >= camera.gaussian_count;
    var index = rank;
    if !is_padding {
        index = order[rank];
    }
    if index < batch.first_gaussian || index >= batch.gaussians_end {
        return;
    }
    gaussian = index - batch.first_gaussian;
    if is_padding {
        store_sum(number, 0.0);
        return;
    }
    var sum = 0.0;
    if batch.first > 0u {
        sum = sum_of(number);
    }
    let end = min(offsets[rank + 1u], batch.end);
    for (var emission = max(offsets[rank], batch.first); emission < end; emission++) {
        sum += slots[(emission - batch.first) * SLOT + number];
    }
    store_sum(number, sum);
}

fn is_zero(number: f32) -> bool {
    return (bitcast<u32>(number) & 0x7fffffffu) == 0u;
}

// Converts moments to gradients.
@compute @workgroup_size(GROUP)
fn finish_splats(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    let index = batch.first_gaussian + gaussian;
    if index >= min(camera.gaussian_count, batch.gaussians_end) {
        return;
    }
    var has_moments = false;
    for (var number = 0u; number < MOMENTS; number++) {
        has_moments |= !is_zero(sum_of(number));
    }
    if has_moments {
        let splat = splats[index];
        moments_vjp(splat.root, splat.opacity);
    }
}
