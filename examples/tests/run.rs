//! Tests of the examples, in one program, so that the crates they use are compiled and linked once.

#![expect(dead_code, reason = "the examples' entry points")]

#[path = "../engine.rs"]
mod engine;
#[path = "../executor.rs"]
mod executor;
#[path = "../fit.rs"]
mod fit;
#[path = "run/mutants.rs"]
mod mutants;
#[path = "../prefilter.rs"]
mod prefilter;
#[path = "../race.rs"]
mod race;
#[path = "../render.rs"]
mod render;
#[path = "../shade.rs"]
mod shade;
#[path = "../texture.rs"]
mod texture;
#[path = "../train.rs"]
mod train;
