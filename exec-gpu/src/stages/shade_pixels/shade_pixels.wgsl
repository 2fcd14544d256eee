// Deferred shading: one invocation a pixel.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read_write> frame: array<f32>;
@group(0) @binding(2) var<storage, read> texels: array<Texel>;
@group(0) @binding(3) var<storage, read_write> shaded: array<f32>;

var<private> place: u32;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + place];
}

// The tint, premultiplied.
fn tint_of_pixel() -> vec3f {
    return vec3f(blended(TINT_CHANNEL), blended(TINT_CHANNEL + 1u), blended(TINT_CHANNEL + 2u));
}

fn put(channel: u32, color: vec3f) {
    let size = camera.size.x * camera.size.y;
    frame[channel * size + place] = color.x;
    frame[(channel + 1u) * size + place] = color.y;
    frame[(channel + 2u) * size + place] = color.z;
}

@compute @workgroup_size(GROUP)
fn shade_pixels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let size = camera.size.x * camera.size.y;
    place = linear_index(group, groups, local);
    if place >= size {
        return;
    }
    let surface = surface_of_pixel(vec2f(vec2u(place % camera.size.x, place / camera.size.x)) + 0.5);
    let light = light_of(surface.reflection_dir, surface.roughness);
    let color = color_of_pixel(surface.base, surface.tint, light, surface.coverage);
    if SHOWS_LIGHT {
        put(LIGHT_CHANNEL, light * surface.coverage);
        put(SPECULAR_CHANNEL, tint_of_pixel() * light);
    }
    shaded[place] = color.x;
    shaded[size + place] = color.y;
    shaded[2u * size + place] = color.z;
}
