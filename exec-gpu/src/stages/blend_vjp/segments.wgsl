// Declarations: segments, the splats of a tile up to the next multiple of SEGMENT among the pairs.

struct Segment {
    tile: u32,
    // First and past-the-last splat among the pairs; equal if there is no segment.
    first: u32,
    end: u32,
    // Whether all pixels have terminated in front of it.
    is_over: u32,
}
