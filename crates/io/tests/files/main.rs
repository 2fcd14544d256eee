//! Files of every format, read and written: one test program, so that it is compiled and linked
//! once.

mod checkpoint;
mod dataset;
mod gltf;
mod ktx;
mod light;
mod lint;
mod metashape;
mod model_folder;
mod names;
mod origin;
mod photographs;
mod pictures;
mod ply;
mod real_data;
mod splats;
