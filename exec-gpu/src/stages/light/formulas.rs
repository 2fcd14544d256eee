//! Lookup of a filtered light, and its gradient.

use crate::codegen::formula::{Field, fields, formula};
use specula_core::{
    cubemap::{FacePoint, bilinear, bilinear_vjp, bilinear_weights, footprint, project, project_vjp},
    prefilter::{Level, level_of_roughness, level_of_roughness_vjp},
    vector::vec3,
};

/// Texel footprint of a direction in a cube map of some resolution ([`mod@specula_core::cubemap`]).
#[derive(Clone, Copy, Debug)]
pub struct TexelsAt;

formula!(TexelsAt, |_, inputs| texels_at(direction: 3, resolution: 1) -> (texel: 1, right: 1, lower: 1) {
    let (direction, resolution) = (inputs.vec3(), inputs.number());
    let point: FacePoint<R> = project(direction);
    let footprint = footprint(&point, resolution);
    [footprint.texel, footprint.right, footprint.lower]
});

/// Fractional level of a roughness ([`specula_core::prefilter::level_of_roughness`]).
#[derive(Clone, Debug, PartialEq)]
pub struct LevelOf {
    /// Levels of the light.
    pub levels: Vec<Level>,
}

formula!(LevelOf, |this, inputs| level_of(roughness: 1) -> (position: 1) {
    [level_of_roughness(inputs.number(), &this.levels)]
});

/// Bilinear weights of a footprint's four texels ([`specula_core::cubemap::bilinear_weights`]).
#[derive(Clone, Copy, Debug)]
pub struct TexelShares;

formula!(TexelShares, |_, inputs| texel_shares(right: 1, lower: 1) -> (shares: 4) {
    bilinear_weights(inputs.number(), inputs.number())
});

/// Four texels of a footprint, and a position between them.
fn texels_and_position() -> Vec<Field> {
    fields!(upper_left: 3, upper_right: 3, lower_left: 3, lower_right: 3, right: 1, lower: 1)
}

/// Bilinear mean of a footprint's four texels ([`specula_core::cubemap::bilinear`]).
#[derive(Clone, Copy, Debug)]
pub struct TexelsMean;

formula!(TexelsMean, |_, inputs| texels_mean(..texels_and_position()) -> (radiance: 3) {
    let texels = [inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.vec3()];
    bilinear(texels, inputs.number(), inputs.number())
});

/// Gradient of [`TexelsMean`] with respect to the point on the face
/// ([`specula_core::cubemap::bilinear_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct TexelsVjp;

formula!(TexelsVjp, |_, inputs| texels_vjp(..texels_and_position(), resolution: 1, grad: 3) -> (point: 2) {
    let texels = [inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.vec3()];
    let (right, lower, half) = (inputs.number(), inputs.number(), inputs.number() * 0.5);
    let (grad_right, grad_lower) = bilinear_vjp(texels, right, lower, inputs.vec3());
    [grad_right * half, grad_lower * half]
});

/// Gradient of a direction from that of its point on the face
/// ([`specula_core::cubemap::project_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct DirectionVjp;

formula!(DirectionVjp, |_, inputs| direction_vjp(direction: 3, grad: 2) -> (direction: 3) {
    let (point, [grad_u, grad_v]) = (project(inputs.vec3()), inputs.array());
    project_vjp(&point, grad_u, grad_v)
});

/// Gradient of a roughness from the radiances of the two levels around it
/// ([`specula_core::prefilter::level_of_roughness_vjp`]).
#[derive(Clone, Debug, PartialEq)]
pub struct RoughnessVjp {
    /// Levels of the light.
    pub levels: Vec<Level>,
}

formula!(RoughnessVjp, |this, inputs| roughness_vjp(
    roughness: 1, sharp: 3, blurred: 3, grad: 3
) -> (roughness: 1) {
    let (roughness, sharp, blurred, grad) = (inputs.number(), inputs.vec3(), inputs.vec3(), inputs.vec3());
    [level_of_roughness_vjp(roughness, &this.levels, grad.dot(blurred - sharp))]
});

/// Gradient of the position between four neighbouring entries of the split-sum table
/// ([`specula_core::cubemap::bilinear_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct SplitSumVjp;

formula!(SplitSumVjp, |_, inputs| split_sum_slopes(
    upper_left: 2, upper_right: 2, lower_left: 2, lower_right: 2, share: 2, grad: 2
) -> (grad_position: 2) {
    let mut pair = || {
        let [x, y] = inputs.array();
        vec3(x, y, x.zero())
    };
    let texels = [pair(), pair(), pair(), pair()];
    let (share, grad) = (pair(), pair());
    let (right, lower) = bilinear_vjp(texels, share.x, share.y, grad);
    [right, lower]
});
