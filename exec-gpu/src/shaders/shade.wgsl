// Gaussians to channels: one invocation a Gaussian.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> values: array<Stored>;
@group(0) @binding(2) var<storage, read_write> depth_keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> colors: array<f32>;

var<private> gaussian: u32;

// What is not finite is not drawn after all.
fn leave_out() {
    depth_keys[gaussian] = NOT_DRAWN;
    tile_counts[gaussian] = 0u;
    splats[gaussian].reach = -1.0;
}

@compute @workgroup_size(GROUP)
fn shade(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= camera.gaussian_count || depth_keys[gaussian] == NOT_DRAWN {
        return;
    }
    let own = channels_of();
    if own.is_finite == 0.0 {
        leave_out();
    }
    let channels = own.channels;
    let first = gaussian * CHANNEL_VECTORS * 4u;
    for (var c = 0u; c < CHANNELS; c++) {
        colors[first + c] = channels[c];
    }
    for (var c = CHANNELS; c < CHANNEL_VECTORS * 4u; c++) {
        colors[first + c] = 0.0;
    }
}
