// Declarations: gradient of the colour of a pixel of a physical material. Gradients of texels of
// the irradiance are added to their sums.

fn lit_pixel_vjp(surface: SurfaceOfPixel, point: vec2f, light: vec3f, grad: vec3f) -> LitPixelGrad {
    let facing = facing_of_pixel(point);
    let irradiance = radiance_in_level(facing.normal, IRRADIANCE_LEVEL);
    let split_sum = split_sum(facing.n_dot_v, surface.roughness);
    let grad_color = physical_color_of_pixel_vjp(
        surface.base,
        surface.tint,
        light,
        irradiance,
        split_sum,
        surface.coverage,
        grad,
    );
    let grad_normal = irradiance_vjp(facing.normal, grad_color.irradiance);
    let grad_table = split_sum_vjp(facing.n_dot_v, surface.roughness, grad_color.split_sum);
    let normal = facing_of_pixel_vjp(point, grad_normal, grad_table.x);
    let light_grad = grad_color.specular_light;
    return LitPixelGrad(grad_color.base, grad_color.tint, light_grad, grad_color.coverage, normal, grad_table.y);
}
