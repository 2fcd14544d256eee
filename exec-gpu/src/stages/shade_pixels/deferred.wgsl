// Declarations: colour of a pixel whose base is reflected light already.

fn lit_pixel(surface: SurfaceOfPixel, point: vec2f, light: vec3f) -> LitPixel {
    let color = color_of_pixel(surface.base, surface.tint, light, surface.coverage);
    return LitPixel(color, tint_of_pixel() * light);
}

fn irradiance_of_pixel(coverage: f32, point: vec2f) -> vec3f {
    return vec3f(0.0);
}
