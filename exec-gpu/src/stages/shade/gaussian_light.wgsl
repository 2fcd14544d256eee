// Declarations: lookup of the light by a Gaussian.

@group(0) @binding(4) var<storage, read> texels: array<Texel>;

// Light that a Gaussian looked up.
struct GaussianLight {
    specular: vec3f,
    ambient: vec3f,
    split_sum: vec2f,
}

fn gaussian_light(surface: SurfaceOf) -> GaussianLight {
    let specular = radiance(surface.reflection_dir, surface.roughness);
    if IS_OFFICIAL {
        let ambient = irradiance(surface.normal);
        return GaussianLight(specular, ambient, split_sum(surface.n_dot_v, surface.roughness));
    }
    return GaussianLight(specular, vec3f(0.0), vec2f(0.0));
}
