//! Lamps: suns and spheres that light a scene, with shadows.
//!
//! A lamp in the direction l of a surface point x, of irradiance E at normal incidence and angular
//! radius ω, adds to the light that leaves a physical material ([`mod@crate::physical`])
//!
//! ```text
//! L = V E (H(n·l, sin ω) d/π + D(h) G(l, v) / (4 n·l n·v) F(v·h) n·l)
//! ```
//!
//! with the diffuse albedo d, less what the material reflects specularly, the half vector h of l
//! and the direction v to the eye, the microfacet density D of GGX (Walter et al. 2007, eq. 33),
//! the height-correlated masking and shadowing G of Smith (Heitz 2014, eq. 99), the reflectance F =
//! F₀ + (1 − F₀)(1 − v·h)⁵ (Schlick 1994) and the share V of the lamp that x sees. E is that of the
//! sun, or I / |c − x|² of a sphere around c of radiant intensity I. [`horizon`] is H.
//!
//! An area lamp makes a highlight wider than the lobe. The roughness of D and G is widened
//! accordingly (after Karis 2013, "Real Shading in Unreal Engine 4"): α′² = α² + sin² ω /
//! 4. The half vectors of a lamp are within ω/2 of each other, and with this factor a mirror shows
//! the lamp with at most F times the lamp's radiance E / (π sin² ω).
//!
//! V is computed by tracing rays from x to points of the lamp's disc against the triangles of the
//! scene ([`crate::near_field`]): a spiral of equal areas (Vogel 1979), shifted and turned per
//! pixel by numbers derived from the pixel's position. Each ray is weighted by its light on the
//! surface.
//!
//! Lamp light after one or two diffuse interreflections is stored at the vertices of the triangles;
//! a pixel reads it from the triangle below it ([`crate::near_field::NearField::surface_below`]).

use crate::{
    camera::CameraOf,
    color::srgb_color,
    math,
    near_field::{T_MISS, ray_origin},
    physical::{PixelFacing, PixelLight, pixel_facing, reflectances, reflected},
    real::Real,
    shade_pixels::{Pixel, PixelSurface, per_coverage, pixel_surface},
    sphere::GOLDEN_ANGLE,
    vector::{Vec3, normalize_or, vec3},
};
use core::f32::consts::{FRAC_1_PI, PI};

/// Largest number of lamps.
pub const LAMPS_MAX: usize = 64;
/// Default number of shadow rays of a pixel to an area lamp.
pub const RAYS: usize = 32;
/// Largest number of shadow rays.
pub const RAYS_MAX: usize = 1024;
/// Largest irradiance or radiant intensity of a lamp: a sun at noon has 1e3 W/m².
pub const LIGHT_MAX: f32 = 1e9;
/// Largest coordinate and radius of a lamp: squares of distances do not overflow an `f32`.
pub const DISTANCE_MAX: f32 = 1e9;

/// Distance from a point lamp below which its irradiance is constant.
const NEAREST: f32 = 1e-4;
/// Largest sine of the angular radius of a lamp: for one that touches or encloses the surface.
const SINE_MAX: f32 = 0.99;
/// Smallest sine for which the horizon is blurred.
const SINE_MIN: f32 = 1e-6;
/// Smallest α² of a lobe: highlights of mirrors under a point lamp.
const ALPHA2_MIN: f32 = 1e-6;
/// Modulus of the pseudo-random numbers of a pixel. Cubes are a permutation of its remainders, and
/// products of two remainders are whole numbers that an `f32` represents exactly.
const PRIME: f32 = 1019.0;

/// A lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lamp {
    /// Distant light, the same at every point.
    Sun {
        /// Direction to the sun, in world space, of any length but 0.
        direction: [f32; 3],
        /// Irradiance of a surface that faces it, linear; in units of the scene's radiance times
        /// steradians.
        irradiance: [f32; 3],
        /// Diameter in radians, from 0 below π.
        diameter: f32,
    },
    /// Sphere that emits uniformly.
    Sphere {
        /// Centre, in world space.
        position: [f32; 3],
        /// Radiant intensity, linear: the irradiance at a distance of 1.
        intensity: [f32; 3],
        /// Radius, in units of the scene; 0 for a point.
        radius: f32,
    },
}

