// Light of lamps (stage `illuminate`).
//
// Threads: one invocation a pixel.
// Inputs: camera, blended layers, near field as occluder, lamps, its interreflected light.
// Outputs: direct light, plane by plane.
// Variants: none.
// Early exit: pixels without a splat, and rays below the horizon.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(2) var<storage, read> frame: array<f32>;
// Two vectors for each lamp; then the points of the spiral.
@group(0) @binding(4) var<storage, read> lamps: array<vec4f>;
@group(0) @binding(5) var<uniform> lamp_set: Lamps;
@group(0) @binding(6) var<storage, read_write> direct: array<f32>;

// Irradiance / pi of the near field's vertices by reflected light.
@group(0) @binding(7) var<storage, read> reflected: array<f32>;

var<private> pixel: u32;
var<private> lamp: u32;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + pixel];
}

fn lamp_number(k: u32) -> f32 {
    return lamps[LAMP_VECTORS * lamp + k / 4u][k % 4u];
}

fn store(first: u32, light: vec3f) {
    let size = camera.size.x * camera.size.y;
    direct[first * size + pixel] = light.x;
    direct[(first + 1u) * size + pixel] = light.y;
    direct[(first + 2u) * size + pixel] = light.z;
}

// Visible share of the lamp.
fn share_of(place: vec2u, surface: LitPixelOf, toward: TowardLamp) -> f32 {
    if near_field.node_count == 0u {
        return 1.0;
    }
    let is_wide = lamps[LAMP_VECTORS * lamp + LAMP_VECTORS - 1u].w > 0.0;
    let axes = axes_of_disc(toward.direction);
    let shift = shift_of_pixel(f32(place.x), f32(place.y), f32(lamp));
    var all = 0.0;
    var reaching = 0.0;
    for (var k = 0u; k < select(1u, lamp_set.rays, is_wide); k++) {
        let point = lamps[LAMP_VECTORS * lamp_set.count + k];
        let ray = shadow_ray_of(
            surface.normal, toward.direction, toward.sine, axes.right, axes.up, shift.outwards, shift.turn, point,
        );
        if ray.weight > 0.0 {
            let hit = hit_within(surface.start, ray.ray_dir, toward.reach, true);
            all += ray.weight;
            reaching += select(0.0, ray.weight, hit.distance >= toward.reach);
        }
    }
    return share_seen(all, reaching);
}

fn reflected_at(vertex: u32) -> vec3f {
    return vec3f(reflected[3u * vertex], reflected[3u * vertex + 1u], reflected[3u * vertex + 2u]);
}

// Irradiance / pi by interreflected light.
fn reflected_irradiance(surface: LitPixelOf) -> vec3f {
    let reach = BELOW * near_field.offset;
    let hit = hit_within(surface.start, -surface.normal, reach, false);
    if hit.distance >= reach {
        return vec3f(0.0);
    }
    let corners = corners_of(hit.triangle);
    let weights = hit.weights;
    return reflected_at(corners.x) * (1.0 - (weights.x + weights.y))
        + reflected_at(corners.y) * weights.x
        + reflected_at(corners.z) * weights.y;
}

@compute @workgroup_size(GROUP)
fn illuminate(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    pixel = linear_index(group, groups, local);
    if pixel >= camera.size.x * camera.size.y {
        return;
    }
    let place = vec2u(pixel % camera.size.x, pixel / camera.size.x);
    let surface = lit_pixel_of(vec2f(place) + 0.5);
    var irradiance = vec3f(0.0);
    var specular = vec3f(0.0);
    if surface.is_lit != 0.0 {
        for (var index = 0u; index < lamp_set.count; index++) {
            lamp = index;
            let toward = toward_lamp(surface.point, surface.normal);
            let share = share_of(place, surface, toward);
            let light = direct_light_of(
                surface.normal,
                surface.n_dot_v,
                surface.view_dir,
                surface.f0,
                surface.alpha_ggx,
                toward.direction,
                toward.irradiance,
                toward.sine,
                share,
            );
            irradiance += light.diffuse_irradiance;
            specular += light.specular;
        }
        if lamp_set.is_reflected != 0u {
            irradiance += reflected_irradiance(surface);
        }
    }
    store(0u, irradiance);
    store(3u, specular);
}
