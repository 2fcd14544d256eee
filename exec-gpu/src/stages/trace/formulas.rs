//! Reflected rays, the triangles that they hit, and their light.

use crate::{
    codegen::formula::{Field, Inputs, call, formula, variable},
    stages::{
        camera::{camera_fields, take_camera},
        shade_pixels::formulas::SurfaceOfPixel,
    },
};
use specula_core::{
    near_field::{
        Crossing, Reflection, VERTEX_LEN, box_span, crossing, inverse_direction, is_traced, ray_origin, surface_within,
        vertex_surface,
    },
    real::Real,
    rules::channel,
    shade_pixels::pixel_surface,
};

/// Numbers of a reflection.
pub(crate) const REFLECTION_LEN: usize = Reflection::<f32>::LEN;

/// Reflected ray of a pixel ([`specula_core::near_field::ray_origin`]), from its blended channels,
/// and the roughness of its surface. `is_traced` is 1 if the ray is traced
/// ([`specula_core::near_field::is_traced`]) and finite, else 0.
#[derive(Clone, Copy, Debug)]
pub struct RayOfPixel(pub SurfaceOfPixel);

formula!(RayOfPixel, |this, inputs| ray_of_pixel(
    ..[call("blended", this.0.blended.count() + 1)], point: 2, ..camera_fields(), ..[variable("near_field.offset", 1)]
) -> (
    origin: 3, direction: 3, roughness: 1, is_traced: 1
) {
    let numbers = inputs.slice(this.0.blended.count() + 1);
    let [x, y] = inputs.array();
    let (camera, offset) = (take_camera(inputs), inputs.number());
    let (pixel, view_dir) = (this.0.pixel(numbers), camera.view_dir(x, y));
    let surface = pixel_surface(&pixel, view_dir);
    let depth = this.0.blended.index_of(channel::DEPTH).map_or(offset.zero(), |index| numbers[index]);
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

/// Lookup of the far light of the surface that a ray hits.
#[derive(Clone, Copy, Debug)]
pub struct LookupOfReflection;

formula!(LookupOfReflection, |_, inputs| lookup_of_reflection(..reflection_fields()) -> (
    direction: 3, roughness: 1
) {
    let reflection = take_reflection(inputs);
    (reflection.direction, [reflection.roughness])
});

/// Light of a reflection, from the far light of the pixel and that of the surface that its ray hits
/// ([`Reflection::light`]).
#[derive(Clone, Copy, Debug)]
pub struct LightOfReflection;

formula!(LightOfReflection, |_, inputs| light_of_reflection(..reflection_fields(), own: 3, of_near: 3) -> (
    light: 3
) {
    let reflection = take_reflection(inputs);
    reflection.light(inputs.vec3(), inputs.vec3())
});

/// Light of a reflection from the surface that its ray hits ([`Reflection::indirect`]).
#[derive(Clone, Copy, Debug)]
pub struct IndirectOfReflection;

formula!(IndirectOfReflection, |_, inputs| indirect_of_reflection(..reflection_fields(), of_near: 3) -> (light: 3) {
    let reflection = take_reflection(inputs);
    reflection.indirect(inputs.vec3())
});

/// Share of a pixel's own far light in its reflection.
#[derive(Clone, Copy, Debug)]
pub struct VisibilityOfReflection;

formula!(VisibilityOfReflection, |_, inputs| visibility_of_reflection(..reflection_fields()) -> (far: 1) {
    [take_reflection(inputs).far]
});

/// Gradient of [`LightOfReflection`] with respect to both lights ([`Reflection::light_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct LightOfReflectionVjp;

formula!(LightOfReflectionVjp, |_, inputs| light_of_reflection_vjp(..reflection_fields(), grad: 3) -> (
    own: 3, of_near: 3
) {
    let reflection = take_reflection(inputs);
    let [own, of_near] = reflection.light_vjp(inputs.vec3());
    (own, of_near)
});

/// Stored reflection of a pixel, in the order of [`take_reflection`].
fn reflection_fields() -> [Field; 1] {
    [call("reflection_number", REFLECTION_LEN)]
}

/// Reads a reflection from a formula's inputs.
fn take_reflection<R: Real>(inputs: &mut Inputs<'_, R>) -> Reflection<R> {
    Reflection::from_array(inputs.array())
}