/// Fault of a lamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LampError {
    /// There are more lamps than [`LAMPS_MAX`], or no shadow rays, or more than [`RAYS_MAX`].
    Count,
    /// A number is not finite or out of range.
    Number {
        /// Index of the lamp.
        index: usize,
    },
    /// Reflected light is not three finite numbers for each vertex of the surface.
    Reflected,
}

impl core::fmt::Display for LampError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Count => {
                write!(out, "there are more than {LAMPS_MAX} lamps, or not from 1 to {RAYS_MAX} shadow rays for each")
            }
            Self::Number { index } => {
                write!(
                    out,
                    "lamp {index} has a strength above {LIGHT_MAX}, a position or radius beyond {DISTANCE_MAX}, no \
                     direction, or a number that is negative or not finite"
                )
            }
            Self::Reflected => write!(out, "reflected light is not three finite numbers for each vertex"),
        }
    }
}

impl core::error::Error for LampError {}

/// Checks lamps and the number of their shadow rays.
///
/// # Errors
///
/// The first fault.
pub fn check(lamps: &[Lamp], rays: usize) -> Result<(), LampError> {
    if lamps.len() > LAMPS_MAX || !(1..=RAYS_MAX).contains(&rays) {
        return Err(LampError::Count);
    }
    match lamps.iter().position(|lamp| !lamp.is_valid()) {
        Some(index) => Err(LampError::Number { index }),
        None => Ok(()),
    }
}

impl Lamp {
    fn is_valid(&self) -> bool {
        let is_light = |light: &[f32; 3]| light.iter().all(|x| (0.0..=LIGHT_MAX).contains(x));
        match self {
            Self::Sun { direction, irradiance, diameter } => {
                let length = direction.iter().map(|x| x * x).sum::<f32>();
                length.is_finite() && length > f32::MIN_POSITIVE && is_light(irradiance) && (0.0..PI).contains(diameter)
            }
            Self::Sphere { position, intensity, radius } => {
                position.iter().all(|x| x.abs() <= DISTANCE_MAX)
                    && is_light(intensity)
                    && (0.0..=DISTANCE_MAX).contains(radius)
            }
        }
    }

    /// True for area lamps, which have soft shadows.
    pub const fn is_wide(&self) -> bool {
        match self {
            Self::Sun { diameter, .. } => *diameter > 0.0,
            Self::Sphere { radius, .. } => *radius > 0.0,
        }
    }

    /// The numbers of [`LampOf::LEN`].
    pub fn numbers(&self) -> [f32; 8] {
        match *self {
            Self::Sun { direction: [x, y, z], irradiance: [red, green, blue], diameter } => {
                let length = math::sqrt(x * x + y * y + z * z);
                [x / length, y / length, z / length, 0.0, red, green, blue, math::sin(0.5 * diameter)]
            }
            Self::Sphere { position: [x, y, z], intensity: [red, green, blue], radius } => {
                [x, y, z, 1.0, red, green, blue, radius]
            }
        }
    }
}

/// A lamp in the number type of formulas.
#[derive(Clone, Copy, Debug)]
pub struct LampOf<R> {
    /// Unit direction to a sun, or position of a sphere.
    pub place: Vec3<R>,
    /// 0 for a sun, 1 for a sphere.
    pub is_sphere: R,
    /// Irradiance of a sun at normal incidence, or intensity of a sphere.
    pub light: Vec3<R>,
    /// Sine of a sun's angular radius, or radius of a sphere.
    pub extent: R,
}

impl<R: Real> LampOf<R> {
    /// Numbers of a lamp: place, kind, light, extent.
    pub const LEN: usize = 8;

    /// A lamp from its numbers.
    #[inline(always)]
    pub fn from_array([x, y, z, is_sphere, red, green, blue, extent]: [R; 8]) -> Self {
        Self { place: vec3(x, y, z), is_sphere, light: vec3(red, green, blue), extent }
    }
}

/// Surface of a pixel, with the attributes for the light of lamps.
#[derive(Clone, Copy, Debug)]
pub struct LitPixel<R> {
    /// Point of the surface, in world space.
    pub point: Vec3<R>,
    /// Start of shadow rays: the point, lifted along the normal.
    pub start: Vec3<R>,
    /// Unit direction to the eye.
    pub view_dir: Vec3<R>,
    /// Unit normal and n·v.
    pub facing: PixelFacing<R>,
    /// Reflectance at normal incidence.
    pub f0: Vec3<R>,
    /// Width α of the lobe, the square of the perceptual roughness.
    pub alpha_ggx: R,
}

