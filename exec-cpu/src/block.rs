//! Attributes of a block of Gaussians as lanes: [`specula_core::attributes`] over this machine's
//! memory.

use crate::lanes::{LaneMask, Lanes};
use fearless_simd::Simd;
use specula_core::{
    attributes::{AttributeGrads, AttributePlanes},
    real::Real,
    scene::BLOCK,
};

/// Planes of a block.
#[derive(Clone, Copy)]
pub(crate) struct BlockPlanes<'a, S: Simd> {
    pub(crate) simd: S,
    /// [`BLOCK`] numbers of each plane.
    pub(crate) values: &'a [f32],
}

impl<S: Simd> AttributePlanes<Lanes<S>> for BlockPlanes<'_, S> {
    #[inline(always)]
    fn number(&self, plane: usize) -> Lanes<S> {
        Lanes::load(self.simd, &self.values[plane * BLOCK..])
    }
}

/// Gradients of a block's planes, zero outside of a mask.
pub(crate) struct BlockGrads<'a, S: Simd> {
    /// [`BLOCK`] numbers of each plane.
    pub(crate) values: &'a mut [f32],
    /// Mask of Gaussians with a gradient.
    pub(crate) is_touched: LaneMask<S>,
}

impl<S: Simd> AttributeGrads<Lanes<S>> for BlockGrads<'_, S> {
    #[inline(always)]
    fn set(&mut self, plane: usize, grad: Lanes<S>) {
        grad.keep(self.is_touched).store(&mut self.values[plane * BLOCK..]);
    }
}

/// Gradients that are added to those of a block's planes.
pub(crate) struct AddedBlockGrads<'a, S: Simd> {
    pub(crate) simd: S,
    /// [`BLOCK`] numbers of each plane.
    pub(crate) values: &'a mut [f32],
}

impl<S: Simd> AttributeGrads<Lanes<S>> for AddedBlockGrads<'_, S> {
    #[inline(always)]
    fn set(&mut self, plane: usize, grad: Lanes<S>) {
        let values = &mut self.values[plane * BLOCK..];
        (Lanes::load(self.simd, values) + grad).store(values);
    }
}
