// Shading of Gaussians (stage `shade`).
//
// Threads: one invocation a Gaussian of the chunk.
// Inputs: camera, planes of the Gaussians; with a light, its texels and the split-sum table.
// Outputs: channels of each Gaussian, padded to vectors of four; Gaussians with an attribute that
// is not finite are marked as not drawn.
// Variants: shading, layout and storage format of the planes, with or without a light.
// Early exit: Gaussians that are not drawn.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> values: array<Stored>;
@group(0) @binding(2) var<storage, read_write> depth_keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> colors: array<f32>;

// Index in its chunk.
var<private> gaussian: u32;

// Marks a Gaussian with a non-finite attribute as not drawn.
fn cull(index: u32) {
    depth_keys[index] = NOT_DRAWN;
    tile_counts[index] = 0u;
    splats[index].reach = -1.0;
}

@compute @workgroup_size(GROUP)
fn shade(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    let index = camera.first_gaussian + gaussian;
    if gaussian >= camera.gaussian_count || depth_keys[index] == NOT_DRAWN {
        return;
    }
    let shaded = channels_of();
    if shaded.is_finite == 0.0 {
        cull(index);
    }
    let channels = shaded.channels;
    let first = index * CHANNEL_VECTORS * 4u;
    for (var c = 0u; c < CHANNELS; c++) {
        colors[first + c] = channels[c];
    }
    for (var c = CHANNELS; c < CHANNEL_VECTORS * 4u; c++) {
        colors[first + c] = 0.0;
    }
}
