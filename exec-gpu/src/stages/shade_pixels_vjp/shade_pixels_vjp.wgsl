// Gradient of deferred shading (stage `shade_pixels_vjp`).
//
// Threads: one invocation a pixel.
// Inputs: camera, blended surface attributes, texels of the light, reflections that were traced,
// gradient of the colours.
// Outputs: gradients of the blended channels, in place of those of the colours; sums of the
// gradients of the light's texels.
// Variants: blended channels; with or without a light, with or without reflections; base colours or
// physical materials.
// Early exit: pixels without a splat.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> frame: array<f32>;
@group(0) @binding(2) var<storage, read> texels: array<Texel>;
@group(0) @binding(3) var<storage, read_write> grads: array<f32>;
@group(0) @binding(4) var<storage, read_write> light_sums: array<atomic<u32>>;

var<private> pixel: u32;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + pixel];
}

@compute @workgroup_size(GROUP)
fn shade_pixels_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    pixel = linear_index(group, groups, local);
    // Pixels without any splat have no gradient.
    if pixel < camera.size.x * camera.size.y && blended(TRANSMITTANCE) < 1.0 {
        shade_pixel_vjp(vec2f(vec2u(pixel % camera.size.x, pixel / camera.size.x)) + 0.5);
    }
}
