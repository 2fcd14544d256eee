// Exposure of an image: one invocation a pixel.

@group(0) @binding(3) var<storage, read_write> exposed: array<f32>;

@compute @workgroup_size(GROUP)
fn expose(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let size = pixel_count();
    let place = linear_index(group, groups, local);
    if place >= size {
        return;
    }
    let color = expose_pixel(color_at(place), passed_at(place));
    exposed[place] = color.x;
    exposed[size + place] = color.y;
    exposed[2u * size + place] = color.z;
}
