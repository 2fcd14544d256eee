// Declarations: light of a pixel whose reflected ray was traced.

@group(0) @binding(4) var<storage, read> reflections: array<f32>;

fn light_of(direction: vec3f, roughness: f32) -> vec3f {
    let lookup = lookup_of_reflection();
    return light_of_reflection(radiance(direction, roughness), radiance(lookup.direction, lookup.roughness));
}
