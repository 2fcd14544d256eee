//! Ground below a scene that catches its shadows: a plane of the background's colour, as bright as
//! the share of the light that the scene does not block.
//!
//! The share is (E_s + Σ_l V_l E_l H_l) / (E_o + Σ_l E_l H_l), channel by channel, with the
//! irradiance E_o of the sky above the open plane, the part E_s of it that passes the scene, and of
//! each lamp the irradiance E_l H_l ([`mod@specula_core::lamps`]) and the share V_l that is seen.

use crate::lamps::SceneLamps;
use core::f32::consts::TAU;
use glam::{Quat, Vec2, Vec3};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    lamps::{Lamp, LampOf, disc_axes, horizon, seen_share, shadow_ray, shift, spiral_point, toward},
    near_field::T_MISS,
    scene::Environment,
    sphere::directions,
};
use specula_mesh::{sky::Sky, surface::Surface};
use std::sync::{Arc, OnceLock};

/// Directions of a point, over the whole sphere; half of them are above the ground.
const DIRECTIONS: usize = 192;
/// Neighbouring points, in squares of this edge, have different directions, and the light is the
/// mean over such a square: interleaved sampling (Keller and Heidrich 2001). Otherwise a small
/// light, which few directions meet, casts few sharp shadows.
const INTERLEAVED: usize = 4;
/// Weights of neighbours along a row or a column, in which all directions of a square have equal
/// weights.
const MEAN: [f32; INTERLEAVED + 1] = [0.125, 0.25, 0.25, 0.25, 0.125];
/// Points along an edge of the square at which the light of the sky is computed; it is interpolated
/// between them.
const POINTS: usize = 256;
/// Edge of the square, in widths of the scene. Shadows of the sky fade towards it.
const WIDTHS: f32 = 4.0;
/// Share of the square's half edge within which shadows of the sky do not fade.
const FADE: f32 = 0.7;

/// Words of the bits of all directions.
const WORDS: usize = DIRECTIONS.div_ceil(u64::BITS as usize);

/// Plane below a scene, and the part of the sky that the scene hides from it.
#[derive(Debug)]
pub struct GroundPlane {
    /// Unit normal.
    up: Vec3,
    /// Middle of the square, on the plane.
    middle: Vec3,
    /// Directions of the square's edges.
    axes: [Vec3; 2],
    half_edge: f32,
    occluder: Arc<Surface>,
    /// Bits of the directions that are open at the points of the square, row by row; traced on
    /// first use.
    open: OnceLock<Vec<[u64; WORDS]>>,
}

impl GroundPlane {
    /// Plane perpendicular to `up` at a height along it; by default that of the lowest point of
    /// the shadow-casting surface. `None` if the surface has no extent.
    pub fn new(occluder: Arc<Surface>, up: Vec3, height: Option<f32>) -> Option<Arc<Self>> {
        let up = up.normalize_or_zero();
        let axes = <[Vec3; 2]>::from(up.any_orthonormal_pair());
        let positions = (0..occluder.vertex_count).map(|vertex| Vec3::from_slice(&occluder.vertex(vertex)[..3]));
        let (mut least, mut greatest) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for position in positions {
            let place = Vec3::new(axes[0].dot(position), axes[1].dot(position), up.dot(position));
            (least, greatest) = (least.min(place), greatest.max(place));
        }
        let size = greatest - least;
        let width = size.max_element();
        if !(width > 0.0 && width.is_finite() && up != Vec3::ZERO) {
            return None;
        }
        let center = 0.5 * (least + greatest);
        let height = height.unwrap_or(least.z);
        let middle = center.x * axes[0] + center.y * axes[1] + height * up;
        let half_edge = 0.5 * WIDTHS * width;
        Some(Arc::new(Self { up, middle, axes, half_edge, occluder, open: OnceLock::new() }))
    }

    /// Point of the ground at a column and a row of the square.
    fn point_of(&self, place: [f32; 2]) -> Vec3 {
        let [x, y] = place.map(|k| (2.0 * k / (POINTS - 1) as f32 - 1.0) * self.half_edge);
        self.middle + x * self.axes[0] + y * self.axes[1]
    }

