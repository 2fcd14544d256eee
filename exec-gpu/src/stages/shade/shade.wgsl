// Shading of Gaussians: one invocation a Gaussian.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> values: array<Stored>;
@group(0) @binding(2) var<storage, read_write> depth_keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> colors: array<f32>;

// Index in its chunk.
var<private> gaussian: u32;

// Marks a Gaussian with a non-finite attribute as not drawn.
fn leave_out(place: u32) {
    depth_keys[place] = NOT_DRAWN;
    tile_counts[place] = 0u;
    splats[place].reach = -1.0;
}

@compute @workgroup_size(GROUP)
fn shade(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    let place = camera.first_gaussian + gaussian;
    if gaussian >= camera.gaussian_count || depth_keys[place] == NOT_DRAWN {
        return;
    }
    let own = channels_of();
    if own.is_finite == 0.0 {
        leave_out(place);
    }
    let channels = own.channels;
    let first = place * CHANNEL_VECTORS * 4u;
    for (var c = 0u; c < CHANNELS; c++) {
        colors[first + c] = channels[c];
    }
    for (var c = CHANNELS; c < CHANNEL_VECTORS * 4u; c++) {
        colors[first + c] = 0.0;
    }
}
