// Declarations: gradient of the light that a Gaussian looked up.

@group(0) @binding(6) var<storage, read_write> light_sums: array<atomic<u32>>;

fn store_plane_grads() {
    let surface = surface_of();
    let light = gaussian_light(surface);
    let grad = lookup_vjp(light.specular, light.ambient, light.split_sum);
    let of_specular = radiance_vjp(surface.reflection_dir, surface.roughness, grad.specular);
    var of_ambient = vec3f(0.0);
    var of_split_sum = vec2f(0.0);
    if IS_OFFICIAL {
        of_ambient = irradiance_vjp(surface.normal, grad.ambient);
        of_split_sum = split_sum_vjp(surface.n_dot_v, surface.roughness, grad.split_sum);
    }
    planes_vjp(light.specular, light.ambient, light.split_sum, of_specular, of_ambient, of_split_sum);
}
