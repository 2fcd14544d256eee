// Declarations: inputs of a replay, and slots of the splats of tiles, for the sums over the pixels
// of the tile.

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<uniform> batch: Batch;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> colors: array<vec4f>;
@group(0) @binding(4) var<storage, read> gaussians_of: array<u32>;
@group(0) @binding(5) var<storage, read> emissions_of: array<u32>;
@group(0) @binding(6) var<storage, read> frame_grad: array<f32>;
@group(0) @binding(7) var<storage, read_write> slots: array<f32>;

fn has_slot(emission: u32) -> bool {
    return batch.first <= emission && emission < batch.end;
}

// Slots of splats after the termination of all pixels, which all invocations clear.
fn clear_slots(first: u32, end: u32, local: u32, invocations: u32) {
    for (var row = local; row < (end - first) * SLOT; row += invocations) {
        let emission = emissions_of[first + row / SLOT];
        if has_slot(emission) {
            slots[(emission - batch.first) * SLOT + row % SLOT] = 0.0;
        }
    }
}
