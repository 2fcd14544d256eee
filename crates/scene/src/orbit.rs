//! Cameras around a scene: turntables, spheres, and the first view of a viewer.

use crate::{
    framing::{FIELD_OF_VIEW_RAD, extent, framing},
    orientation::{centre, is_upright, up},
};
use core::f32::consts::{FRAC_PI_2, TAU};
use glam::Vec3;
use specula_core::{
    camera::{Camera, near_of},
    scene::Gaussians,
    sphere::directions,
};
use specula_io::{cameras::NamedCamera, orientation::Orientation};
use specula_train::view::extent_of_cameras;

pub use specula_mesh::fusion::evenly_spaced;

/// Width and height of pictures of a scene without cameras, in pixels.
pub(crate) const DEFAULT_SIZE: [u32; 2] = [800, 800];
/// Cameras in the orbit of a scene without cameras.
pub(crate) const DEFAULT_COUNT: u32 = 8;

/// Cameras of a turntable: a circle around the centre of a scene, at the mean elevation of its
/// known cameras. If these leave a gap of a quarter of the circle or more, the turntable goes back
/// and forth along the covered arc.
///
/// `size` is the width and height of pictures, in pixels. Intrinsics and near plane are those of
/// the first known camera if there is one, for any `size`. With `framed`, such as what a crop
/// keeps, the circle is around these Gaussians, which fill the pictures.
pub fn turntable(
    orientation: &Orientation,
    known: &[NamedCamera],
    count: u32,
    size: Option<[u32; 2]>,
    framed: Option<&Gaussians<Vec<f32>>>,
) -> Vec<NamedCamera> {
    let mut orbit = Orbit::new(orientation, known);
    if let Some(gaussians) = framed.filter(|gaussians| gaussians.count > 0) {
        orbit.frame(gaussians, known.first().map(|(_, camera)| camera));
    }
    let like = known.first().map(|(_, camera)| *camera);
    let camera_at = |index: u32| {
        let azimuth = orbit.azimuth_at(index as f32 / count as f32);
        (format!("{index:05}"), orbit.camera(azimuth, like, size))
    };
    (0..count).map(camera_at).collect()
}

/// Cameras evenly spread over a sphere around Gaussians, each of which sees all Gaussians.
pub fn sphere(gaussians: &Gaussians<Vec<f32>>, count: u32) -> Vec<Camera> {
    let (centre, distance) = framing(gaussians);
    let [width, height] = DEFAULT_SIZE;
    let camera = |direction: [f64; 3]| {
        let outwards = Vec3::from(direction.map(|x| x as f32));
        let up = outwards.any_orthonormal_vector();
        Camera::look_at(centre + outwards * distance, centre, up, FIELD_OF_VIEW_RAD, width, height)
    };
    let cameras: Vec<Camera> = directions(count as usize).map(camera).collect();
    let near = near_of(extent_of_cameras(cameras.iter()));
    cameras.into_iter().map(|camera| Camera { near, ..camera }).collect()
}

/// Near plane of cameras, in proportion to how far they spread.
pub(crate) fn near_plane(cameras: &[NamedCamera]) -> f32 {
    near_of(extent_of_cameras(cameras.iter().map(|(_, camera)| camera)))
}

/// First view of free navigation in a scene.
#[derive(Debug)]
pub struct StartView {
    /// Known cameras of the scene, with a common near plane.
    pub known: Vec<NamedCamera>,
    /// Index of the known camera to start from: the first with an upright picture; none if most
    /// pictures are on their side.
    pub first: Option<usize>,
    /// Upright camera to start from if `first` is none.
    pub start: Camera,
    /// Centre of the scene.
    pub centre: Vec3,
    /// Up direction, a unit vector.
    pub up: Vec3,
}

impl StartView {
    /// First view of a scene with these known cameras, if any.
    pub fn new(orientation: &Orientation, mut known: Vec<NamedCamera>) -> Self {
        let orbit = Orbit::new(orientation, &known);
        let around: Vec<Camera> = (0..DEFAULT_COUNT)
            .map(|index| orbit.camera(TAU * index as f32 / DEFAULT_COUNT as f32, None, None))
            .collect();
        let near = match known.is_empty() {
            true => near_of(extent_of_cameras(around.iter())),
            false => near_plane(&known),
        };
        known.iter_mut().for_each(|(_, camera)| camera.near = near);
        let upright = known.iter().position(|(_, camera)| is_upright(orientation, camera));
        let first = upright.filter(|_| 2 * orientation.rolled <= orientation.cameras);
        let start = known.first().map_or(around[0], |(_, camera)| levelled(camera, orbit.up));
        Self { start: Camera { near, ..start }, known, first, centre: orbit.centre, up: orbit.up }
    }
}

