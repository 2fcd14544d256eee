// Declarations: indices of the step counters; see `step_counters/mod.rs`.

// Nearest and furthest depth of the splats that are drawn, as bits that sort.
const NEAREST: u32 = 0u;
const FURTHEST: u32 = 1u;
// Number of tile-splat pairs, and whether it exceeds 32 bits.
const PAIRS: u32 = 2u;
const OVERFLOWS: u32 = 3u;
// Number of stored pairs: all, or none if the capacity is exceeded.
const STORED_PAIRS: u32 = 4u;
// Whether the capacity was exceeded, so that the step changes nothing.
const EXCEEDS_CAPACITY: u32 = 5u;
// Gradients that were not finite.
const NONFINITE: u32 = 6u;
