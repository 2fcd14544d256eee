// Declarations: lookup of a pixel whose reflected ray was traced, with its gradient. Gradients of
// texels are added to their sums; those of direction and roughness are returned, and are zero where
// the ray meets a surface.

@group(0) @binding(5) var<storage, read> reflections: array<f32>;

struct ReflectedLookup {
    far_light: LightLookup,
    radiance: vec3f,
}

fn look_up_reflected(direction: vec3f, roughness: f32) -> ReflectedLookup {
    let lookup = lookup_of_reflection();
    let far_light = look_up(lookup.direction, lookup.roughness);
    return ReflectedLookup(far_light, light_of_reflection(far_light.radiance));
}

fn look_up_reflected_vjp(reflected: ReflectedLookup, direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    let lookup = lookup_of_reflection();
    let of_far_light = light_of_reflection_vjp(grad);
    return look_up_vjp(reflected.far_light, lookup.direction, lookup.roughness, of_far_light) * lookup.far;
}