    /// Open directions of every point of the square. Those below the plane are not traced.
    fn open(&self) -> &[[u64; WORDS]] {
        let trace = || {
            let directions = sky_directions();
            let at = |index: usize| {
                let point = self.point_of([index % POINTS, index / POINTS].map(|k| k as f32));
                let directions = &directions[set_of(index)];
                let is_open = |direction: Vec3| {
                    direction.dot(self.up) > 0.0 && !self.occluder.is_blocked(point.into(), direction.into(), T_MISS)
                };
                let mut bits = [0; WORDS];
                for (index, _) in directions.iter().enumerate().filter(|(_, direction)| is_open(**direction)) {
                    bits[index / 64] |= 1 << (index % 64);
                }
                bits
            };
            (0..POINTS * POINTS).into_par_iter().map(at).collect()
        };
        self.open.get_or_init(trace)
    }
}

/// Directions of the sky, those below the ground too, for each set of points: turned by rotations
/// that are spread evenly (Shoemake 1992, at the points of Roberts' sequence).
fn sky_directions() -> Vec<Vec<Vec3>> {
    const SETS: usize = INTERLEAVED * INTERLEAVED;
    let turn = |set: usize| {
        let share = (set as f32 + 0.5) / SETS as f32;
        let [first, second] = [0.754_877_7, 0.569_840_3].map(|step| (set as f32 * step).fract() * TAU);
        let [lower, upper] = [(1.0 - share).sqrt(), share.sqrt()];
        Quat::from_xyzw(lower * first.sin(), lower * first.cos(), upper * second.sin(), upper * second.cos())
    };
    let turned = |set: usize| {
        directions(DIRECTIONS).map(|direction| turn(set) * Vec3::from(direction.map(|x| x as f32))).collect()
    };
    (0..SETS).map(turned).collect()
}

/// Set of directions of a point of the square.
fn set_of(point: usize) -> usize {
    point / POINTS % INTERLEAVED * INTERLEAVED + point % POINTS % INTERLEAVED
}

/// Means of neighbouring points along rows or columns, whose points are `stride` apart.
fn means(points: &[[Vec3; 2]], stride: usize) -> Vec<[Vec3; 2]> {
    const BESIDE: usize = INTERLEAVED / 2;
    let mean = |index: usize| {
        let place = index / stride % POINTS;
        let weighted = |(k, weight): (usize, &f32)| {
            let neighbour = (place + k).clamp(BESIDE, POINTS - 1 + BESIDE) - BESIDE;
            points[index - place * stride + neighbour * stride].map(|light| light * *weight)
        };
        MEAN.iter().enumerate().map(weighted).fold([Vec3::ZERO; 2], |sum, light| [sum[0] + light[0], sum[1] + light[1]])
    };
    (0..points.len()).into_par_iter().map(mean).collect()
}

/// Ground below a scene, and the light on it.
#[derive(Clone, Debug)]
pub struct Ground {
    plane: Arc<GroundPlane>,
    /// Irradiance of the open plane by the sky.
    open: Vec3,
    /// Irradiance that reaches the points of the square, row by row; none without a sky.
    reaching: Vec<Vec3>,
    lamps: Vec<GroundLamp>,
    spiral: Vec<[f32; 4]>,
}

/// Numbers of a lamp, and its number of rays.
#[derive(Clone, Copy, Debug)]
struct GroundLamp {
    numbers: [f32; 8],
    rays: usize,
}

impl Ground {
    /// Ground under a sky and lamps.
    pub fn new(plane: Arc<GroundPlane>, sky: Option<&Environment<Vec<f32>>>, lamps: Option<&SceneLamps>) -> Self {
        let spiral = lamps.map_or(0, |lamps| lamps.rays);
        let lamps = lamps.map_or(&[][..], |lamps| &lamps.lamps);
        let ground_lamp =
            |lamp: &Lamp| GroundLamp { numbers: lamp.numbers(), rays: if lamp.is_wide() { spiral } else { 1 } };
        let mut ground = Self {
            plane,
            open: Vec3::ZERO,
            reaching: Vec::new(),
            lamps: lamps.iter().map(ground_lamp).collect(),
            spiral: (0..spiral).map(|k| spiral_point(k, spiral)).collect(),
        };
        if let Some(environment) = sky {
            ground.find_sky(&Sky::new(environment));
        }
        ground
    }

