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

// Gradient of the colour of a pixel.
struct LitPixelGrad {
    base: vec3f,
    tint: vec3f,
    light: vec3f,
    coverage: f32,
    // Gradient of the blended normal, without the part through the reflected direction.
    normal: vec3f,
    // Gradient of the roughness, without the part through the lookup of the reflected light.
    roughness: f32,
}

fn store_grad(channel: u32, grad: vec3f) {
    let size = camera.size.x * camera.size.y;
    let first = channel * size + pixel;
    grads[first] = grad.x;
    grads[first + size] = grad.y;
    grads[first + 2u * size] = grad.z;
}

fn grad_of(channel: u32) -> vec3f {
    let size = camera.size.x * camera.size.y;
    let first = channel * size + pixel;
    return vec3f(grads[first], grads[first + size], grads[first + 2u * size]);
}

@compute @workgroup_size(GROUP)
fn shade_pixels_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let size = camera.size.x * camera.size.y;
    pixel = linear_index(group, groups, local);
    if pixel >= size {
        return;
    }
    // Pixels without any splat have no gradient.
    if !(blended(TRANSMITTANCE) < 1.0) {
        return;
    }
    let point = vec2f(vec2u(pixel % camera.size.x, pixel / camera.size.x)) + 0.5;
    let surface = surface_of_pixel(point);
    let lookup = look_up(surface.reflection_dir, surface.roughness);
    let grad = grad_of(COLOR_CHANNEL);
    let grad_color = lit_pixel_vjp(surface, point, lookup.radiance, grad);
    let grad_light = look_up_vjp(lookup, surface.reflection_dir, surface.roughness, grad_color.light);
    let grad_roughness = grad_light.w + grad_color.roughness;
    let grad_surface = surface_of_pixel_vjp(point, grad_color.base, grad_color.tint, grad_roughness, grad_light.xyz);
    store_grad(COLOR_CHANNEL, grad_surface.base);
    if HAS_NORMAL {
        store_grad(NORMAL_CHANNEL, grad_of(NORMAL_CHANNEL) + grad_surface.normal + grad_color.normal);
    }
    if HAS_TINT {
        store_grad(TINT_CHANNEL, grad_of(TINT_CHANNEL) + grad_surface.tint);
    }
    if HAS_ROUGHNESS {
        grads[ROUGHNESS_CHANNEL * size + pixel] += grad_surface.roughness;
    }
    grads[TRANSMITTANCE * size + pixel] -= grad_surface.coverage + grad_color.coverage;
}