/// Camera rolled about its view so that `up` points up in its picture, which is as tall as it was
/// held; unchanged for a view along up.
fn levelled(camera: &Camera, up: Vec3) -> Camera {
    let forward = camera.camera_from_world.row(2);
    if forward.cross(up).length() < 1e-3 {
        return *camera;
    }
    let camera = camera.upright(up);
    let [width, height] = [camera.width, camera.height];
    let level = Camera::look_at(camera.position, camera.position + forward, up, FIELD_OF_VIEW_RAD, width, height);
    Camera { camera_from_world: level.camera_from_world, ..camera }
}

/// Circle around a scene.
struct Orbit {
    centre: Vec3,
    up: Vec3,
    distance: f32,
    /// Angle above the horizon, in radians.
    elevation: f32,
    /// Part of the circle that known cameras cover; none for the whole circle.
    arc: Option<Arc>,
}

/// Arc of a circle, in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Arc {
    start: f32,
    len: f32,
}

impl Arc {
    /// Complement of the widest gap between angles, if that gap is a quarter of the circle or more
    /// and three times as wide as the mean gap: an obstacle, or a side that was not photographed.
    fn of(mut angles: Vec<f32>) -> Option<Self> {
        angles.sort_by(f32::total_cmp);
        let next = |k: usize| angles.get(k + 1).copied().unwrap_or(angles[0] + TAU);
        let gaps = (0..angles.len()).map(|k| (next(k) - angles[k], next(k)));
        let (gap, start) = gaps.max_by(|(one, _), (other, _)| one.total_cmp(other))?;
        let least = FRAC_PI_2.max(3.0 * TAU / angles.len() as f32);
        (gap >= least).then_some(Self { start, len: TAU - gap })
    }
}

impl Orbit {
    fn new(orientation: &Orientation, known: &[NamedCamera]) -> Self {
        /// Elevation without known cameras, in radians.
        const DEFAULT_ELEVATION_RAD: f32 = 0.4;
        const ELEVATION_MAX_RAD: f32 = 1.0;
        let (centre, up, distance) = (centre(orientation), up(orientation), orientation.distance as f32);
        if known.is_empty() {
            return Self { centre, up, distance, elevation: DEFAULT_ELEVATION_RAD, arc: None };
        }
        let share = 1.0 / known.len() as f32;
        let height = share * known.iter().map(|(_, camera)| up.dot(camera.position - centre)).sum::<f32>();
        let elevation =
            (height / distance.max(f32::MIN_POSITIVE)).clamp(-1.0, 1.0).asin().clamp(0.0, ELEVATION_MAX_RAD);
        let orbit = Self { centre, up, distance, elevation, arc: None };
        Self { arc: Arc::of(known.iter().filter_map(|(_, camera)| orbit.azimuth_of(camera)).collect()), ..orbit }
    }

    /// Moves the circle around Gaussians, at the distance from which a camera sees all of them.
    fn frame(&mut self, gaussians: &Gaussians<Vec<f32>>, like: Option<&Camera>) {
        const MARGIN: f32 = 1.15;
        let (centre, radius) = extent(gaussians);
        let half_angle = like.map_or(0.5 * FIELD_OF_VIEW_RAD, |camera| {
            let edges = [(camera.width, camera.focal_px[0]), (camera.height, camera.focal_px[1])];
            edges.map(|(edge, focal)| (0.5 * edge as f32 / focal).atan()).into_iter().fold(f32::INFINITY, f32::min)
        });
        (self.centre, self.distance) = (centre, MARGIN * radius / half_angle.sin());
    }

    /// Azimuth in radians of a camera near the circle's elevation and outside of the circle; `None`
    /// for others, which do not resemble views from the circle.
    fn azimuth_of(&self, camera: &Camera) -> Option<f32> {
        /// Largest difference of elevation, in radians.
        const ELEVATION_TOLERANCE_RAD: f32 = 0.35;
        /// Smallest distance from the centre, relative to the circle's.
        const DISTANCE_MIN: f32 = 0.9;
        let from_centre = camera.position - self.centre;
        let distance = from_centre.length();
        let elevation = (self.up.dot(from_centre) / distance).clamp(-1.0, 1.0).asin();
        let is_near =
            (elevation - self.elevation).abs() <= ELEVATION_TOLERANCE_RAD && distance >= DISTANCE_MIN * self.distance;
        let [x, y] = horizon(self.up).map(|axis| axis.dot(from_centre));
        is_near.then(|| y.atan2(x))
    }