    /// Computes the light of the sky at the points of the square.
    fn find_sky(&mut self, sky: &Sky) {
        let share = 2.0 * TAU / DIRECTIONS as f32;
        let light = |(index, direction): (usize, &Vec3)| {
            let cosine = direction.dot(self.plane.up);
            (cosine > 0.0).then(|| (index, sky.radiance(*direction) * (cosine * share)))
        };
        let lights = |directions: &Vec<Vec3>| -> Vec<(usize, Vec3)> {
            directions.iter().enumerate().filter_map(light).filter(|(_, light)| *light != Vec3::ZERO).collect()
        };
        let lights: Vec<Vec<(usize, Vec3)>> = sky_directions().iter().map(lights).collect();
        let open: Vec<Vec3> = lights.iter().map(|set| set.iter().map(|(_, light)| *light).sum()).collect();
        self.open = open.iter().sum::<Vec3>() / open.len() as f32;
        if self.open == Vec3::ZERO {
            return;
        }
        let at = |(point, bits): (usize, &[u64; WORDS])| {
            let is_open = |index: usize| bits[index / 64] >> (index % 64) & 1 == 1;
            let set = set_of(point);
            [lights[set].iter().filter(|(index, _)| is_open(*index)).map(|(_, light)| *light).sum(), open[set]]
        };
        let points: Vec<[Vec3; 2]> = self.plane.open().par_iter().enumerate().map(at).collect();
        let share = |[reaching, open]: &[Vec3; 2]| {
            let share = |k: usize| if open[k] > 0.0 { reaching[k] / open[k] } else { 1.0 };
            self.open * Vec3::from([0, 1, 2].map(share))
        };
        self.reaching = means(&means(&points, 1), POINTS).iter().map(share).collect();
    }

    /// Irradiance of the sky that reaches a point.
    fn sky_at(&self, point: Vec3) -> Vec3 {
        if self.reaching.is_empty() {
            return self.open;
        }
        let GroundPlane { middle, axes, half_edge, .. } = &*self.plane;
        let from_middle = point - *middle;
        let place = Vec2::new(axes[0].dot(from_middle), axes[1].dot(from_middle)) / *half_edge;
        let outwards = place.abs().max_element();
        if outwards >= 1.0 {
            return self.open;
        }
        let at = 0.5 * (place + 1.0) * (POINTS - 1) as f32;
        let [column, row] = [at.x, at.y].map(|x| (x as usize).min(POINTS - 2));
        let [right, down] = [at.x - column as f32, at.y - row as f32];
        let number = |column: usize, row: usize| self.reaching[row * POINTS + column];
        let upper = number(column, row).lerp(number(column + 1, row), right);
        let lower = number(column, row + 1).lerp(number(column + 1, row + 1), right);
        let fade = ((outwards - FADE) / (1.0 - FADE)).clamp(0.0, 1.0);
        upper.lerp(lower, down).lerp(self.open, fade * fade * (3.0 - 2.0 * fade))
    }

    /// Share of the light that reaches a point, seen in the pixel of a column and a row.
    fn share_at(&self, point: Vec3, [column, row]: [f32; 2]) -> Vec3 {
        let GroundPlane { up, occluder, .. } = &*self.plane;
        let (mut open, mut reaching) = (self.open, self.sky_at(point));
        for (index, GroundLamp { numbers, rays }) in self.lamps.iter().enumerate() {
            let seen = toward(&LampOf::from_array(*numbers), point.into(), (*up).into());
            let height = horizon(up.dot(Vec3::from(seen.direction)), seen.sine);
            let light = Vec3::from(seen.irradiance) * height;
            let (axes, shift) = (disc_axes(seen.direction), shift(column, row, index as f32));
            let (mut all, mut arriving) = (0.0, 0.0);
            for place in &self.spiral[..*rays] {
                let ray = shadow_ray((*up).into(), &seen, axes, &shift, *place);
                all += ray.weight;
                if ray.weight > 0.0 && !occluder.is_blocked(point.into(), ray.direction, seen.reach) {
                    arriving += ray.weight;
                }
            }
            open += light;
            reaching += light * seen_share(all, arriving);
        }
        let share = |k: usize| if open[k] > 0.0 { (reaching[k] / open[k]).clamp(0.0, 1.0) } else { 1.0 };
        Vec3::from([0, 1, 2].map(share))
    }

