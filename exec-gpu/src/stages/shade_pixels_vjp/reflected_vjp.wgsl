// Declarations: lookups of a pixel whose reflected ray was traced, with their gradients. Gradients
// of texels are added to their sums; those of direction and roughness are returned only for the
// pixel's own lookup, as hit points are detached.

@group(0) @binding(5) var<storage, read> reflections: array<f32>;

struct ReflectedLookup {
    own: LightLookup,
    of_near: LightLookup,
    radiance: vec3f,
}

fn look_up_reflected(direction: vec3f, roughness: f32) -> ReflectedLookup {
    let own = look_up(direction, roughness);
    let second = lookup_of_reflection();
    let near = look_up(second.direction, second.roughness);
    return ReflectedLookup(own, near, light_of_reflection(own.radiance, near.radiance));
}

fn look_up_reflected_vjp(reflected: ReflectedLookup, direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    let second = lookup_of_reflection();
    let grads = light_of_reflection_vjp(grad);
    look_up_vjp(reflected.of_near, second.direction, second.roughness, grads.of_near);
    return look_up_vjp(reflected.own, direction, roughness, grads.own);
}
