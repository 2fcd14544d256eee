// Reflected rays against a near field (stage `trace`).
//
// Threads: one invocation a pixel.
// Inputs: camera, blended surface attributes, near field.
// Outputs: reflections, plane by plane.
// Variants: blended channels.
// Early exit: pixels without a splat, and rough ones, have no ray and reflect the distant light.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(2) var<storage, read> frame: array<f32>;
@group(0) @binding(4) var<storage, read_write> reflections: array<f32>;

var<private> pixel: u32;
// Vertices of the triangle that was hit.
var<private> corners: vec3u;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + pixel];
}

fn store_number(k: u32, number: f32) {
    reflections[k * camera.size.x * camera.size.y + pixel] = number;
}

// Number of the corners, one vertex after the other.
fn corner_number(k: u32) -> f32 {
    let vertex = corners[k / (4u * VERTEX_VECTORS)];
    return numbers[vertex_start(vertex) + k / 4u % VERTEX_VECTORS][k % 4u];
}

@compute @workgroup_size(GROUP)
fn trace(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    pixel = linear_index(group, groups, local);
    if pixel >= camera.size.x * camera.size.y {
        return;
    }
    let ray = ray_of_pixel(vec2f(vec2u(pixel % camera.size.x, pixel / camera.size.x)) + 0.5);
    if ray.is_traced == 0.0 {
        far_reflection(ray.direction, ray.roughness);
        return;
    }
    let hit = hit_within(ray.origin, ray.direction, T_MISS, false);
    if hit.distance == T_MISS {
        far_reflection(ray.direction, ray.roughness);
        return;
    }
    corners = corners_of(hit.triangle);
    near_reflection(ray.direction, ray.roughness, hit.weights);
}