/// Surface of a pixel that is seen along −`view_dir`. `depth` is the premultiplied sum of depths
/// along the optical axis, `offset` the height at which shadow rays start.
#[inline(always)]
pub fn lit_pixel<R: Real>(
    camera: &CameraOf<R>,
    pixel: &Pixel<R>,
    depth: R,
    view_dir: Vec3<R>,
    offset: R,
) -> LitPixel<R> {
    let surface = pixel_surface(pixel, view_dir);
    let facing = pixel_facing(pixel, view_dir);
    let point = ray_origin(camera, pixel, depth, view_dir, depth.zero());
    LitPixel {
        point,
        start: point.add_scaled(offset, facing.normal),
        view_dir,
        facing,
        f0: surface.tint,
        alpha_ggx: surface.roughness.squared(),
    }
}

/// Lamp seen from a surface point.
#[derive(Clone, Copy, Debug)]
pub struct Toward<R> {
    /// Unit direction to its centre.
    pub direction: Vec3<R>,
    /// Irradiance at normal incidence.
    pub irradiance: Vec3<R>,
    /// Sine of its angular radius.
    pub sine: R,
    /// Length of shadow rays; surfaces behind the lamp cast no shadow.
    pub reach: R,
}

/// Direction and irradiance of a lamp at a point. The direction is the normal if the point is the
/// lamp's centre. The irradiance is constant within a sphere, and within a ten-thousandth of a unit
/// of a point.
#[inline(always)]
pub fn toward<R: Real>(lamp: &LampOf<R>, point: Vec3<R>, normal: Vec3<R>) -> Toward<R> {
    let is_sphere = lamp.extent.constant(0.5).less(lamp.is_sphere);
    let to_center = lamp.place - point;
    let squared = to_center.length_squared();
    let nearest = squared.max(lamp.extent.squared()).max(squared.constant(NEAREST * NEAREST));
    let sine = R::select(is_sphere, lamp.extent / nearest.sqrt(), lamp.extent);
    let reach = (squared.sqrt() - lamp.extent).max(squared.zero());
    Toward {
        direction: normalize_or(Vec3::select(is_sphere, to_center, lamp.place), normal),
        irradiance: lamp.light * R::select(is_sphere, nearest.recip(), nearest.constant(1.0)),
        sine: sine.min(sine.constant(SINE_MAX)),
        reach: R::select(is_sphere, reach, reach.constant(T_MISS)),
    }
}

/// Irradiance of a surface by a disc, relative to normal incidence: n·l above the horizon, zero
/// below, and between, where the surface sees a part of the disc, the parabola that joins both
/// smoothly.
#[inline(always)]
pub fn horizon<R: Real>(n_dot_l: R, sine: R) -> R {
    let sine = sine.max(sine.constant(SINE_MIN));
    let partly = (n_dot_l + sine).squared() / (sine * 4.0);
    R::select(n_dot_l.abs().less(sine), partly, n_dot_l.max(n_dot_l.zero()))
}

/// Radiance that a surface reflects specularly for each unit of irradiance at normal incidence,
/// red, green and blue: D G F / (4 n·v), with the roughness widened for a disc of this sine.
#[inline(always)]
pub fn specular<R: Real>(
    f0: Vec3<R>,
    alpha_ggx: R,
    facing: &PixelFacing<R>,
    view_dir: Vec3<R>,
    light_dir: Vec3<R>,
    sine: R,
) -> Vec3<R> {
    let PixelFacing { normal, n_dot_v } = *facing;
    let alpha2 = (alpha_ggx.squared() + sine.squared() * 0.25).clamp(ALPHA2_MIN, 1.0);
    let n_dot_l = normal.dot(light_dir).max(n_dot_v.zero());
    let half = normalize_or(light_dir + view_dir, normal);
    // Exact where the half vector is close to the normal, unlike 1 − (n·h)².
    let sine2 = normal.cross(half).length_squared();
    let q = alpha2.mul_add(normal.dot(half).squared(), sine2);
    let density = alpha2 / (q.squared() * PI);
    let smith = |cosine: R| ((-alpha2 + 1.0) * cosine.squared() + alpha2).sqrt();
    let visible = (n_dot_l * smith(n_dot_v) + n_dot_v * smith(n_dot_l)).recip() * 0.5;
    let cosine = -view_dir.dot(half).clamp(0.0, 1.0) + 1.0;
    let schlick = cosine.squared().squared() * cosine;
    let fresnel = f0 * (-schlick + 1.0) + Vec3::splat(schlick);
    fresnel * (density * visible * n_dot_l)
}