    /// Share of the light that shadows leave in each pixel of a camera, red, green and blue, row by
    /// row; 1 where the camera does not see the ground.
    pub fn shares(&self, camera: &Camera) -> Vec<[f32; 3]> {
        let world_from_camera = camera.camera_from_world.transpose();
        let GroundPlane { up, middle, .. } = &*self.plane;
        let height = up.dot(*middle - camera.position);
        let share = |index: u32| {
            let [column, row] = [index % camera.width, index / camera.width].map(|pixel| pixel as f32);
            let ray = world_from_camera * camera.ray_in_camera(column + 0.5, row + 0.5);
            let slope = up.dot(ray);
            if height >= 0.0 || slope >= 0.0 {
                return [1.0; 3];
            }
            self.share_at(camera.position + ray * (height / slope), [column, row]).to_array()
        };
        (0..camera.width * camera.height).into_par_iter().map(share).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backdrop::{Backdrop, BackgroundColor};
    use specula_core::near_field::NearField;
    use specula_core::{
        cubemap::FACE_COUNT,
        scene::{Image, RadianceActivation},
    };
    use specula_mesh::{Mesh, near_field::SurfaceMeans};

    /// Square of this half edge at a height above the origin, whose front is below.
    fn roof(half: f32, height: f32) -> NearField<Vec<f32>> {
        square(half, height, [[0, 2, 1], [0, 3, 2]])
    }

    fn square(half: f32, height: f32, triangles: [[u32; 3]; 2]) -> NearField<Vec<f32>> {
        let positions = [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]];
        let mesh = Mesh {
            positions: positions.to_vec(),
            normals: vec![[0.0, 0.0, -1.0]; 4],
            colors: vec![[0.5; 3]; 4],
            triangles: triangles.to_vec(),
        };
        SurfaceMeans::new(mesh, 0.01).near_field().expect("there are triangles")
    }

    fn sky(radiance: f32) -> Environment<Vec<f32>> {
        let values = vec![radiance; 3 * FACE_COUNT * 16 * 16];
        Environment { resolution: 16, activation: RadianceActivation::Identity, values }
    }

    fn sun(direction: [f32; 3]) -> SceneLamps {
        let lamp = Lamp::Sun { direction, irradiance: [2.0; 3], diameter: 0.0 };
        SceneLamps { lamps: vec![lamp], rays: 1, occluder: None }
    }

    /// Ground at height 0, or at the lowest point.
    fn ground_below(
        occluder: &NearField<Vec<f32>>,
        height: Option<f32>,
        sky: Option<&Environment<Vec<f32>>>,
        lamps: Option<&SceneLamps>,
    ) -> Ground {
        Ground::new(GroundPlane::new(Surface::shared(occluder.clone()), Vec3::Z, height).unwrap(), sky, lamps)
    }

    /// Below a square of half edge a at a height of h the sky is hidden as the form factor says:
    /// (4/π) (a / √(a² + h²)) atan(a / √(a² + h²)).
    #[test]
    fn a_roof_hides_the_sky_by_its_form_factor() {
        let (half, height) = (1.0_f32, 0.5_f32);
        let ground = ground_below(&roof(half, height), Some(0.0), Some(&sky(0.7)), None);
        let slant = half / half.hypot(height);
        let hidden = 4.0 / core::f32::consts::PI * slant * slant.atan();
        let found = ground.share_at(Vec3::ZERO, [0.0; 2]);
        // Of some hundred directions.
        assert!((found.x - (1.0 - hidden)).abs() < 0.02, "{found} rather than {}", 1.0 - hidden);
        assert_eq!(ground.share_at(Vec3::new(40.0, 0.0, 0.0), [0.0; 2]), Vec3::ONE, "far away nothing is hidden");
    }

