//! Gaussians and lights in other number types, and single Gaussians.

use crate::number::Number;
use specula_core::{
    attributes::{AttributeGrads, StoredGaussian},
    scene::{Environment, Gaussians},
};

/// Gaussians in another number type.
pub fn lift_gaussians<R: Number>(gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<R>> {
    Gaussians { count: gaussians.count, layout: gaussians.layout, values: lift(&gaussians.values) }
}

/// A light in another number type.
pub fn lift_environment<R: Number>(environment: &Environment<Vec<f32>>) -> Environment<Vec<R>> {
    Environment {
        resolution: environment.resolution,
        activation: environment.activation,
        values: lift(&environment.values),
    }
}

/// Numbers in another number type.
pub fn lift<R: Number>(values: &[f32]) -> Vec<R> {
    values.iter().map(|&x| R::of(f64::from(x))).collect()
}

/// One of the Gaussians.
pub(crate) fn gaussian<R: Number>(gaussians: &Gaussians<Vec<R>>, index: usize) -> StoredGaussian<'_, Vec<R>> {
    StoredGaussian { gaussians, index }
}

/// Adds gradients to those of one Gaussian.
pub(crate) struct AddedGrads<'a, R> {
    pub(crate) gaussians: &'a mut Gaussians<Vec<R>>,
    pub(crate) index: usize,
}

impl<R: Number> AttributeGrads<R> for AddedGrads<'_, R> {
    fn set(&mut self, plane: usize, grad: R) {
        let index = self.gaussians.index_of(self.index, plane);
        self.gaussians.values[index] = self.gaussians.values[index] + grad;
    }
}
