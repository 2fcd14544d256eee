//! Lamps in a pixel: their direction and light, shadow rays, and reflected light.

use crate::{
    codegen::formula::{call, formula, variable},
    stages::{
        camera::{camera_fields, take_camera},
        shade_pixels::pixel::{BlendedNumbers, blended_field},
    },
};
use specula_core::{
    lamps::{
        DirectLight, LampOf, LitPixel, ShadowRay, Shift, Toward, direct_light, disc_axes, lit_pixel, seen_share,
        shadow_ray, shift, toward,
    },
    physical::PixelFacing,
    pixel_light::BlendedPixel,
    rules::{Channels, channel},
    vector::Vec3,
};

/// Numbers of a lamp.
pub(crate) const LAMP_LEN: usize = LampOf::<f32>::LEN;
/// Numbers of a direct light.
pub(crate) const DIRECT_LEN: usize = DirectLight::<f32>::LEN;

/// Surface of a pixel for the light of lamps ([`specula_core::lamps::lit_pixel`]), from its blended
/// channels. `is_lit` is 1 where the pixel shows a surface at a finite place, else 0.
#[derive(Clone, Copy, Debug)]
pub struct LitPixelOf(pub Channels);

formula!(LitPixelOf, |this, inputs| lit_pixel_of(
    ..blended_field(this.0), coordinates: 2, ..camera_fields(),
    ..[variable("near_field.offset", 1)]
) -> (
    point: 3, start: 3, view_dir: 3, normal: 3, n_dot_v: 1, f0: 3, alpha_ggx: 1, is_lit: 1
) {
    let blended = BlendedNumbers::take(this.0, inputs);
    let [x, y] = inputs.array();
    let (camera, offset) = (take_camera(inputs), inputs.number());
    let (pixel, depth, view_dir) = (blended.pixel(), blended.channel(channel::DEPTH), camera.view_dir(x, y));
    let lit = lit_pixel(&camera, &pixel, depth, view_dir, offset);
    let is_lit = offset.zero().less(pixel.coverage) & lit.start.is_finite();
    let numbers = [lit.alpha_ggx, offset.constant(1.0).keep(is_lit)];
    (lit.point, lit.start, lit.view_dir, lit.facing.normal, [lit.facing.n_dot_v], lit.f0, numbers)
});

/// Lamp as seen from a point ([`specula_core::lamps::toward`]).
#[derive(Clone, Copy, Debug)]
pub struct TowardLamp;

formula!(TowardLamp, |_, inputs| toward_lamp(..[call("lamp_number", LAMP_LEN)], point: 3, normal: 3) -> (
    direction: 3, irradiance: 3, sine: 1, reach: 1
) {
    let seen = toward(&LampOf::from_array(inputs.array()), inputs.vec3(), inputs.vec3());
    (seen.direction, seen.irradiance, [seen.sine, seen.reach])
});

/// Two directions across a lamp's disc ([`specula_core::lamps::disc_axes`]).
#[derive(Clone, Copy, Debug)]
pub struct AxesOfDisc;

formula!(AxesOfDisc, |_, inputs| axes_of_disc(direction: 3) -> (right: 3, up: 3) {
    let [right, up] = disc_axes(inputs.vec3());
    (right, up)
});

/// Shift of a pixel's rays ([`specula_core::lamps::shift`]).
#[derive(Clone, Copy, Debug)]
pub struct ShiftOfPixel;

formula!(ShiftOfPixel, |_, inputs| shift_of_pixel(column: 1, row: 1, lamp_index: 1) -> (outwards: 1, turn: 2) {
    let [column, row, lamp] = inputs.array();
    let Shift { outwards, turn } = shift(column, row, lamp);
    ([outwards], turn)
});

/// Shadow ray to a point of a lamp ([`specula_core::lamps::shadow_ray`]).
#[derive(Clone, Copy, Debug)]
pub struct ShadowRayOf;

formula!(ShadowRayOf, |_, inputs| shadow_ray_of(
    normal: 3, direction: 3, sine: 1, right: 3, up: 3, outwards: 1, turn: 2, place: 4
) -> (
    ray_dir: 3, weight: 1
) {
    let (normal, direction, sine) = (inputs.vec3(), inputs.vec3(), inputs.number());
    let axes = [inputs.vec3(), inputs.vec3()];
    let shift = Shift { outwards: inputs.number(), turn: inputs.array() };
    let toward = Toward { direction, irradiance: Vec3::zero(sine), sine, reach: sine };
    let ShadowRay { direction, weight } = shadow_ray(normal, &toward, axes, &shift, inputs.array());
    (direction, [weight])
});

/// Share of a lamp that a surface sees ([`specula_core::lamps::seen_share`]).
#[derive(Clone, Copy, Debug)]
pub struct ShareSeen;

formula!(ShareSeen, |_, inputs| share_seen(all: 1, reaching: 1) -> (share: 1) {
    [seen_share(inputs.number(), inputs.number())]
});

/// Light of a lamp on a surface ([`specula_core::lamps::direct_light`]).
#[derive(Clone, Copy, Debug)]
pub struct DirectLightOf;

formula!(DirectLightOf, |_, inputs| direct_light_of(
    normal: 3, n_dot_v: 1, view_dir: 3, f0: 3, alpha_ggx: 1, direction: 3, irradiance: 3, sine: 1, share: 1
) -> (
    diffuse_irradiance: 3, specular: 3
) {
    let facing = PixelFacing { normal: inputs.vec3(), n_dot_v: inputs.number() };
    let (view_dir, f0, alpha_ggx) = (inputs.vec3(), inputs.vec3(), inputs.number());
    let (direction, irradiance, sine, share) = (inputs.vec3(), inputs.vec3(), inputs.number(), inputs.number());
    let nowhere = Vec3::zero(sine);
    let pixel = LitPixel { point: nowhere, start: nowhere, view_dir, facing, f0, alpha_ggx };
    let light = direct_light(&pixel, &Toward { direction, irradiance, sine, reach: sine }, share);
    (light.irradiance, light.specular)
});
