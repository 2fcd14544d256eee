// Gradient of the lookup of a light for many rows, to test it.
//
// Threads: one invocation a row.
// Inputs: direction, roughness and gradient of each row; texels of the light.
// Outputs: gradient of direction and roughness; sums of the gradients of the light's texels.

struct Lookup {
    direction: vec3f,
    roughness: f32,
    grad: vec3f,
    padding: f32,
}

@group(0) @binding(0) var<uniform> rows: LookupRows;
@group(0) @binding(1) var<storage, read> inputs: array<Lookup>;
@group(0) @binding(2) var<storage, read> texels: array<Texel>;
@group(0) @binding(3) var<storage, read_write> outputs: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> light_sums: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn probe_light(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let row = linear_index(group, groups, local);
    if row >= rows.count {
        return;
    }
    let lookup = inputs[row];
    if rows.is_irradiance == 0u {
        outputs[row] = radiance_vjp(lookup.direction, lookup.roughness, lookup.grad);
    } else {
        outputs[row] = vec4f(irradiance_vjp(lookup.direction, lookup.grad), 0.0);
    }
}
