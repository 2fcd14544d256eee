//! Step of a pixel towards its median depth.

use crate::codegen::formula::formula;
use specula_core::blend::{PixelState, is_median, step};

/// Transmittance of a pixel behind a splat, and whether the splat has its median depth
/// ([`specula_core::blend::is_median`]).
#[derive(Clone, Copy, Debug)]
pub struct MedianStep;

formula!(MedianStep, |_, inputs| median_step(alpha: 1, in_front: 1) -> (behind: 1, is_median: 1) {
    let [alpha, in_front] = inputs.array();
    let state = PixelState { transmittance: in_front, final_transmittance: in_front };
    let behind = step(alpha, state).behind.transmittance;
    [behind, alpha.constant(1.0).keep(is_median(in_front, behind))]
});
