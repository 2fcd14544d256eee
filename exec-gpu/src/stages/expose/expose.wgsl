// Exposure of an image (stage `expose`).
//
// Threads: one invocation a pixel.
// Inputs: exposure, colours, transmittance.
// Outputs: exposed colours.

@group(0) @binding(3) var<storage, read_write> exposed: array<f32>;

@compute @workgroup_size(GROUP)
fn expose(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let size = pixel_count();
    let index = linear_index(group, groups, local);
    if index >= size {
        return;
    }
    let color = expose_pixel(color_at(index), transmittance_at(index));
    exposed[index] = color.x;
    exposed[size + index] = color.y;
    exposed[2u * size + index] = color.z;
}
