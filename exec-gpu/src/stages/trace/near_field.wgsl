// Declarations: near field, and the triangle that a ray hits first.

// Triangle that a ray hits.
struct Hit {
    distance: f32,
    triangle: u32,
    weights: vec2f,
}

@group(0) @binding(1) var<uniform> near_field: NearField;
@group(0) @binding(3) var<storage, read> numbers: array<vec4f>;

fn vertex_start(vertex: u32) -> u32 {
    return near_field.first_vertex + VERTEX_VECTORS * vertex;
}

fn corners_of(triangle: u32) -> vec3u {
    return vec3u(numbers[near_field.first_triangle + TRIANGLE_VECTORS * triangle].xyz);
}

fn position(vertex: u32) -> vec3f {
    return numbers[vertex_start(vertex)].xyz;
}

// Tests in the order of `NearField::first_hit`; for any hit, as `NearField::is_blocked`, which ends
// with the first hit and also hits backs. Without a hit the distance is `reach`.
fn hit_within(origin: vec3f, direction: vec3f, reach: f32, any_is_enough: bool) -> Hit {
    let inverse = inverse_direction(direction);
    let back_depth = select(CULL_BACKFACES, BACK_DEPTH * near_field.offset, any_is_enough);
    var hit = Hit(reach, 0u, vec2f(0.0));
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
            let crossing = crossing_of(
                position(vertices.x), position(vertices.y), position(vertices.z), origin, direction, back_depth,
            );
            if crossing.distance < hit.distance {
                hit = Hit(crossing.distance, triangle, crossing.weights);
                if any_is_enough {
                    return hit;
                }
            }
        }
    }
    return hit;
}