/// Light of lamps on a surface, and its specular reflection.
#[derive(Clone, Copy, Debug)]
pub struct DirectLight<R> {
    /// Irradiance / π.
    pub irradiance: Vec3<R>,
    /// Radiance that leaves the surface towards the eye.
    pub specular: Vec3<R>,
}

impl<R: Real> DirectLight<R> {
    /// Numbers of a direct light: irradiance, specular.
    pub const LEN: usize = 6;

    /// No light: all zeros.
    #[inline(always)]
    pub fn none(like: R) -> Self {
        Self { irradiance: Vec3::zero(like), specular: Vec3::zero(like) }
    }
    /// Interreflected light: only irradiance / π, because highlights of dim surfaces are negligible
    /// compared with those of a lamp.
    #[inline(always)]
    pub fn reflected(irradiance: Vec3<R>) -> Self {
        Self { irradiance, specular: Vec3::zero(irradiance.x) }
    }
    /// Sum of both lights.
    #[must_use]
    #[inline(always)]
    pub fn and(self, other: Self) -> Self {
        Self { irradiance: self.irradiance + other.irradiance, specular: self.specular + other.specular }
    }
    /// The numbers, in the order of [`DirectLight::LEN`].
    #[inline(always)]
    pub fn to_array(&self) -> [R; 6] {
        let ([a, b, c], [d, e, f]) = (self.irradiance.to_array(), self.specular.to_array());
        [a, b, c, d, e, f]
    }
    /// Inverse of [`DirectLight::to_array`].
    #[inline(always)]
    pub fn from_array([a, b, c, d, e, f]: [R; 6]) -> Self {
        Self { irradiance: vec3(a, b, c), specular: vec3(d, e, f) }
    }
}

/// Light of a lamp with the visible share `share`.
#[inline(always)]
pub fn direct_light<R: Real>(pixel: &LitPixel<R>, toward: &Toward<R>, share: R) -> DirectLight<R> {
    let LitPixel { view_dir, ref facing, f0, alpha_ggx, .. } = *pixel;
    let height = horizon(facing.normal.dot(toward.direction), toward.sine);
    let specular = specular(f0, alpha_ggx, facing, view_dir, toward.direction, toward.sine);
    DirectLight {
        irradiance: toward.irradiance * (height * share * FRAC_1_PI),
        specular: toward.irradiance.times(specular) * share,
    }
}

/// Checks the irradiance / π of a surface's vertices by interreflected light; empty without
/// interreflections.
///
/// # Errors
///
/// [`LampError::Reflected`].
pub fn check_reflected(vertex_count: usize, reflected: &[f32]) -> Result<(), LampError> {
    let is_whole = reflected.is_empty() || reflected.len() == 3 * vertex_count;
    let is_fine = is_whole && reflected.iter().all(|number| number.is_finite());
    if is_fine { Ok(()) } else { Err(LampError::Reflected) }
}

/// Rotation and radial shift of a pixel's shadow rays.
#[derive(Clone, Copy, Debug)]
pub struct Shift<R> {
    /// Radial shift as a share of a ring, in (0, 1).
    pub outwards: R,
    /// Cosine and sine of the rotation.
    pub turn: [R; 2],
}

/// Shift of the rays of a pixel, given by its column and row, to a lamp, given by its index.
#[inline(always)]
pub fn shift<R: Real>(column: R, row: R, lamp: R) -> Shift<R> {
    let across = cube(remainder(column));
    let down = cube(remainder(across * 31.0 + remainder(row)));
    let first = cube(remainder(down * 37.0 + lamp * 101.0 + 1.0));
    let second = cube(remainder(first * 41.0 + 7.0));
    let share = |number: R| (number + 0.5) * (1.0 / PRIME);
    // A rational point of the half circle; the spiral is symmetric.
    let t = share(second) * 2.0 - 1.0;
    let scale = (t.squared() + 1.0).recip();
    Shift { outwards: share(first), turn: [(-t.squared() + 1.0) * scale, t * 2.0 * scale] }
}

