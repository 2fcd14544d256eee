// Declarations: light of a pixel whose reflected ray was traced.

@group(0) @binding(4) var<storage, read> reflections: array<f32>;

fn light_of(direction: vec3f, roughness: f32) -> vec3f {
    let lookup = lookup_of_reflection();
    return light_of_reflection(radiance(direction, roughness), radiance(lookup.direction, lookup.roughness));
}

fn indirect_of_pixel() -> vec3f {
    let lookup = lookup_of_reflection();
    return indirect_of_reflection(radiance(lookup.direction, lookup.roughness));
}

fn visibility_of_pixel() -> f32 {
    return visibility_of_reflection();
}
