// Declarations: gradient of the light that a Gaussian looked up.

@group(0) @binding(6) var<storage, read_write> light_sums: array<atomic<u32>>;

// Gradient of `split_sum` with respect to n·v and roughness.
fn split_sum_vjp(n_dot_v: f32, roughness: f32, grad: vec2f) -> vec2f {
    let cell = split_sum_cell(n_dot_v, roughness);
    let lower_first = cell.first + SPLIT_SUM_SIZE;
    let slopes = split_sum_slopes(
        split_sums[cell.first],
        split_sums[cell.first + 1u],
        split_sums[lower_first],
        split_sums[lower_first + 1u],
        cell.share,
        grad,
    );
    return slopes * cell.is_free * f32(SPLIT_SUM_SIZE);
}

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
