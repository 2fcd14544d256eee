// Gradient of deferred shading: replaces the gradient of the colour by those of the blended
// channels; one invocation a pixel.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> frame: array<f32>;
@group(0) @binding(2) var<storage, read> texels: array<Texel>;
@group(0) @binding(3) var<storage, read_write> grads: array<f32>;
@group(0) @binding(4) var<storage, read_write> light_sums: array<atomic<u32>>;

var<private> place: u32;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + place];
}

fn put(channel: u32, grad: vec3f) {
    let size = camera.size.x * camera.size.y;
    let first = channel * size + place;
    grads[first] = grad.x;
    grads[first + size] = grad.y;
    grads[first + 2u * size] = grad.z;
}

fn grad_of(channel: u32) -> vec3f {
    let size = camera.size.x * camera.size.y;
    let first = channel * size + place;
    return vec3f(grads[first], grads[first + size], grads[first + 2u * size]);
}

@compute @workgroup_size(GROUP)
fn shade_pixels_vjp(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let size = camera.size.x * camera.size.y;
    place = linear_index(group, groups, local);
    if place >= size {
        return;
    }
    // Pixels without any splat have no gradient.
    if !(blended(TRANSMITTANCE) < 1.0) {
        return;
    }
    let point = vec2f(vec2u(place % camera.size.x, place / camera.size.x)) + 0.5;
    let surface = surface_of_pixel(point);
    let look = look_up(surface.reflection_dir, surface.roughness);
    let grad = grad_of(COLOR_CHANNEL);
    let of_color = color_of_pixel_vjp(surface.base, surface.tint, look.radiance, surface.coverage, grad);
    let of_light = look_up_vjp(look, surface.reflection_dir, surface.roughness, of_color.light);
    let own = surface_of_pixel_vjp(point, of_color.base, of_color.tint, of_light.w, of_light.xyz);
    put(COLOR_CHANNEL, own.base);
    if HAS_NORMAL {
        put(NORMAL_CHANNEL, grad_of(NORMAL_CHANNEL) + own.normal);
    }
    if HAS_TINT {
        put(TINT_CHANNEL, grad_of(TINT_CHANNEL) + own.tint);
    }
    if HAS_ROUGHNESS {
        grads[ROUGHNESS_CHANNEL * size + place] += own.roughness;
    }
    grads[TRANSMITTANCE * size + place] -= own.coverage + of_color.coverage;
}
