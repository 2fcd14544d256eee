//! Light of lamps in a pixel, ray by ray.

use crate::number::Number;
use specula_core::{
    camera::CameraOf,
    lamps::{
        DirectLight, Lamp, LampOf, LitPixel, Toward, direct_light, disc_axes, lit_pixel, seen_share, shadow_ray, shift,
        spiral_point, toward,
    },
    near_field::NearField,
    shade_pixels::Pixel,
    vector::Vec3,
};

/// Lamps, and the surface that casts their shadows.
#[derive(Clone, Debug)]
pub struct Lamps {
    /// Lamps, in world space.
    pub lamps: Vec<Lamp>,
    /// Shadow rays of a pixel to each area lamp.
    pub rays: usize,
    /// Surface that casts shadows.
    pub occluder: Option<NearField<Vec<f32>>>,
    /// Irradiance / π of the occluder's vertices by reflected light; empty for none.
    pub reflected: Vec<f32>,
}

/// Light of lamps on the pixel of a column and a row, seen along −`view_dir`.
pub(super) fn illuminate<R: Number>(
    lamps: &Lamps,
    camera: &CameraOf<R>,
    pixel: &Pixel<R>,
    depth: R,
    view_dir: Vec3<R>,
    place: [usize; 2],
) -> DirectLight<R> {
    let number = |x: f32| R::of(f64::from(x));
    let offset = lamps.occluder.as_ref().map_or(0.0, |occluder| occluder.offset);
    let lit = lit_pixel(camera, pixel, depth, view_dir, number(offset));
    let none = DirectLight::none(depth);
    if !(R::of(0.0).less(pixel.coverage) & lit.start.is_finite()) {
        return none;
    }
    let direct = lamps.lamps.iter().enumerate().fold(none, |sum, (index, lamp)| {
        let seen = toward(&LampOf::from_array(lamp.numbers().map(number)), lit.point, lit.facing.normal);
        let rays = if lamp.is_wide() { lamps.rays } else { 1 };
        let share = match &lamps.occluder {
            Some(occluder) => share_of(occluder, lamps.rays, rays, &lit, &seen, index, place),
            None => R::of(1.0),
        };
        sum.and(direct_light(&lit, &seen, share))
    });
    let Some(occluder) = lamps.occluder.as_ref().filter(|_| !lamps.reflected.is_empty()) else { return direct };
    match occluder.surface_below(lit.start, lit.facing.normal) {
        Some(hit) => direct.and(DirectLight::reflected(occluder.between(&hit, &lamps.reflected))),
        None => direct,
    }
}

/// Share of a lamp that a pixel sees.
fn share_of<R: Number>(
    occluder: &NearField<Vec<f32>>,
    points: usize,
    rays: usize,
    lit: &LitPixel<R>,
    seen: &Toward<R>,
    index: usize,
    [column, row]: [usize; 2],
) -> R {
    let whole = |number: usize| R::of(number as f64);
    let (axes, shift) = (disc_axes(seen.direction), shift(whole(column), whole(row), whole(index)));
    let (mut all, mut reaching) = (R::of(0.0), R::of(0.0));
    for k in 0..rays {
        let point = spiral_point(k, points).map(|x| R::of(f64::from(x)));
        let ray = shadow_ray(lit.facing.normal, seen, axes, &shift, point);
        let is_above = R::of(0.0).less(ray.weight);
        all = all + ray.weight;
        if is_above && !occluder.is_blocked(lit.start, ray.direction, seen.reach) {
            reaching = reaching + ray.weight;
        }
    }
    seen_share(all, reaching)
}
