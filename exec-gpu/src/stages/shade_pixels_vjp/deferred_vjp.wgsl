// Declarations: gradient of the colour of a pixel whose base is reflected light already.

fn lit_pixel_vjp(surface: SurfaceOfPixel, point: vec2f, light: vec3f, grad: vec3f) -> LitPixelGrad {
    let grad_color = color_of_pixel_vjp(surface.base, surface.tint, light, surface.coverage, grad);
    return LitPixelGrad(grad_color.base, grad_color.tint, grad_color.light, grad_color.coverage, vec3f(0.0), 0.0);
}
