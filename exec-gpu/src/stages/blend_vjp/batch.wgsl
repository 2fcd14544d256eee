// Declarations: slots of the splats of tiles, for the sums over the pixels of the tile.

// Emissions that have a slot.
struct Batch {
    first: u32,
    end: u32,
}

fn has_slot(emission: u32) -> bool {
    return batch.first <= emission && emission < batch.end;
}

// Slots of splats behind terminated pixels, which an invocation of several clears.
fn clear_slots(first: u32, end: u32, local: u32, invocations: u32) {
    for (var row = local; row < (end - first) * SLOT; row += invocations) {
        let emission = emissions_of[first + row / SLOT];
        if has_slot(emission) {
            slots[(emission - batch.first) * SLOT + row % SLOT] = 0.0;
        }
    }
}
