//! Ground below a scene that catches its shadows: a plane of the background's colour, as bright as
//! the share of the light that the scene does not block.
//!
//! The share is (E_s + Σ_l V_l E_l H_l) / (E_o + Σ_l E_l H_l), channel by channel, with the
//! irradiance E_o of the sky above the open plane, the part E_s of it that passes the scene, and of
//! each lamp the irradiance E_l H_l ([`mod@specula_core::lamps`]) and the share V_l that is seen.

use crate::lamps::SceneLamps;
use glam::{Vec2, Vec3};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    cubemap::{FACE_COUNT, texel_direction, texel_index, texel_of_index, texel_solid_angle},
    lamps::{Lamp, LampOf, disc_axes, horizon, seen_share, shadow_ray, shift, spiral_point, toward},
    near_field::T_MISS,
    scene::Environment,
};
use specula_mesh::{sky::Sky, surface::Surface};
use std::sync::{Arc, OnceLock};

/// Cells along an edge of a part of the sky. Neighbouring points, in squares of this edge, look at
/// different cells, and the light is the mean over such a square: interleaved sampling (Keller and
/// Heidrich 2001).
const CELLS: usize = 4;
/// Weights of neighbours along a row or a column, in which all cells of a part have equal weights.
const MEAN: [f32; CELLS + 1] = [0.125, 0.25, 0.25, 0.25, 0.125];
/// Parts along an edge of a face of the sky: large ones, and those of a large one with a bright
/// cell, which would cast few sharp shadows otherwise.
const PARTS: [usize; 2] = [4, 4 * CELLS];
/// Share of the light of the whole sky from which a cell is bright.
const BRIGHT: f32 = 1.0 / 256.0;
/// Points along an edge of the square at which the light of the sky is computed; it is interpolated
/// between them.
const POINTS: usize = 192;
/// Edge of the square, in widths of the scene. Shadows of the sky fade towards it.
const WIDTHS: f32 = 4.0;
/// Share of the square's half edge within which shadows of the sky do not fade.
const FADE: f32 = 0.7;

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
    /// Bits of the points of the square, row by row, at which each part of the sky is open; traced
    /// on first use.
    open: Vec<OnceLock<Vec<u64>>>,
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
        let open = (0..Part::COUNT).map(|_| OnceLock::new()).collect();
        Some(Arc::new(Self { up, middle, axes, half_edge, occluder, open }))
    }

    /// Point of the ground at a column and a row of the square.
    fn point_of(&self, place: [f32; 2]) -> Vec3 {
        let [x, y] = place.map(|k| (2.0 * k / (POINTS - 1) as f32 - 1.0) * self.half_edge);
        self.middle + x * self.axes[0] + y * self.axes[1]
    }

    /// Bits of the points at which a part of the sky is open.
    fn open(&self, part: Part) -> &[u64] {
        let trace = || {
            let directions: [Vec3; CELLS * CELLS] = core::array::from_fn(|cell| part.direction(cell));
            let is_open = |index: usize| {
                let point = self.point_of([index % POINTS, index / POINTS].map(|k| k as f32));
                let direction = directions[cell_of(index)];
                direction.dot(self.up) > 0.0 && !self.occluder.is_blocked(point.into(), direction.into(), T_MISS)
            };
            let word = |word: usize| (0..64).fold(0, |bits, k| bits | u64::from(is_open(64 * word + k)) << k);
            (0..POINTS * POINTS / 64).into_par_iter().map(word).collect()
        };
        self.open[part.index()].get_or_init(trace)
    }
}

/// Square part of a face of the sky.
#[derive(Clone, Copy, Debug)]
struct Part {
    face: usize,
    column: usize,
    row: usize,
    /// Parts of its size along an edge of a face.
    size: usize,
}

impl Part {
    const LARGE: usize = FACE_COUNT * PARTS[0] * PARTS[0];
    const COUNT: usize = Self::LARGE + FACE_COUNT * PARTS[1] * PARTS[1];

    /// All large parts.
    fn large() -> impl Iterator<Item = Self> {
        let [size, _] = PARTS;
        (0..Self::LARGE).map(move |index| {
            let (face, column, row) = texel_of_index(index, size);
            Self { face, column, row, size }
        })
    }

