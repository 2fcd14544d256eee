// Declarations: gradient of the colour of a pixel whose base is reflected light already.

fn lit_pixel_vjp(surface: SurfaceOfPixel, point: vec2f, light: vec3f, grad: vec3f) -> LitPixelGrad {
    let of_color = color_of_pixel_vjp(surface.base, surface.tint, light, surface.coverage, grad);
    return LitPixelGrad(of_color.base, of_color.tint, of_color.light, of_color.coverage, vec3f(0.0), 0.0);
}
