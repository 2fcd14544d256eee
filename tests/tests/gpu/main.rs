//! The GPU executor, stage by stage and as a whole: one test program, so that it is compiled and
//! linked once.

mod back;
mod conformance;
mod densify;
mod gone;
mod lamps;
mod light;
mod loss;
mod near_field;
mod order;
mod pieces;
mod pixel_light;
mod recording;
mod stages;
mod stress;
mod tape;
mod train;
