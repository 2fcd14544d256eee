// Deferred shading (stage `shade_pixels`).
//
// Threads: one invocation a pixel.
// Inputs: camera, blended surface attributes, texels of the light, reflections that were traced,
// light of lamps.
// Outputs: colours; the layers of light and specular colour where they are requested.
// Variants: blended channels; with or without a light, reflections, light of lamps; base colours or
// physical materials; the layer of light.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read_write> frame: array<f32>;
@group(0) @binding(2) var<storage, read> texels: array<Texel>;
@group(0) @binding(3) var<storage, read_write> shaded: array<f32>;

var<private> pixel: u32;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + pixel];
}

@compute @workgroup_size(GROUP)
fn shade_pixels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    pixel = linear_index(group, groups, local);
    if pixel < camera.size.x * camera.size.y {
        shade_pixel(vec2f(vec2u(pixel % camera.size.x, pixel / camera.size.x)) + 0.5);
    }
}
