//! Planes of Gaussians in kernels and formulas.

use crate::codegen::{
    formula::{Field, call},
    source::Source,
};
use specula_core::{
    attributes::AttributePlanes,
    pack::{FULL_PLANES, Storage},
    real::Real,
    scene::Layout,
};

/// Planes of one Gaussian, through the shader's function `plane`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planes<'a, R>(pub(crate) &'a [R]);

impl<R: Real> AttributePlanes<R> for Planes<'_, R> {
    fn number(&self, plane: usize) -> R {
        self.0[plane]
    }
}

/// All planes of a Gaussian as a parameter.
pub(crate) fn planes_field(layout: Layout) -> [Field; 1] {
    [call("plane", layout.plane_count())]
}

/// Appends the function `plane` over planes of `f32`.
pub(crate) fn planes(source: Source, layout: Layout) -> Source {
    source.count("PLANES", layout.plane_count()).with(include_str!("planes.wgsl"))
}

/// Appends the function `plane` over planes in a storage format.
pub(crate) fn stored_planes(source: Source, layout: Layout, storage: Storage) -> Source {
    match storage {
        Storage::F32 => planes(source, layout),
        Storage::F16 => source
            .count("WORDS", storage.words(layout))
            .count("FULL_PLANES", FULL_PLANES)
            .with(include_str!("half_planes.wgsl")),
    }
}
