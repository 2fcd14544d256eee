//! Planes of Gaussians in kernels and formulas.

use crate::codegen::{
    formula::{Field, call},
    source::Source,
};
use specula_core::{
    pack::{FULL_PLANES, Storage},
    project::Shape,
    real::Real,
    scene::{LOG_SCALE, Layout, MEAN, OPACITY, QUAT},
    vector::Vec3,
};

/// Planes of one Gaussian, as the shader's function `plane` reads them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Planes<'a, R>(pub(crate) &'a [R]);

impl<R: Real> Planes<'_, R> {
    pub(crate) fn at(&self, plane: usize) -> R {
        self.0[plane]
    }
    pub(crate) fn vec3(&self, first: usize) -> Vec3<R> {
        Vec3 { x: self.at(first), y: self.at(first + 1), z: self.at(first + 2) }
    }
    pub(crate) fn quat(&self) -> [R; 4] {
        [self.at(QUAT), self.at(QUAT + 1), self.at(QUAT + 2), self.at(QUAT + 3)]
    }
    pub(crate) fn shape(&self) -> Shape<R> {
        Shape {
            mean: self.vec3(MEAN),
            log_scales: self.vec3(LOG_SCALE),
            quat: self.quat(),
            opacity_logit: self.at(OPACITY),
        }
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
