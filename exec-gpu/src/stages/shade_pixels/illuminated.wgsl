// Declarations: colour of a pixel of a physical material on which lamps shine.

fn direct_number(k: u32) -> f32 {
    return direct[k * camera.size.x * camera.size.y + pixel];
}

fn lit_pixel(surface: SurfaceOfPixel, point: vec2f, light: vec3f) -> LitPixel {
    let facing = facing_of_pixel(point);
    let irradiance = radiance_in_level(facing.normal, IRRADIANCE_LEVEL);
    let split_sum = split_sum(facing.n_dot_v, surface.roughness);
    let albedo = vec3f(blended(ALBEDO_CHANNEL), blended(ALBEDO_CHANNEL + 1u), blended(ALBEDO_CHANNEL + 2u));
    let lit = illuminated_color_of_pixel(
        surface.base, surface.tint, light, irradiance, split_sum, surface.coverage, albedo, blended(METALNESS_CHANNEL),
    );
    return LitPixel(lit.color, lit.specular);
}

fn irradiance_of_pixel(coverage: f32, point: vec2f) -> vec3f {
    let sky = radiance_in_level(facing_of_pixel(point).normal, IRRADIANCE_LEVEL) * blended(AMBIENT_CHANNEL);
    return sky + vec3f(direct_number(0u), direct_number(1u), direct_number(2u)) * coverage;
}
