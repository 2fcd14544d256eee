// Declarations: gradient of the colour of a pixel of a physical material. Gradients of texels of
// the irradiance are added to their sums.

fn lit_pixel_vjp(surface: SurfaceOfPixel, point: vec2f, light: vec3f, grad: vec3f) -> LitPixelGrad {
    let facing = facing_of_pixel(point);
    let irradiance = radiance_in_level(facing.normal, IRRADIANCE_LEVEL);
    let split_sum = split_sum(facing.n_dot_v, surface.roughness);
    let of_color = physical_color_of_pixel_vjp(
        surface.base,
        surface.tint,
        light,
        irradiance,
        split_sum,
        surface.coverage,
        grad,
    );
    let of_normal = irradiance_vjp(facing.normal, of_color.irradiance);
    let of_table = split_sum_vjp(facing.n_dot_v, surface.roughness, of_color.split_sum);
    let normal = facing_of_pixel_vjp(point, of_normal, of_table.x);
    let light_grad = of_color.specular_light;
    return LitPixelGrad(of_color.base, of_color.tint, light_grad, of_color.coverage, normal, of_table.y);
}