    /// Azimuth at a time of a turntable, from 0 to 1, in radians: uniform around the circle, or
    /// sinusoidal between the ends of the arc, from its middle.
    fn azimuth_at(&self, time: f32) -> f32 {
        match self.arc {
            None => TAU * time,
            Some(Arc { start, len }) => start + len * 0.5 * (1.0 + (TAU * time).sin()),
        }
    }

    /// Camera on the circle that looks at the centre, with the intrinsics of `like`.
    fn camera(&self, azimuth: f32, like: Option<Camera>, size: Option<[u32; 2]>) -> Camera {
        let [east, north] = horizon(self.up);
        let outwards = east * azimuth.cos() + north * azimuth.sin();
        let direction = outwards * self.elevation.cos() + self.up * self.elevation.sin();
        let [width, height] = size.unwrap_or(DEFAULT_SIZE);
        let up = if self.elevation < FRAC_PI_2 { self.up } else { outwards };
        let camera =
            Camera::look_at(self.centre + direction * self.distance, self.centre, up, FIELD_OF_VIEW_RAD, width, height);
        match like {
            Some(like) => Camera { camera_from_world: camera.camera_from_world, position: camera.position, ..like },
            None => camera,
        }
    }
}

/// Two orthonormal directions perpendicular to `up`; azimuths count from the first.
fn horizon(up: Vec3) -> [Vec3; 2] {
    let east = up.any_orthonormal_vector();
    [east, up.cross(east)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::estimate;
    use glam::Mat3;
    use specula_core::scene::{Layout, MEAN, len_of_values};

    /// Cameras in a circle, most pictures or some of them turned by 90°.
    fn circle(rolled: usize) -> Vec<NamedCamera> {
        let camera = |k: usize| {
            let (sin, cos) = (k as f32).sin_cos();
            let upright = Camera::look_at(Vec3::new(4.0 * cos, 4.0 * sin, 2.0), Vec3::ZERO, Vec3::Z, 0.7, 90, 60);
            let turn = if k < rolled { Mat3::from_rotation_z(FRAC_PI_2) } else { Mat3::IDENTITY };
            (k.to_string(), Camera { camera_from_world: turn * upright.camera_from_world, ..upright })
        };
        (0..9).map(camera).collect()
    }

    #[test]
    fn a_view_of_another_size_is_not_stretched_or_cropped() {
        let view = Camera::look_at(Vec3::X * 4.0, Vec3::ZERO, Vec3::Z, 0.7, 90, 60);
        let off_centre = Camera { principal_px: [40.0, 33.0], ..view };
        for camera in [view, off_centre] {
            for [width, height] in [[640, 480], [48, 320], [90, 200]] {
                let framed = camera.framed(width, height);
                assert_eq!(framed.focal_px[0], framed.focal_px[1], "squares stay squares");
                let scale = framed.focal_px[0] / camera.focal_px[0];
                // The old picture's corners lie in the new picture, around its centre.
                let corner =
                    |axis: usize, pixels: f32| framed.principal_px[axis] + scale * (pixels - camera.principal_px[axis]);
                let [left, right] = [corner(0, 0.0), corner(0, 90.0)];
                let [top, bottom] = [corner(1, 0.0), corner(1, 60.0)];
                assert!(left >= -1e-3 && top >= -1e-3, "{framed:?}");
                assert!((left + right - width as f32).abs() < 1e-2 && (top + bottom - height as f32).abs() < 1e-2);
            }
        }
        assert_eq!(view.framed(90, 60), view);
        assert_eq!(view.framed(45, 30), view.resized(45, 30));
        // A photograph of 1000 x 667 pixels made half as large.
        let photograph = Camera { width: 1000, height: 667, ..view };
        assert_eq!(photograph.framed(500, 333), photograph.resized(500, 333), "rounded, not another shape");
    }

    #[test]
    fn a_turntable_frames_what_is_kept() {
        let middle = Vec3::new(1.0, 2.0, 0.5);
        let layout = Layout::radiance(0);
        let mut gaussians = Gaussians { count: 200, layout, values: vec![0.0; len_of_values(200, layout)] };
        for (index, direction) in directions(200).enumerate() {
            gaussians.set(index, MEAN, (middle + 0.2 * Vec3::from(direction.map(|x| x as f32))).to_array());
        }
        let known = circle(0);
        let orientation = estimate(known.iter().map(|(_, camera)| camera), &[]).expect("there are cameras");
        for (_, camera) in turntable(&orientation, &known, 6, None, Some(&gaussians)) {
            let places = (0..200).map(|index| {
                let place = camera.camera_from_world * (Vec3::from(gaussians.get::<3>(index, MEAN)) - camera.position);
                camera.principal_px[1] + camera.focal_px[1] * place.y / place.z
            });
            let (top, bottom) = places.fold((f32::MAX, f32::MIN), |(top, bottom), y| (top.min(y), bottom.max(y)));
            let height = camera.height as f32;
            assert!(top > 0.0 && bottom < height && bottom - top > 0.7 * height, "{top} to {bottom} of {height}");
        }
    }

    #[test]
    fn the_first_view_is_upright_even_if_pictures_are_rolled() {
        for (rolled, first) in [(0, Some(0)), (2, Some(2)), (8, None)] {
            let known = circle(rolled);
            let orientation = estimate(known.iter().map(|(_, camera)| camera), &[]).unwrap();
            let around = StartView::new(&orientation, known.clone());
            assert_eq!((around.first, around.up), (first, Vec3::Z), "{rolled} pictures on their side");
            let [right, down, forward] = [0, 1, 2].map(|k| around.start.camera_from_world.row(k));
            assert!(right.z.abs() < 1e-6 && down.z < 0.0, "the horizon is level, and the sky above");
            let size = if rolled > 0 { [60, 90] } else { [90, 60] };
            assert_eq!([around.start.width, around.start.height], size, "pictures on their side are tall");
            assert!(
                forward.distance(known[0].1.camera_from_world.row(2)) < 1e-6,
                "the view direction is that of the first camera"
            );
            let cameras = turntable(&orientation, &known, 8, None, None);
            assert!(cameras.iter().all(|(_, camera)| camera.camera_from_world.row(0).z.abs() < 1e-6));
            assert!(around.centre.length() < 1e-5 && (cameras[0].1.position.length() - 20.0_f32.sqrt()).abs() < 1e-4);
        }
    }

    #[test]
    fn a_turntable_swings_if_cameras_leave_a_large_gap() {
        let all_around = circle(0);
        let [start, len] = [2.5_f32, 3.0];
        let side: Vec<NamedCamera> = (0..20)
            .map(|k| {
                let (sin, cos) = (start + len * k as f32 / 19.0).sin_cos();
                let eye = Vec3::new(4.0 * cos, 4.0 * sin, 2.0);
                (k.to_string(), Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.7, 90, 60))
            })
            .collect();
        // Views from above and from close by do not resemble views from the circle.
        let [above, close] = [Vec3::new(0.4, 0.1, 4.4), Vec3::new(1.5, 0.5, 0.8)];
        let others = [above, close].map(|eye| Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.7, 90, 60));
        let side: Vec<NamedCamera> =
            side.into_iter().chain(others.map(|camera| ("other".to_owned(), camera))).collect();
        let angles = |known: &[NamedCamera]| {
            let orientation = estimate(known.iter().map(|(_, camera)| camera), &[]).unwrap();
            let cameras = turntable(&orientation, known, 12, None, None);
            let angle = |camera: &Camera| camera.position.y.atan2(camera.position.x).rem_euclid(TAU);
            cameras.iter().map(|(_, camera)| angle(camera)).collect::<Vec<f32>>()
        };
        let widest = |mut angles: Vec<f32>| {
            angles.sort_by(f32::total_cmp);
            angles.windows(2).map(|pair| pair[1] - pair[0]).fold(angles[0] + TAU - angles[11], f32::max)
        };
        assert!((widest(angles(&all_around)) - TAU / 12.0).abs() < 1e-4, "evenly around");
        let turns = angles(&side);
        assert!(turns.iter().all(|turn| (start - 1e-3..start + len + 1e-3).contains(turn)), "{turns:?}");
        let [middle, last] = [start + 0.5 * len, start + len];
        for (k, expected) in [(0, middle), (3, last), (6, middle), (9, start)] {
            assert!((turns[k] - expected).abs() < 1e-3, "from the middle to both ends: {turns:?}");
        }
        assert!((turns[1] - turns[5]).abs() < 1e-4, "and back the same way");
    }

    #[test]
    fn a_few_evenly_spread_cameras_leave_no_gap() {
        for count in [1, 3, 8] {
            let angles = (0..count).map(|k| 0.3 + TAU * k as f32 / count as f32).collect();
            assert_eq!(Arc::of(angles), None, "{count} cameras, evenly spread");
        }
        assert_eq!(Arc::of(Vec::new()), None);
    }
}
