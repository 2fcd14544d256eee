// Declarations: gradient of the light that a Gaussian looked up.

@group(0) @binding(6) var<storage, read_write> light_sums: array<atomic<u32>>;

fn store_plane_grads() {
    let surface = surface_of();
    let light = gaussian_light(surface);
    let grad = lookup_vjp(light.specular, light.ambient, light.split_sum);
    let grad_specular = radiance_vjp(surface.reflection_dir, surface.roughness, grad.specular);
    var grad_ambient = vec3f(0.0);
    var grad_split_sum = vec2f(0.0);
    if IS_OFFICIAL {
        grad_ambient = irradiance_vjp(surface.normal, grad.ambient);
        grad_split_sum = split_sum_vjp(surface.n_dot_v, surface.roughness, grad.split_sum);
    }
    planes_vjp(light.specular, light.ambient, light.split_sum, grad_specular, grad_ambient, grad_split_sum);
}
