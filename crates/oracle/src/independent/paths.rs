//! Pictures of solids by path tracing: light of all bounces.
//!
//! A path starts at the eye and is reflected from solid to solid until it leaves for the sky. Each
//! surface reflects by the material of [`specula_core::physical`](mod@specula_core::physical): with
//! albedo a, metalness m and F₀ = 0.04 (1 − m) + a m
//!
//! ```text
//! f(v, l) = (1 − ρ(n·v)) (1 − m) a / π + f_GGX(v, l; F₀)
//! ```
//!
//! where f_GGX is that of [`super::brdf`] and ρ its albedo for F₀ = 0.04: a dielectric transmits
//! the light that its surface does not reflect to its diffuse layer. Directions are drawn from D(h)
//! n·h or by their cosine, and weighted by f n·l over the density of both (Veach and Guibas 1995,
//! "Optimally Combining Sampling Techniques for Monte Carlo Rendering"). Suns are points, seen
//! along one ray from every surface.

use super::{
    brdf::{brdf, reflected},
    rays::RayView,
};
use core::f64::consts::{FRAC_1_PI, PI, TAU};
use glam::DVec3;
use rayon::prelude::*;

/// Reflectance of dielectrics at normal incidence.
const DIELECTRIC: f64 = 0.04;
/// Distance from a surface at which a path continues.
const STEP: f64 = 1e-6;
/// Entries of the table of albedos.
const ALBEDOS: usize = 64;
/// Share of directions sampled from the facets.
const OF_FACETS: f64 = 0.5;

/// Form of a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Ball.
    Ball {
        /// Centre.
        center: DVec3,
        /// Radius.
        radius: f64,
    },
    /// Block along the axes.
    Block {
        /// Centre.
        center: DVec3,
        /// Half edges.
        half: DVec3,
    },
}

/// Solid of one material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// Form.
    pub shape: Shape,
    /// Albedo, linear.
    pub albedo: DVec3,
    /// Metalness, in \[0, 1\].
    pub metalness: f64,
    /// Perceptual roughness, in (0, 1\].
    pub roughness: f64,
}

/// Sun: a point, infinitely far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit direction to it.
    pub direction: DVec3,
    /// Irradiance of a surface that faces it.
    pub irradiance: DVec3,
}

/// Solids and their light.
pub struct World<'a> {
    solids: &'a [Solid],
    sky: &'a (dyn Fn(DVec3) -> DVec3 + Sync),
    suns: &'a [Sun],
    /// Albedo of each solid's surface for F₀ = 0.04 in equal steps of n·v.
    albedos: Vec<[f64; ALBEDOS]>,
}

impl core::fmt::Debug for World<'_> {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        out.debug_struct("World").field("solids", &self.solids).field("suns", &self.suns).finish_non_exhaustive()
    }
}

/// Point of a solid.
#[derive(Clone, Copy, Debug)]
struct Hit {
    distance: f64,
    normal: DVec3,
    solid: usize,
}

/// Pixel of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Traced {
    /// Mean radiance of its paths that hit a solid, linear.
    pub radiance: [f64; 3],
    /// Share of its paths that hit a solid.
    pub coverage: f64,
}

