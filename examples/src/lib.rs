//! Short programs that use specula as a library, in the folder above:
//!
//! * `shade`: the colour of one Gaussian, with core alone, which needs neither std nor an allocator
//! * `prefilter`: light in levels of roughness, with the numbers that a loader of an engine wants
//! * `render`: a PLY of Gaussians to a picture
//! * `train`: a data set to a model, with a word about how it goes
//!
//! `cargo run --release -p specula-examples --example shade` runs one.
