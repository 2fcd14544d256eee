// The gradient of looking light up: that of the texels is added to their sums, that of direction and roughness is
// returned.

fn is_zero(grad: vec3f) -> bool {
    return all((bitcast<vec3u>(grad) << vec3u(1u)) == vec3u(0u));
}

fn level_vjp(direction: vec3f, level: u32, grad: vec3f) -> TexelsVjp {
    let resolution = level_resolution(level);
    let at = texels_at(direction, f32(resolution));
    let upper = level_start(level) + u32(at.texel);
    let lower = upper + resolution + 2u;
    if !is_zero(grad) {
        let shares = texel_shares(at.right, at.lower);
        add_to_texel(upper, grad * shares.x);
        add_to_texel(upper + 1u, grad * shares.y);
        add_to_texel(lower, grad * shares.z);
        add_to_texel(lower + 1u, grad * shares.w);
    }
    return texels_vjp(
        texel(upper),
        texel(upper + 1u),
        texel(lower),
        texel(lower + 1u),
        at.right,
        at.lower,
        f32(resolution),
        grad,
    );
}

// Of `radiance`: with respect to the direction, and to the roughness.
fn radiance_vjp(direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    let between = levels_at(roughness);
    let sharp = level_vjp(direction, between.level, grad * (1.0 - between.share));
    let blurred = level_vjp(direction, between.level + 1u, grad * between.share);
    return vec4f(
        direction_vjp(direction, sharp.point + blurred.point),
        roughness_vjp(roughness, sharp.radiance, blurred.radiance, grad),
    );
}

// Of the irradiance, the map behind the last level: with respect to the direction.
fn irradiance_vjp(direction: vec3f, grad: vec3f) -> vec3f {
    return direction_vjp(direction, level_vjp(direction, LEVELS, grad).point);
}
