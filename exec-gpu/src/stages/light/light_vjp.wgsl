// Looking light up and back: the gradient of the texels is added to their sums, that of direction
// and roughness is returned.

// A place between four neighbouring texels of a level, the first of them the upper left one.
struct Place {
    first: u32,
    resolution: u32,
    right: f32,
    lower: f32,
    texels: mat4x3f,
    radiance: vec3f,
}

// A look at a light, with what its gradient needs.
struct Look {
    sharp: Place,
    blurred: Place,
    // Share of the blurred level.
    share: f32,
    radiance: vec3f,
}

fn place_in_level(direction: vec3f, level: u32) -> Place {
    let resolution = level_resolution(level);
    let at = texels_at(direction, f32(resolution));
    let first = level_start(level) + u32(at.texel);
    let below = first + resolution + 2u;
    let corners = mat4x3f(texel(first), texel(first + 1u), texel(below), texel(below + 1u));
    let radiance = texels_mean(corners[0], corners[1], corners[2], corners[3], at.right, at.lower);
    return Place(first, resolution, at.right, at.lower, corners, radiance);
}

fn look_up(direction: vec3f, roughness: f32) -> Look {
    let between = levels_at(roughness);
    let sharp = place_in_level(direction, between.level);
    let blurred = place_in_level(direction, between.level + 1u);
    return Look(sharp, blurred, between.share, mix(sharp.radiance, blurred.radiance, between.share));
}

// With respect to the point on the face; adds to the texels.
fn place_vjp(at: Place, grad: vec3f) -> vec2f {
    let shares = texel_shares(at.right, at.lower);
    let below = at.first + at.resolution + 2u;
    add_to_texel(at.first, grad * shares.x);
    add_to_texel(at.first + 1u, grad * shares.y);
    add_to_texel(below, grad * shares.z);
    add_to_texel(below + 1u, grad * shares.w);
    let corners = at.texels;
    let resolution = f32(at.resolution);
    return texels_vjp(corners[0], corners[1], corners[2], corners[3], at.right, at.lower, resolution, grad);
}

// With respect to the direction, and to the roughness, that were looked up.
fn look_up_vjp(look: Look, direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    let of_point = place_vjp(look.sharp, grad * (1.0 - look.share)) + place_vjp(look.blurred, grad * look.share);
    let of_roughness = roughness_vjp(roughness, look.sharp.radiance, look.blurred.radiance, grad);
    return vec4f(direction_vjp(direction, of_point), of_roughness);
}

// Of `radiance`: with respect to the direction, and to the roughness.
fn radiance_vjp(direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    return look_up_vjp(look_up(direction, roughness), direction, roughness, grad);
}

// Of the irradiance, the map behind the last level: with respect to the direction.
fn irradiance_vjp(direction: vec3f, grad: vec3f) -> vec3f {
    return direction_vjp(direction, place_vjp(place_in_level(direction, LEVELS), grad));
}