impl<'a> World<'a> {
    /// Solids under a sky, a function of unit directions, and suns.
    pub fn new(solids: &'a [Solid], sky: &'a (dyn Fn(DVec3) -> DVec3 + Sync), suns: &'a [Sun]) -> Self {
        let albedo = |roughness: f64, entry: usize| {
            let n_dot_v = (entry as f64 + 0.5) / ALBEDOS as f64;
            let to_eye = [(1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v];
            reflected(|_| [1.0], [0.0, 0.0, 1.0], to_eye, roughness, 1).of(0, DIELECTRIC)
        };
        let table = |solid: &Solid| core::array::from_fn(|entry| albedo(solid.roughness, entry));
        Self { solids, sky, suns, albedos: solids.iter().map(table).collect() }
    }

    /// Picture of a view, of paths that are reflected at most `bounces` times after the first
    /// surface: without any, only the sky and the suns light a surface. `samples` paths along each
    /// edge of a pixel start from places of their own.
    pub fn picture(&self, view: &RayView, bounces: u32, samples: usize, seed: u64) -> Vec<Traced> {
        (0..view.pixel_count()).into_par_iter().map(|pixel| self.pixel(view, pixel, bounces, samples, seed)).collect()
    }

    /// Index of the solid that is seen through the middle of a pixel, and its normal there.
    pub fn seen(&self, view: &RayView, pixel: usize) -> Option<(usize, DVec3)> {
        let direction = (view.camera_from_world.transpose() * view.ray(pixel)).normalize();
        self.hit(view.position, direction).map(|hit| (hit.solid, hit.normal))
    }

    fn pixel(&self, view: &RayView, pixel: usize, bounces: u32, samples: usize, seed: u64) -> Traced {
        let mut chance = Chance::of(seed, pixel as u64);
        let (mut sum, mut met) = (DVec3::ZERO, 0_usize);
        for sample in 0..samples * samples {
            let within =
                [sample % samples, sample / samples].map(|k| (k as f64 + chance.draw()) / samples as f64 - 0.5);
            let ray = view.ray(pixel) + DVec3::new(within[0] / view.focal_px[0], within[1] / view.focal_px[1], 0.0);
            let direction = (view.camera_from_world.transpose() * ray).normalize();
            if let Some(hit) = self.hit(view.position, direction) {
                sum += self.light_of(view.position, direction, hit, bounces, &mut chance);
                met += 1;
            }
        }
        let all = (samples * samples) as f64;
        Traced { radiance: (sum / met.max(1) as f64).to_array(), coverage: met as f64 / all }
    }

    /// Light along a path from a hit.
    fn light_of(&self, eye: DVec3, ray: DVec3, first: Hit, bounces: u32, chance: &mut Chance) -> DVec3 {
        let (mut origin, mut direction, mut hit) = (eye, ray, first);
        let (mut light, mut weight) = (DVec3::ZERO, DVec3::ONE);
        for bounce in 0..=bounces {
            let (solid, to_eye) = (&self.solids[hit.solid], -direction);
            let n_dot_v = hit.normal.dot(to_eye);
            if n_dot_v <= 0.0 {
                return light;
            }
            let start = origin + hit.distance * direction + STEP * hit.normal;
            for sun in self.suns {
                let n_dot_l = hit.normal.dot(sun.direction);
                if n_dot_l > 0.0 && self.hit(start, sun.direction).is_none() {
                    light += weight * self.reflectance(&hit, to_eye, sun.direction) * sun.irradiance * n_dot_l;
                }
            }
            let Some((next, density)) = draw_direction(hit.normal, to_eye, solid.roughness, chance) else {
                return light;
            };
            weight *= self.reflectance(&hit, to_eye, next) * (hit.normal.dot(next) / density);
            match self.hit(start, next) {
                None => return light + weight * (self.sky)(next),
                Some(_) if bounce == bounces => return light,
                Some(found) => (origin, direction, hit) = (start, next, found),
            }
        }
        light
    }

    /// f(v, l) at a hit.
    fn reflectance(&self, hit: &Hit, to_eye: DVec3, light_dir: DVec3) -> DVec3 {
        let Solid { albedo, metalness, roughness, .. } = self.solids[hit.solid];
        let entry = (hit.normal.dot(to_eye) * ALBEDOS as f64) as usize;
        let passed = 1.0 - self.albedos[hit.solid][entry.min(ALBEDOS - 1)];
        let diffuse = albedo * ((1.0 - metalness) * passed * FRAC_1_PI);
        let [normal, to_eye, light_dir] = [hit.normal, to_eye, light_dir].map(|v| v.to_array());
        let specular = |f0: f64| brdf(normal, to_eye, light_dir, roughness, f0);
        let f0 = albedo * metalness + DIELECTRIC * (1.0 - metalness);
        let [without, with] = [0.0, 1.0].map(specular);
        diffuse + without + f0 * (with - without)
    }

    /// First point of a solid along a ray.
    fn hit(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let found = self.solids.iter().enumerate().filter_map(|(solid, Solid { shape, .. })| {
            let (distance, normal) = shape.meet(origin, direction)?;
            Some(Hit { distance, normal, solid })
        });
        found.min_by(|a, b| a.distance.total_cmp(&b.distance))
    }
}

impl Shape {
    /// Distance along a unit ray to the entry point, and the unit normal there.
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
        match *self {
            Self::Ball { center, radius } => {
                let from_center = origin - center;
                let along = from_center.dot(direction);
                let apart = (from_center - along * direction).length_squared();
                let distance = -along - (radius * radius - apart).max(0.0).sqrt();
                (apart < radius * radius && distance > 0.0)
                    .then(|| (distance, (from_center + distance * direction) / radius))
            }
            Self::Block { center, half } => {
                let (near, far) = ((center - half - origin) / direction, (center + half - origin) / direction);
                let (enter, leave) = (near.min(far), near.max(far));
                let distance = enter.max_element();
                let axis = (0..3).find(|axis| enter[*axis] == distance)?;
                let mut normal = DVec3::ZERO;
                normal[axis] = -direction[axis].signum();
                (distance > 0.0 && distance < leave.min_element()).then_some((distance, normal))
            }
        }
    }

