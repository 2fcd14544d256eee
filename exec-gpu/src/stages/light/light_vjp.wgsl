// Declarations: lookup of a light with its gradient. Gradients of texels are added to their sums,
// those of direction and roughness are returned.

// Bilinear sample of a level; `first` is the upper left of its four texels.
struct LevelSample {
    first: u32,
    resolution: u32,
    right: f32,
    lower: f32,
    texels: mat4x3f,
    radiance: vec3f,
}

// Lookup between two levels, with the inputs of its gradient.
struct LightLookup {
    sharp: LevelSample,
    blurred: LevelSample,
    // Share of the blurred level.
    share: f32,
    radiance: vec3f,
}

fn sample_level(direction: vec3f, level: u32) -> LevelSample {
    let resolution = level_resolution(level);
    let at = texels_at(direction, f32(resolution));
    let first = level_start(level) + u32(at.texel);
    let below = first + resolution + 2u;
    let corners = mat4x3f(texel(first), texel(first + 1u), texel(below), texel(below + 1u));
    let radiance = texels_mean(corners[0], corners[1], corners[2], corners[3], at.right, at.lower);
    return LevelSample(first, resolution, at.right, at.lower, corners, radiance);
}

fn look_up(direction: vec3f, roughness: f32) -> LightLookup {
    let between = levels_at(roughness);
    let sharp = sample_level(direction, between.level);
    let blurred = sample_level(direction, between.level + 1u);
    return LightLookup(sharp, blurred, between.share, mix(sharp.radiance, blurred.radiance, between.share));
}

// Gradient with respect to the point on the face; adds to the texels.
fn level_sample_vjp(at: LevelSample, grad: vec3f) -> vec2f {
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

// Gradient with respect to direction and roughness.
fn look_up_vjp(lookup: LightLookup, direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    let of_sharp = level_sample_vjp(lookup.sharp, grad * (1.0 - lookup.share));
    let of_point = of_sharp + level_sample_vjp(lookup.blurred, grad * lookup.share);
    let of_roughness = roughness_vjp(roughness, lookup.sharp.radiance, lookup.blurred.radiance, grad);
    return vec4f(direction_vjp(direction, of_point), of_roughness);
}

// Gradient of `radiance` with respect to direction and roughness.
fn radiance_vjp(direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    return look_up_vjp(look_up(direction, roughness), direction, roughness, grad);
}

// Irradiance / pi along a normal, with the inputs of its gradient.
fn look_up_irradiance(normal: vec3f) -> LevelSample {
    return sample_level(normal, IRRADIANCE_LEVEL);
}

// Gradient with respect to the normal.
fn look_up_irradiance_vjp(lookup: LevelSample, normal: vec3f, grad: vec3f) -> vec3f {
    return direction_vjp(normal, level_sample_vjp(lookup, grad));
}

// Gradient of `irradiance` with respect to the normal.
fn irradiance_vjp(normal: vec3f, grad: vec3f) -> vec3f {
    return look_up_irradiance_vjp(look_up_irradiance(normal), normal, grad);
}
