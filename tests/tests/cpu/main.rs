//! Formulas of core, the CPU executor and the documentation: one test program, so that generic
//! code is compiled and linked once. Tests that replace the global allocator are programs of
//! their own.

mod antialias;
mod attributes;
mod brute;
mod conformance;
mod cutoffs;
mod densify;
mod derivatives;
mod documentation;
mod executor;
mod exports;
mod invariants;
mod lamps;
mod light_network;
mod near_field;
mod order;
mod perspective;
mod physical;
mod pipeline_gradients;
mod pixel_light;
mod plan;
mod poison;
mod prefilter;
mod smoothness;
mod stress;
mod tape;