    /// Points of the surface, evenly spread with an area of `step`² each, and their normals.
    pub fn points(&self, step: f64) -> Vec<(DVec3, DVec3)> {
        match *self {
            Self::Ball { center, radius } => {
                let count = (4.0 * PI * radius * radius / (step * step)).ceil();
                // The golden angle.
                let turn = PI * (3.0 - 5.0_f64.sqrt());
                let normal = |k: u32| {
                    let z = 1.0 - (2.0 * f64::from(k) + 1.0) / count;
                    let (sine, cosine) = (turn * f64::from(k)).sin_cos();
                    let ring = (1.0 - z * z).sqrt();
                    DVec3::new(ring * cosine, ring * sine, z)
                };
                (0..count as u32).map(normal).map(|normal| (center + radius * normal, normal)).collect()
            }
            Self::Block { center, half } => {
                let face = |axis: usize, side: f64| {
                    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                    let [columns, rows] = [b, c].map(|axis| (2.0 * half[axis] / step).ceil().max(1.0) as u32);
                    let place = |k: u32, count: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(count) - 1.0;
                    (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row))).map(
                        move |(column, row)| {
                            let mut normal = DVec3::ZERO;
                            normal[axis] = side;
                            let mut at = normal;
                            (at[b], at[c]) = (place(column, columns), place(row, rows));
                            (center + at * half, normal)
                        },
                    )
                };
                (0..3)
                    .flat_map(|axis| [-1.0, 1.0].map(|side| (axis, side)))
                    .flat_map(|(axis, side)| face(axis, side))
                    .collect()
            }
        }
    }
}

/// Direction above a surface, and its density per steradian; `None` below it.
fn draw_direction(normal: DVec3, to_eye: DVec3, roughness: f64, chance: &mut Chance) -> Option<(DVec3, f64)> {
    let alpha2 = roughness.powi(4);
    let (across, along) = normal.any_orthonormal_pair();
    let [choice, radius, turn] = [chance.draw(), chance.draw(), chance.draw()];
    let (sine, cosine) = (TAU * turn).sin_cos();
    let around = sine * across + cosine * along;
    let light_dir = if choice < OF_FACETS {
        let cos2 = (1.0 - radius) / (1.0 + (alpha2 - 1.0) * radius);
        let half = cos2.sqrt() * normal + (1.0 - cos2).max(0.0).sqrt() * around;
        2.0 * to_eye.dot(half) * half - to_eye
    } else {
        (1.0 - radius).sqrt() * normal + radius.sqrt() * around
    };
    let n_dot_l = normal.dot(light_dir);
    let half = (to_eye + light_dir).normalize_or_zero();
    let v_dot_h = to_eye.dot(half);
    if !(n_dot_l > 0.0 && v_dot_h > 0.0) {
        return None;
    }
    let n_dot_h = normal.dot(half);
    let sine2 = normal.cross(half).length_squared();
    let facets = alpha2 / (PI * (alpha2 * n_dot_h * n_dot_h + sine2).powi(2)) * n_dot_h / (4.0 * v_dot_h);
    Some((light_dir, OF_FACETS * facets + (1.0 - OF_FACETS) * n_dot_l * FRAC_1_PI))
}

/// Random numbers (SplitMix64; Steele, Lea and Flood 2014).
struct Chance(u64);

impl Chance {
    fn of(seed: u64, stream: u64) -> Self {
        let mut chance = Self(seed ^ stream.wrapping_mul(0xd134_2543_de82_ef95));
        chance.draw();
        chance
    }

