// Reflected rays against a near field (stage `trace`).
//
// Threads: one invocation a pixel.
// Inputs: camera, blended surface attributes, near field.
// Outputs: reflections, plane by plane.
// Variants: blended channels.
// Early exit: pixels without a splat have no ray and reflect far light.

struct NearField {
    node_count: u32,
    // Indices of the first triangle and the first vertex, in vectors of four numbers.
    first_triangle: u32,
    first_vertex: u32,
    offset: f32,
}

// Triangle that a ray meets first; none where the distance is NOTHING.
struct Hit {
    distance: f32,
    triangle: u32,
    weights: vec2f,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> near_field: NearField;
@group(0) @binding(2) var<storage, read> frame: array<f32>;
@group(0) @binding(3) var<storage, read> numbers: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> reflections: array<f32>;

var<private> pixel: u32;
// Vertices of the triangle that was met.
var<private> corners: vec3u;

fn blended(channel: u32) -> f32 {
    return frame[channel * camera.size.x * camera.size.y + pixel];
}

fn store_number(k: u32, number: f32) {
    reflections[k * camera.size.x * camera.size.y + pixel] = number;
}

fn vertex_start(vertex: u32) -> u32 {
    return near_field.first_vertex + VERTEX_VECTORS * vertex;
}

// Number of the corners, one vertex after the other.
fn corner_number(k: u32) -> f32 {
    let vertex = corners[k / (4u * VERTEX_VECTORS)];
    return numbers[vertex_start(vertex) + k / 4u % VERTEX_VECTORS][k % 4u];
}

fn corners_of(triangle: u32) -> vec3u {
    return vec3u(numbers[near_field.first_triangle + TRIANGLE_VECTORS * triangle].xyz);
}

fn position(vertex: u32) -> vec3f {
    return numbers[vertex_start(vertex)].xyz;
}

// Tests in the order of `NearField::first_hit`.
fn first_hit(origin: vec3f, direction: vec3f) -> Hit {
    let inverse = inverse_direction(direction);
    var hit = Hit(NOTHING, 0u, vec2f(0.0));
    var index = 0u;
    while index < near_field.node_count {
        let least = numbers[NODE_VECTORS * index];
        let greatest = numbers[NODE_VECTORS * index + 1u];
        let span = box_span(least.xyz, greatest.xyz, origin, inverse);
        let first = u32(least.w);
        let count = u32(greatest.w);
        let is_met = span.enter <= span.leave && span.enter < hit.distance;
        index = select(first, index + 1u, is_met || count > 0u);
        if !is_met {
            continue;
        }
        for (var triangle = first; triangle < first + count; triangle++) {
            let vertices = corners_of(triangle);
            let crossing =
                crossing_of(position(vertices.x), position(vertices.y), position(vertices.z), origin, direction);
            if crossing.distance < hit.distance {
                hit = Hit(crossing.distance, triangle, crossing.weights);
            }
        }
    }
    return hit;
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
    let hit = first_hit(ray.origin, ray.direction);
    if hit.distance == NOTHING {
        far_reflection(ray.direction, ray.roughness);
        return;
    }
    corners = corners_of(hit.triangle);
    near_reflection(ray.direction, ray.roughness, hit.weights);
}