    /// Parts as large as its cells.
    fn cells(self) -> impl Iterator<Item = Self> {
        (0..CELLS * CELLS).map(move |cell| {
            let [column, row] = self.place(cell);
            Self { column, row, size: CELLS * self.size, ..self }
        })
    }

    /// Number among all parts.
    fn index(self) -> usize {
        let first = if self.size == PARTS[0] { 0 } else { Self::LARGE };
        first + texel_index(self.face, self.column, self.row, self.size)
    }

    /// Column and row of a cell on its face.
    fn place(self, cell: usize) -> [usize; 2] {
        [CELLS * self.column + cell % CELLS, CELLS * self.row + cell / CELLS]
    }

    /// Direction of a cell.
    fn direction(self, cell: usize) -> Vec3 {
        let [column, row] = self.place(cell);
        Vec3::from(texel_direction(self.face, column, row, CELLS * self.size).map(|x| x as f32))
    }

    /// Irradiance of a plane by a part as bright as a cell of it.
    fn light(self, sky: &Sky, up: Vec3, cell: usize) -> Vec3 {
        let [column, row] = self.place(cell);
        let solid_angle = (CELLS * CELLS) as f64 * texel_solid_angle(column, row, CELLS * self.size);
        let direction = self.direction(cell);
        sky.radiance(direction) * (direction.dot(up).max(0.0) * solid_angle as f32)
    }
}

/// Cell of each part of the sky that a point of the square looks at.
fn cell_of(point: usize) -> usize {
    point / POINTS % CELLS * CELLS + point % POINTS % CELLS
}

/// Means of neighbouring points along rows or columns, whose points are `stride` apart.
fn means(points: &[[Vec3; 2]], stride: usize) -> Vec<[Vec3; 2]> {
    const BESIDE: usize = CELLS / 2;
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
        let lit = |part: Part| {
            let lights: [Vec3; CELLS * CELLS] = core::array::from_fn(|cell| part.light(sky, self.plane.up, cell));
            (part, lights)
        };
        let large: Vec<_> = Part::large().map(lit).collect();
        let all: Vec3 = large.iter().flat_map(|(_, lights)| lights).sum();
        if all == Vec3::ZERO {
            return;
        }
        let is_bright = |light: &Vec3| light.element_sum() > BRIGHT * all.element_sum();
        let divided = |(part, lights): (Part, [Vec3; CELLS * CELLS])| match lights.iter().any(is_bright) {
            true => part.cells().map(lit).collect(),
            false => vec![(part, lights)],
        };
        let parts = large.into_iter().flat_map(divided).filter(|(_, lights)| *lights != [Vec3::ZERO; CELLS * CELLS]);
        let parts: Vec<_> = parts.map(|(part, lights)| (self.plane.open(part), lights)).collect();
        self.open = parts.iter().flat_map(|(_, lights)| lights).sum::<Vec3>() / (CELLS * CELLS) as f32;
        let at = |point: usize| {
            let cell = cell_of(point);
            let add = |[reaching, open]: [Vec3; 2], (bits, lights): &(&[u64], [Vec3; CELLS * CELLS])| {
                let light = lights[cell];
                let is_open = bits[point / 64] >> (point % 64) & 1 == 1;
                [if is_open { reaching + light } else { reaching }, open + light]
            };
            parts.iter().fold([Vec3::ZERO; 2], add)
        };
        let points: Vec<[Vec3; 2]> = (0..POINTS * POINTS).into_par_iter().map(at).collect();
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
    use specula_core::scene::{Image, RadianceActivation};
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
        // Of some thousand directions.
        assert!((found.x - (1.0 - hidden)).abs() < 0.02, "{found} rather than {}", 1.0 - hidden);
        assert_eq!(ground.share_at(Vec3::new(40.0, 0.0, 0.0), [0.0; 2]), Vec3::ONE, "far away nothing is hidden");
    }

    /// Below a roof of half edge 1 the shadow of a small light in the zenith is dark in the middle
    /// and light outside, and becomes light over its penumbra in small steps.
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