    /// The next number, in [0, 1).
    fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::independent::assert_close;

    /// Noise of 90 000 paths.
    const CHANCE: f64 = 0.01;

    fn ball(albedo: f64, metalness: f64, roughness: f64) -> Solid {
        let shape = Shape::Ball { center: DVec3::ZERO, radius: 1.0 };
        Solid { shape, albedo: DVec3::splat(albedo), metalness, roughness }
    }

    fn view() -> RayView {
        RayView {
            camera_from_world: glam::DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y).transpose(),
            position: DVec3::new(0.0, -4.0, 0.0),
            focal_px: [1.0; 2],
            principal_px: [0.5; 2],
            near: 0.01,
            size: [1, 1],
        }
    }

    /// One narrow pixel that looks at the point of a ball that faces the eye.
    fn facing(world: &World<'_>, bounces: u32) -> DVec3 {
        let view = RayView { focal_px: [1e4; 2], ..view() };
        world.picture(&view, bounces, 300, 7)[0].radiance.into()
    }

    #[test]
    fn a_white_dielectric_in_a_furnace_reflects_all_light() {
        let solids = [ball(1.0, 0.0, 0.4)];
        let light = facing(&World::new(&solids, &|_| DVec3::ONE, &[]), 0);
        assert_close(light.x, 1.0, CHANCE);
    }

    #[test]
    fn metals_in_a_furnace_match_quadrature() {
        for roughness in [0.1, 0.5, 0.9] {
            let solids = [ball(1.0, 1.0, roughness)];
            let light = facing(&World::new(&solids, &|_| DVec3::splat(2.0), &[]), 0);
            let expected = reflected(|_| [2.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], roughness, 1).of(0, 1.0);
            assert_close(light.x / expected, 1.0, CHANCE);
        }
    }

    #[test]
    fn suns_light_facing_surfaces_and_solids_cast_shadows() {
        let towards = DVec3::new(0.6, -0.8, 0.0);
        let suns = [Sun { direction: towards, irradiance: DVec3::splat(3.0) }];
        let black: &(dyn Fn(DVec3) -> DVec3 + Sync) = &|_| DVec3::ZERO;
        let lit = [ball(0.5, 0.0, 0.6)];
        let world = World::new(&lit, black, &suns);
        let hit = Hit { distance: 3.0, normal: DVec3::NEG_Y, solid: 0 };
        let expected = world.reflectance(&hit, DVec3::NEG_Y, towards) * (3.0 * 0.8);
        assert_close(facing(&world, 0).x / expected.x, 1.0, 1e-3);

        let shape = Shape::Block { center: 2.0 * towards + DVec3::NEG_Y, half: DVec3::splat(0.3) };
        let hidden = [lit[0], Solid { shape, ..lit[0] }];
        assert_eq!(facing(&World::new(&hidden, black, &suns), 0), DVec3::ZERO);
    }

    /// Between two facing white walls the light of each further bounce is a share of that before.
    #[test]
    fn bounces_add_light_and_end() {
        let wall = |y: f64| Solid {
            shape: Shape::Block { center: DVec3::new(0.0, y, 0.0), half: DVec3::new(5.0, 0.1, 5.0) },
            ..ball(0.8, 0.0, 1.0)
        };
        let solids = [wall(0.0), wall(-4.5)];
        let world = World::new(&solids, &|_| DVec3::ONE, &[]);
        let lights = [0, 1, 2, 8].map(|bounces| facing(&world, bounces).x);
        assert!(lights.is_sorted() && lights[0] > 0.0 && lights[3] < 1.0, "{lights:?}");
    }

    #[test]
    fn points_cover_the_surface_evenly() {
        for (shape, area) in [
            (Shape::Ball { center: DVec3::X, radius: 0.5 }, PI),
            (Shape::Block { center: DVec3::Y, half: DVec3::new(1.0, 0.5, 0.25) }, 7.0),
        ] {
            let points = shape.points(0.05);
            assert_close(points.len() as f64 * 0.05 * 0.05 / area, 1.0, 0.01);
            for (point, normal) in points {
                let (distance, found) = shape.meet(point + normal, -normal).expect("a point of the surface");
                assert_close(distance, 1.0, 1e-9);
                assert_close(found.dot(normal), 1.0, 1e-9);
            }
        }
    }
}
