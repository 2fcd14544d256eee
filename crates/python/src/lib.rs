//! Extension module of the Python package `specula_gs`: the project's crates behind arrays.
//!
//! The package checks shapes and documents every function; this module converts and computes.

mod arrays;
mod camera;
mod errors;
mod light;
mod program;
mod quality;
mod raster;
mod scene;
mod shading;
mod threads;
mod training;

use pyo3::prelude::*;

/// Allocator that keeps pages between calls, since each call allocates its pictures and gradients.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Extension module.
#[pymodule]
mod _core {
    use super::*;

    #[pymodule_export]
    use camera::{Camera, View, load_views};
    #[pymodule_export]
    use light::{Light, PrefilteredLight, cube_to_latlong, latlong_to_cube, prefilter};
    #[pymodule_export]
    use program::run_program;
    #[pymodule_export]
    use quality::{flip, normal_mae, psnr, ssim};
    #[pymodule_export]
    use raster::{Tape, rasterize};
    #[pymodule_export]
    use scene::{Renderer, Scene};
    #[pymodule_export]
    use shading::{ggx, shade, shade_physical, split_sum};
    #[pymodule_export]
    use threads::thread_count;
    #[pymodule_export]
    use training::train;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