    /// Below a roof of half edge 1 the shadow of a small light in the zenith is dark in the middle and light outside, and
    /// falls to light over its penumbra in small steps.
    #[test]
    fn shadows_of_a_small_light_in_the_sky_are_smooth() {
        const EDGE: usize = 16;
        let lit = |texel: usize| {
            texel / (EDGE * EDGE) == 4 && [texel / EDGE % EDGE, texel % EDGE].iter().all(|k| (6..10).contains(k))
        };
        let values = (0..FACE_COUNT * EDGE * EDGE).flat_map(|texel| [if lit(texel) { 30.0 } else { 0.0 }; 3]).collect();
        let lamp = Environment { resolution: EDGE, activation: RadianceActivation::Identity, values };
        let ground = ground_below(&roof(1.0, 1.0), Some(0.0), Some(&lamp), None);
        let shares: Vec<f32> =
            (0..100).map(|k| ground.share_at(Vec3::new(0.02 * k as f32, 0.1, 0.0), [0.0; 2]).x).collect();
        assert!(shares[0] == 0.0 && shares[99] == 1.0, "{shares:?}");
        let largest = shares.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f32::max);
        assert!(largest < 0.1, "a step of {largest} in {shares:?}");
    }

    #[test]
    fn shadows_of_suns_match_geometry() {
        let roof = roof(1.0, 2.0);
        let lamps = sun([1.0, 0.0, 1.0]);
        let ground = ground_below(&roof, Some(0.0), None, Some(&lamps));
        // Moved by the height, away from the sun.
        for (x, expected) in [(-3.1, 1.0), (-2.9, 0.0), (-1.1, 0.0), (-0.9, 1.0), (0.0, 1.0)] {
            assert_eq!(ground.share_at(Vec3::new(x, 0.0, 0.0), [3.0, 4.0]), Vec3::splat(expected), "{x}");
        }
        let both = ground_below(&roof, Some(0.0), Some(&sky(1.0)), Some(&lamps));
        let shadowed = both.share_at(Vec3::new(-2.0, 0.0, 0.0), [0.0; 2]).x;
        assert!(shadowed > 0.4 && shadowed < 0.75, "the sky lights the shadow: {shadowed}");
        let with = SceneLamps { occluder: Some(Surface::shared(roof.clone())), ..sun([0.0, 0.0, -1.0]) };
        let below = ground_below(&roof, None, None, Some(&with));
        assert_eq!(below.plane.middle.z, 2.0, "at the lowest point");
        assert_eq!(below.share_at(Vec3::ZERO, [0.0; 2]), Vec3::ONE, "no light, no shadow");
    }

    #[test]
    fn back_faces_also_block_light() {
        let open_below = square(1.0, 2.0, [[0, 1, 2], [0, 2, 3]]);
        let ground = ground_below(&open_below, Some(0.0), None, Some(&sun([0.0, 0.0, 1.0])));
        assert_eq!(ground.share_at(Vec3::ZERO, [0.0; 2]), Vec3::ZERO);
        assert_eq!(ground.share_at(Vec3::new(1.5, 0.0, 0.0), [0.0; 2]), Vec3::ONE);
    }

    #[test]
    fn cameras_see_the_ground_only_from_above() {
        let ground = ground_below(&roof(1.0, 2.0), Some(0.0), None, Some(&sun([0.0, 0.0, 1.0])));
        let above = Camera::look_at(Vec3::new(4.0, 0.0, 3.0), Vec3::ZERO, Vec3::Z, 0.8, 32, 24);
        let shares = ground.shares(&above);
        assert!(shares.contains(&[0.0; 3]) && shares.contains(&[1.0; 3]));
        let below = Camera::look_at(Vec3::new(4.0, 0.0, -3.0), Vec3::ZERO, Vec3::Z, 0.8, 32, 24);
        assert!(ground.shares(&below).iter().all(|share| *share == [1.0; 3]));
    }

    #[test]
    fn a_transparent_shadow_over_white_matches_a_shadow_on_white() {
        /// Rounding of alpha and of the result to 8 bits.
        const ROUNDING: f32 = 1.5;
        let light = sky(0.7);
        let ground = Arc::new(ground_below(&roof(0.5, 0.3), Some(0.0), Some(&light), None));
        let camera = Camera::look_at(Vec3::new(4.0, 0.0, 3.0), Vec3::ZERO, Vec3::Z, 0.8, 32, 24);
        let size = (camera.width * camera.height) as usize;
        // Nothing but the ground.
        let values = [vec![0.0; 3 * size], vec![1.0; size]].concat();
        let image = Image { width: 32, height: 24, channels: 4, values };
        let on = |behind: Backdrop| Backdrop::Ground(Box::new(behind), ground.clone()).picture(&image, &camera);
        let (clear, white) =
            (on(Backdrop::Transparent).into_rgba8(), on(Backdrop::Color(BackgroundColor::WHITE)).into_rgb8());
        assert!(clear.pixels().any(|pixel| pixel.0[3] > 30), "there is a shadow");
        assert!(clear.pixels().any(|pixel| pixel.0[3] == 0), "and an end of it");
        for (clear, white) in clear.pixels().zip(white.pixels()) {
            let [r, g, b, alpha] = clear.0.map(f32::from);
            assert_eq!([r, g, b], [0.0; 3], "shadows are black");
            assert!((255.0 - alpha - f32::from(white.0[0])).abs() <= ROUNDING, "{clear:?} on white is not {white:?}");
        }
    }
}