/// Remainder of a whole number below 2²⁰; exact even if division is not.
#[inline(always)]
fn remainder<R: Real>(number: R) -> R {
    number - ((number + 0.5) * (1.0 / PRIME)).floor() * PRIME
}

/// Cube of a remainder.
#[inline(always)]
fn cube<R: Real>(number: R) -> R {
    remainder(remainder(number * number) * number)
}

/// Point of a spiral of `count` points: cosine and sine of its angle, area of the disc within it
/// and area that it represents, as shares.
pub fn spiral_point(index: usize, count: usize) -> [f32; 4] {
    let angle = GOLDEN_ANGLE * index as f64;
    let per_point = 1.0 / count as f64;
    [math::cos64(angle) as f32, math::sin64(angle) as f32, (index as f64 * per_point) as f32, per_point as f32]
}

/// Two unit vectors perpendicular to a unit vector and to each other.
#[inline(always)]
pub fn disc_axes<R: Real>(direction: Vec3<R>) -> [Vec3<R>; 2] {
    let like = direction.x;
    let [x, z] =
        [vec3(like.constant(1.0), like.zero(), like.zero()), vec3(like.zero(), like.zero(), like.constant(1.0))];
    let other = Vec3::select(direction.z.abs().less(like.constant(0.7)), z, x);
    let right = normalize_or(other.cross(direction), x);
    [right, direction.cross(right)]
}

/// Shadow ray to a point of a lamp.
#[derive(Clone, Copy, Debug)]
pub struct ShadowRay<R> {
    /// Unit direction.
    pub direction: Vec3<R>,
    /// Light along the ray, relative to that of a ray at normal incidence: 0 below the horizon.
    pub weight: R,
}

/// Shadow ray of a surface to a point of a spiral over a lamp's disc. Points have equal areas of
/// the disc as seen from a facing surface, so each contributes an equal share of E.
#[inline(always)]
pub fn shadow_ray<R: Real>(
    normal: Vec3<R>,
    toward: &Toward<R>,
    [right, up]: [Vec3<R>; 2],
    shift: &Shift<R>,
    [cosine, sine, within, area]: [R; 4],
) -> ShadowRay<R> {
    let off_center2 =
        (toward.sine.squared() * shift.outwards.mul_add(area, within)).min(sine.constant(SINE_MAX * SINE_MAX));
    let [turn_cosine, turn_sine] = shift.turn;
    let across = right * (cosine * turn_cosine - sine * turn_sine) + up * (cosine * turn_sine + sine * turn_cosine);
    let along = (-off_center2 + 1.0).sqrt();
    let direction = (toward.direction * along).add_scaled(off_center2.sqrt(), across);
    ShadowRay { direction, weight: (normal.dot(direction) / along).max(along.zero()) }
}

/// Visible share of a lamp, from the weights of all rays and of the unblocked ones; zero if no ray
/// is above the horizon.
#[inline(always)]
pub fn seen_share<R: Real>(all: R, reaching: R) -> R {
    let zero = all.zero();
    let is_above = zero.less(all);
    (reaching / R::select(is_above, all, zero.constant(1.0))).keep(is_above)
}

/// Diffuse albedo of a pixel's surface, without ambient transfer, which shadows replace for lamps;
/// from the premultiplied sums of albedo and metalness.
#[inline(always)]
pub fn diffuse_albedo<R: Real>(albedo: Vec3<R>, metalness: R, coverage: R) -> Vec3<R> {
    let per_coverage = per_coverage(coverage);
    let [diffuse, _] = reflectances(albedo * per_coverage, metalness * per_coverage);
    diffuse
}

/// The colour of a pixel of a physical material under its light and that of lamps: sRGB-encoded,
/// premultiplied. Without lamps it is [`crate::physical::pixel_color`], to the last bit.
#[inline(always)]
pub fn pixel_color<R: Real>(
    surface: &PixelSurface<R>,
    light: &PixelLight<R>,
    albedo: Vec3<R>,
    direct: &DirectLight<R>,
    coverage: R,
) -> Vec3<R> {
    let [diffuse, specular] = reflected(surface, light);
    let lamp_light = PixelLight { irradiance: direct.irradiance, specular: Vec3::zero(coverage), ..*light };
    let [direct_diffuse, _] = reflected(&PixelSurface { base: albedo, ..*surface }, &lamp_light);
    srgb_color(diffuse + specular + (direct_diffuse + direct.specular)) * coverage
}
