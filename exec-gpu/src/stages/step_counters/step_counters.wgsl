// Numbers of the counters: what a picture needs, and what came of a step; see `counters.rs`.

// Keys of the nearest depth and the furthest of what is drawn.
const NEAREST: u32 = 0u;
const FURTHEST: u32 = 1u;
// How many splats all tiles have, and whether these are more than a word counts.
const PAIRS: u32 = 2u;
const OVERFLOWS: u32 = 3u;
// How many of them there are: all, or none where there is too little room.
const STORED_PAIRS: u32 = 4u;
// Whether there was too little room, so that the step changes nothing.
const EXCEEDS_CAPACITY: u32 = 5u;
// Gradients that were not finite.
const NONFINITE: u32 = 6u;
