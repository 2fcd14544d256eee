//! Frame of a light: the axes in which a picture looks it up.
//!
//! Object and light may turn against each other between pictures: on a turntable, or with the lamp
//! on the camera. Gaussians then define the world, and a picture has the rotation R from world axes
//! to those of the light. A lookup along a direction d of the world reads the light along R d, and
//! the gradient g of R d is Rᵀ g in the world. Everything else of a picture stays in the world:
//! splats, normals, harmonics, near field, lamps.

use crate::{
    pixel_light::{LightLookupGrads, LightLookups},
    real::Real,
    vector::{Mat3, Vec3},
};

/// Axes of a light.
#[derive(Clone, Copy, Debug)]
pub struct LightFrame<R> {
    /// Rotation from world axes to those of the light; `None` for a light with the axes of the
    /// world, whose lookups are the same to the last bit as without a frame.
    pub light_from_world: Option<Mat3<R>>,
}

impl<R: Real> LightFrame<R> {
    /// Axes of the world.
    pub const WORLD: Self = Self { light_from_world: None };

    /// Direction of the world in the axes of the light.
    #[inline(always)]
    pub fn to_light(&self, direction: Vec3<R>) -> Vec3<R> {
        match &self.light_from_world {
            Some(light_from_world) => light_from_world.transform(direction),
            None => direction,
        }
    }
    /// Gradient of [`LightFrame::to_light`] with respect to the direction of the world.
    #[inline(always)]
    pub fn to_light_vjp(&self, grad: Vec3<R>) -> Vec3<R> {
        match &self.light_from_world {
            Some(light_from_world) => light_from_world.transform_transposed(grad),
            None => grad,
        }
    }
}

/// Lookups in the axes of a light, along directions of the world.
#[derive(Clone, Copy, Debug)]
pub struct Turned<R, L> {
    /// Lookups along directions of the light.
    pub lookups: L,
    /// Axes of the light.
    pub frame: LightFrame<R>,
}

impl<R: Real, L: LightLookups<R>> LightLookups<R> for Turned<R, L> {
    type Lookup = L::Lookup;

    #[inline(always)]
    fn look_up(&self, direction: Vec3<R>, roughness: R) -> L::Lookup {
        self.lookups.look_up(self.frame.to_light(direction), roughness)
    }
    #[inline(always)]
    fn look_up_irradiance(&self, normal: Vec3<R>) -> L::Lookup {
        self.lookups.look_up_irradiance(self.frame.to_light(normal))
    }
    #[inline(always)]
    fn radiance(&self, lookup: &L::Lookup) -> Vec3<R> {
        self.lookups.radiance(lookup)
    }
    #[inline(always)]
    fn split_sum(&self, n_dot_v: R, roughness: R) -> [R; 2] {
        self.lookups.split_sum(n_dot_v, roughness)
    }
}

impl<R: Real, L: LightLookupGrads<R>> LightLookupGrads<R> for Turned<R, L> {
    #[inline(always)]
    fn look_up_vjp(&mut self, lookup: &L::Lookup, direction: Vec3<R>, roughness: R, grad: Vec3<R>) -> (Vec3<R>, R) {
        let (direction, roughness) = self.lookups.look_up_vjp(lookup, self.frame.to_light(direction), roughness, grad);
        (self.frame.to_light_vjp(direction), roughness)
    }
    #[inline(always)]
    fn look_up_irradiance_vjp(&mut self, lookup: &L::Lookup, normal: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
        let normal = self.lookups.look_up_irradiance_vjp(lookup, self.frame.to_light(normal), grad);
        self.frame.to_light_vjp(normal)
    }
    #[inline(always)]
    fn split_sum_vjp(&self, n_dot_v: R, roughness: R, grad: [R; 2]) -> [R; 2] {
        self.lookups.split_sum_vjp(n_dot_v, roughness, grad)
    }
}
