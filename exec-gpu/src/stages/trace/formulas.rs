//! Reflected rays, the triangles that they hit, and their light.

use crate::{
    codegen::formula::{call, formula, variable},
    stages::{
        camera::{camera_fields, take_camera},
        shade_pixels::pixel::{BlendedNumbers, blended_field},
    },
};
use specula_core::{
    near_field::{
        Crossing, Reflection, VERTEX_LEN, box_span, crossing, inverse_direction, is_traced, ray_origin, surface_within,
        vertex_surface,
    },
    pixel_light::BlendedPixel,
    rules::{Channels, channel},
    shade_pixels::pixel_surface,
};

/// Numbers of a reflection.
pub(crate) const REFLECTION_LEN: usize = Reflection::<f32>::LEN;

/// Reflected ray of a pixel ([`specula_core::near_field::ray_origin`]), from its blended channels,
/// and the roughness of its surface. `is_traced` is 1 where the ray is traced
/// ([`specula_core::near_field::is_traced`]) and is finite, else 0.
#[derive(Clone, Copy, Debug)]
pub struct RayOfPixel(pub Channels);

formula!(RayOfPixel, |this, inputs| ray_of_pixel(
    ..blended_field(this.0), point: 2, ..camera_fields(), ..[variable("near_field.offset", 1)]
) -> (
    origin: 3, direction: 3, roughness: 1, is_traced: 1
) {
    let blended = BlendedNumbers::take(this.0, inputs);
    let [x, y] = inputs.array();
    let (camera, offset) = (take_camera(inputs), inputs.number());
    let (pixel, depth, view_dir) = (blended.pixel(), blended.channel(channel::DEPTH), camera.view_dir(x, y));
    let surface = pixel_surface(&pixel, view_dir);
    let origin = ray_origin(&camera, &pixel, depth, view_dir, offset);
    let direction = surface.reflection_dir;
    let is_traced = is_traced(pixel.coverage, surface.roughness) & origin.is_finite() & direction.is_finite();
    (origin, direction, [surface.roughness, offset.constant(1.0).keep(is_traced)])
});

/// Reciprocals of a direction's components ([`specula_core::near_field::inverse_direction`]).
#[derive(Clone, Copy, Debug)]
pub struct InverseDirection;

formula!(InverseDirection, |_, inputs| inverse_direction(direction: 3) -> (inverse: 3) {
    inverse_direction(inputs.vec3())
});

/// Distances at which a ray enters and leaves a box ([`specula_core::near_field::box_span`]).
#[derive(Clone, Copy, Debug)]
pub struct BoxSpan;

formula!(BoxSpan, |_, inputs| box_span(min: 3, max: 3, origin: 3, inverse: 3) -> (enter: 1, leave: 1) {
    box_span(inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.vec3())
});

/// Crossing of a ray and a triangle ([`specula_core::near_field::crossing`]).
#[derive(Clone, Copy, Debug)]
pub struct CrossingOf;

formula!(CrossingOf, |_, inputs| crossing_of(a: 3, b: 3, c: 3, origin: 3, direction: 3, back_depth: 1) -> (
    distance: 1, weights: 2
) {
    let corners = [inputs.vec3(), inputs.vec3(), inputs.vec3()];
    let Crossing { distance, weights } =
        crossing(corners, inputs.vec3(), inputs.vec3(), inputs.number());
    ([distance], weights)
});

/// Reflection of a ray that hits nothing ([`Reflection::of_far`]).
#[derive(Clone, Copy, Debug)]
pub struct FarReflection;

formula!(FarReflection, |_, inputs| far_reflection(direction: 3, roughness: 1) -> (
    ..[call("store_number", REFLECTION_LEN)]
) {
    Reflection::of_far(inputs.vec3(), inputs.number()).to_array()
});

/// Reflection of a ray that hits a triangle ([`Reflection::of_near`]), from the numbers of its
/// three vertices.
#[derive(Clone, Copy, Debug)]
pub struct NearReflection;

formula!(NearReflection, |_, inputs| near_reflection(
    direction: 3, roughness: 1, weights: 2, ..[call("corner_number", 3 * VERTEX_LEN)]
) -> (
    ..[call("store_number", REFLECTION_LEN)]
) {
    let (direction, roughness, weights) = (inputs.vec3(), inputs.number(), inputs.array());
    let corners = [inputs.array(), inputs.array(), inputs.array()].map(vertex_surface);
    Reflection::of_near(direction, roughness, &surface_within(&corners, weights)).to_array()
});
