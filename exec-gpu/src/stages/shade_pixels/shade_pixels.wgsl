// Deferred shading (stage `shade_pixels`).
//
// Threads: one invocation a pixel.
// Inputs: camera, blended surface attributes, texels of the light, reflections that were traced.
// Outputs: colours; the layers of light and specular colour where they are requested.
// Variants: blended channels; with or without a light, with or without reflections; base colours or
// physical materials; the layer of light.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read_write> frame: array<f32>;
@group(0) @binding(2) var<storage, read> texels: array<Texel>;
@group(0) @binding(3) var<storage, read_write> shaded: array<f32>;

var<private> pixel: u32;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + pixel];
}

// The tint, premultiplied.
fn tint_of_pixel() -> vec3f {
    return vec3f(blended(TINT_CHANNEL), blended(TINT_CHANNEL + 1u), blended(TINT_CHANNEL + 2u));
}

// Colour of a pixel and its specular part.
struct LitPixel {
    color: vec3f,
    specular: vec3f,
}

fn store_layer(channel: u32, color: vec3f) {
    let size = camera.size.x * camera.size.y;
    frame[channel * size + pixel] = color.x;
    frame[(channel + 1u) * size + pixel] = color.y;
    frame[(channel + 2u) * size + pixel] = color.z;
}

// The layer of light, premultiplied.
fn light_layer(light: vec3f, coverage: f32, point: vec2f) -> vec3f {
    if LIGHT_LAYER == INDIRECT {
        return indirect_of_pixel() * coverage;
    }
    if LIGHT_LAYER == VISIBILITY {
        return vec3f(visibility_of_pixel() * coverage);
    }
    if LIGHT_LAYER == IRRADIANCE {
        return irradiance_of_pixel(coverage, point);
    }
    return light * coverage;
}

@compute @workgroup_size(GROUP)
fn shade_pixels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let size = camera.size.x * camera.size.y;
    pixel = linear_index(group, groups, local);
    if pixel >= size {
        return;
    }
    let point = vec2f(vec2u(pixel % camera.size.x, pixel / camera.size.x)) + 0.5;
    let surface = surface_of_pixel(point);
    let light = light_of(surface.reflection_dir, surface.roughness);
    let lit = lit_pixel(surface, point, light);
    if SHOWS_LIGHT {
        store_layer(LIGHT_CHANNEL, light_layer(light, surface.coverage, point));
        store_layer(SPECULAR_CHANNEL, lit.specular);
    }
    shaded[pixel] = lit.color.x;
    shaded[size + pixel] = lit.color.y;
    shaded[2u * size + pixel] = lit.color.z;
}
