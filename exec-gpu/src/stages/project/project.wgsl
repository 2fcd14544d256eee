// Projection of Gaussians to splats (stage `project`).
//
// Threads: one invocation a Gaussian of the chunk.
// Inputs: camera, planes of the Gaussians.
// Outputs: splats, depths as bits that sort, numbers of tiles.
// Variants: layout and storage format of the planes.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> values: array<Stored>;
@group(0) @binding(2) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(3) var<storage, read_write> depth_keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> tile_counts: array<u32>;

// Index in its chunk.
var<private> gaussian: u32;

@compute @workgroup_size(GROUP)
fn project(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    gaussian = linear_index(group, groups, local);
    if gaussian >= camera.gaussian_count {
        return;
    }
    let s = splat_of();
    let splat = Splat(s.mean2d, s.log2_opacity, s.opacity, s.root, s.reach, s.half_extent, s.depth, 0.0);
    let index = camera.first_gaussian + gaussian;
    splats[index] = splat;
    let count = select(0u, count_tiles(splat), s.reach >= 0.0);
    tile_counts[index] = count;
    // Bits of positive depths sort like depths; Gaussians that are not drawn come last.
    depth_keys[index] = select(NOT_DRAWN, bitcast<u32>(s.depth), count > 0u);
}
