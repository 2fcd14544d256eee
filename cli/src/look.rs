//! From where a scene is looked at: the model's own cameras, those of a file, or a circle around it.

use crate::{
    args::{Look, Split},
    failure::Failure,
    orientation,
};
use core::f32::consts::{FRAC_PI_2, TAU};
use glam::Vec3;
use specula_core::{
    camera::{Camera, near_of},
    scene::{Gaussians, MEAN},
    sphere::directions,
};
use specula_io::{
    cameras::{self, NamedCamera},
    orientation::Orientation,
};
use specula_scene::{OpenedModel, orientation::is_upright};
use specula_train::view::extent_of_cameras;

/// Pixels of a picture where nothing says otherwise.
const SIZE: [u32; 2] = [800, 800];
/// Cameras around a scene of which no camera is known.
const ORBIT: u32 = 8;
/// Horizontal field of view of such cameras, in radians: that of NeRF Synthetic.
const FIELD_OF_VIEW: f32 = 0.691_111_2;

/// Cameras to render, and what they are called together.
#[derive(Debug)]
pub(crate) struct Tour {
    pub(crate) name: &'static str,
    pub(crate) cameras: Vec<NamedCamera>,
    /// Which views of the data set they are; none where they are not of it.
    pub(crate) split: Option<Split>,
    /// Whether the pictures are an animation.
    pub(crate) is_turntable: bool,
    /// Size that was asked for, where it is not that of the views.
    pub(crate) other_size: Option<[u32; 2]>,
}

impl Tour {
    /// The cameras that were asked for, or those that fit best.
    pub(crate) fn choose(look: &Look, opened: &OpenedModel) -> Result<Self, Failure> {
        let mut tour = Self::unsized_tour(look, opened)?;
        tour.set_near(own_cameras(opened)?);
        if let Some(size @ [width, height]) = look.size {
            let is_other = tour.cameras.iter().any(|(_, camera)| [camera.width, camera.height] != size);
            tour.other_size = is_other.then_some(size);
            tour.cameras.iter_mut().for_each(|(_, camera)| *camera = camera.framed(width, height));
        }
        Ok(tour)
    }

    /// The cameras of a scene's test views, else all of its own, else a circle around it.
    pub(crate) fn of_scene(opened: &OpenedModel) -> Result<Vec<Camera>, Failure> {
        let own = own_cameras(opened)?;
        let mut tour = match own.clone() {
            Some(own) => Self::of_split(None, own, opened)?,
            None => Self::around(&orientation::of(opened, None)?, &[], ORBIT, None),
        };
        tour.set_near(own);
        Ok(tour.cameras.into_iter().map(|(_, camera)| camera).collect())
    }

    /// The cameras that a scene was fitted to: those that are not its test views, where it says which, else all of its own.
    pub(crate) fn fitted(opened: &OpenedModel) -> Result<Option<Vec<Camera>>, Failure> {
        let Some(own) = own_cameras(opened)? else { return Ok(None) };
        let tests = opened.test_views().filter(|count| *count < own.len()).unwrap_or(0);
        let mut tour =
            Self { name: "fitted", cameras: own[tests..].to_vec(), split: None, is_turntable: false, other_size: None };
        tour.set_near(Some(own));
        Ok(Some(tour.cameras.into_iter().map(|(_, camera)| camera).collect()))
    }

    /// Cameras all around a scene, evenly spread over a sphere: for what has to be seen from everywhere.
    pub(crate) fn sphere(gaussians: &Gaussians<Vec<f32>>, count: u32) -> Vec<Camera> {
        let (centre, distance) = whole(gaussians);
        let [width, height] = SIZE;
        let camera = |direction: [f64; 3]| {
            let outwards = Vec3::from(direction.map(|x| x as f32));
            let up = outwards.any_orthonormal_vector();
            Camera::look_at(centre + outwards * distance, centre, up, FIELD_OF_VIEW, width, height)
        };
        let cameras: Vec<Camera> = directions(count as usize).map(camera).collect();
        let near = near_of(extent_of_cameras(cameras.iter()));
        cameras.into_iter().map(|camera| Camera { near, ..camera }).collect()
    }

    /// The near plane that fits how far the scene's own cameras spread, or these, if it has none.
    fn set_near(&mut self, own: Option<Vec<NamedCamera>>) {
        let of = |cameras: &[NamedCamera]| near_of(extent_of_cameras(cameras.iter().map(|(_, camera)| camera)));
        let near = of(own.as_deref().unwrap_or(&self.cameras));
        self.cameras.iter_mut().for_each(|(_, camera)| camera.near = near);
    }

    fn unsized_tour(look: &Look, opened: &OpenedModel) -> Result<Self, Failure> {
        if let Some(file) = &look.cameras {
            let cameras = cameras::read_cameras(file, look.size.unwrap_or(SIZE))?;
            return Ok(Self { name: "cameras", cameras, split: None, is_turntable: false, other_size: None });
        }
        let own = own_cameras(opened)?;
        let around = |own: &[NamedCamera], count| {
            Ok(Self::around(&orientation::of(opened, look.showing.scene_up)?, own, count, look.size))
        };
        match (look.turntable, own) {
            (Some(count), own) => around(&own.unwrap_or_default(), count),
            (None, Some(own)) => Self::of_split(look.split, own, opened),
            (None, None) if look.split.is_some() => Err(Failure::Input(
                "the scene has no cameras for --split; name some with --cameras, or use --turntable".into(),
            )),
            (None, None) => around(&[], ORBIT),
        }
    }

    /// The model's cameras, which are listed test views first.
    fn of_split(asked: Option<Split>, mut own: Vec<NamedCamera>, opened: &OpenedModel) -> Result<Self, Failure> {
        let test_count = opened.test_views().map(|count| count.min(own.len()));
        let usual = if test_count.is_some_and(|count| count > 0) { Split::Test } else { Split::All };
        let split = asked.unwrap_or(usual);
        match (split, test_count) {
            (Split::All, _) => {}
            (_, None) => {
                return Err(Failure::Input(
                    "the model does not say which of its cameras are test views; use --split all or --cameras".into(),
                ));
            }
            (Split::Test, Some(count)) => own.truncate(count),
            (Split::Train, Some(count)) => drop(own.drain(..count)),
        }
        if own.is_empty() {
            let name = split.name();
            return Err(Failure::Input(format!("the model has no {name} views; use --split all or --cameras")));
        }
        Ok(Self { name: split.name(), cameras: own, split: Some(split), is_turntable: false, other_size: None })
    }

    /// A circle, as high above the scene as the known cameras are in the mean; or, where these leave much of it out, to and
    /// fro along the rest.
    pub(crate) fn around(orientation: &Orientation, known: &[NamedCamera], count: u32, size: Option<[u32; 2]>) -> Self {
        let orbit = Orbit::of(orientation, known);
        let like = known.first().map(|(_, camera)| *camera);
        let camera_at = |index: u32| {
            let turn = orbit.turn_after(index as f32 / count as f32);
            (format!("{index:05}"), orbit.camera(turn, like, size))
        };
        Self {
            name: "turntable",
            cameras: (0..count).map(camera_at).collect(),
            split: None,
            is_turntable: true,
            other_size: None,
        }
    }
}

/// Where one stands who wants to look around in a scene.
#[derive(Debug)]
pub(crate) struct Surroundings {
    /// The cameras that the scene knows.
    pub(crate) known: Vec<NamedCamera>,
    /// Which of them to begin with: the first whose picture is upright, unless most are on their side.
    pub(crate) first: Option<usize>,
    /// A camera to begin with where there is none such: upright.
    pub(crate) start: Camera,
    /// What the cameras look at.
    pub(crate) centre: Vec3,
    pub(crate) up: Vec3,
}

impl Surroundings {
    /// Of a scene with these orientation, and the cameras that are known with it.
    pub(crate) fn of(orientation: &Orientation, mut known: Vec<NamedCamera>) -> Self {
        let orbit = Orbit::of(orientation, &known);
        let around: Vec<Camera> =
            (0..ORBIT).map(|index| orbit.camera(TAU * index as f32 / ORBIT as f32, None, None)).collect();
        let near = match known.is_empty() {
            true => near_of(extent_of_cameras(around.iter())),
            false => near_of(extent_of_cameras(known.iter().map(|(_, camera)| camera))),
        };
        known.iter_mut().for_each(|(_, camera)| camera.near = near);
        let upright = known.iter().position(|(_, camera)| is_upright(orientation, camera));
        let first = upright.filter(|_| 2 * orientation.rolled <= orientation.cameras);
        let start = known.first().map_or(around[0], |(_, camera)| levelled(camera, orbit.up));
        Self { start: Camera { near, ..start }, known, first, centre: orbit.centre, up: orbit.up }
    }
}

/// The camera with what is above upwards in its picture, unless it looks there.
fn levelled(camera: &Camera, up: Vec3) -> Camera {
    let forward = camera.camera_from_world.row(2);
    if forward.cross(up).length() < 1e-3 {
        return *camera;
    }
    let [width, height] = [camera.width, camera.height];
    let level = Camera::look_at(camera.position, camera.position + forward, up, FIELD_OF_VIEW, width, height);
    Camera { camera_from_world: level.camera_from_world, ..*camera }
}

/// Cameras of a model's folder, test views first; none where it has none.
pub(crate) fn own_cameras(opened: &OpenedModel) -> Result<Option<Vec<NamedCamera>>, Failure> {
    let cameras = opened.cameras()?;
    Ok((!cameras.is_empty()).then_some(cameras))
}

/// A circle around a scene.
struct Orbit {
    centre: Vec3,
    up: Vec3,
    distance: f32,
    /// Above the horizon, in radians.
    elevation: f32,
    /// The part of the circle at which cameras stand; none where that is all of it.
    arc: Option<Arc>,
}

/// A part of a circle, in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Arc {
    start: f32,
    len: f32,
}

impl Arc {
    /// What is left of the circle without the widest gap between these angles, where that is a quarter of it or more and
    /// three times as wide as gaps are in the mean: there something stood in the way, or nobody went.
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
    fn of(orientation: &Orientation, known: &[NamedCamera]) -> Self {
        const ELEVATION: f32 = 0.4;
        const HIGHEST: f32 = 1.0;
        let (centre, up, distance) =
            (orientation::centre(orientation), orientation::up(orientation), orientation.distance as f32);
        if known.is_empty() {
            return Self { centre, up, distance, elevation: ELEVATION, arc: None };
        }
        let share = 1.0 / known.len() as f32;
        let height = share * known.iter().map(|(_, camera)| up.dot(camera.position - centre)).sum::<f32>();
        let elevation = (height / distance.max(f32::MIN_POSITIVE)).clamp(-1.0, 1.0).asin().clamp(0.0, HIGHEST);
        let orbit = Self { centre, up, distance, elevation, arc: None };
        Self { arc: Arc::of(known.iter().filter_map(|(_, camera)| orbit.angle_of(camera)).collect()), ..orbit }
    }

    /// At which angle a camera is, where it is about as high as the circle and not within it: what is seen from there is
    /// seen from the circle.
    fn angle_of(&self, camera: &Camera) -> Option<f32> {
        const AS_HIGH: f32 = 0.35;
        const AS_FAR: f32 = 0.9;
        let from_centre = camera.position - self.centre;
        let distance = from_centre.length();
        let elevation = (self.up.dot(from_centre) / distance).clamp(-1.0, 1.0).asin();
        let is_there = (elevation - self.elevation).abs() <= AS_HIGH && distance >= AS_FAR * self.distance;
        let [x, y] = horizon(self.up).map(|axis| axis.dot(from_centre));
        is_there.then(|| y.atan2(x))
    }

    /// Where one stands after a share of a turntable's way, as an angle: once around, or slowly turning back at the ends of
    /// the arc.
    fn turn_after(&self, share: f32) -> f32 {
        match self.arc {
            None => TAU * share,
            Some(Arc { start, len }) => start + len * 0.5 * (1.0 - (TAU * share).cos()),
        }
    }

    fn camera(&self, turn: f32, like: Option<Camera>, size: Option<[u32; 2]>) -> Camera {
        let [east, north] = horizon(self.up);
        let outwards = east * turn.cos() + north * turn.sin();
        let direction = outwards * self.elevation.cos() + self.up * self.elevation.sin();
        let [width, height] = size.unwrap_or(SIZE);
        let up = if self.elevation < FRAC_PI_2 { self.up } else { outwards };
        let camera =
            Camera::look_at(self.centre + direction * self.distance, self.centre, up, FIELD_OF_VIEW, width, height);
        match like {
            Some(like) => Camera { camera_from_world: camera.camera_from_world, position: camera.position, ..like },
            None => camera,
        }
    }
}

/// Two directions at right angles to `up` and each other, from which angles around it count.
fn horizon(up: Vec3) -> [Vec3; 2] {
    let east = up.any_orthonormal_vector();
    [east, up.cross(east)]
}

/// At most so many things, evenly spread over all.
pub(crate) fn evenly<T: Copy>(things: &[T], most: usize) -> Vec<T> {
    let count = things.len().min(most);
    (0..count).map(|k| things[(2 * k + 1) * things.len() / (2 * count)]).collect()
}

/// The middle of a scene, and the distance from which all of it is seen.
pub(crate) fn whole(gaussians: &Gaussians<Vec<f32>>) -> (Vec3, f32) {
    let (centre, radius) = middle(gaussians);
    (centre, 1.2 * radius / (0.5 * FIELD_OF_VIEW).sin())
}

/// The median of the means, and the distance from it within which nine of ten are.
fn middle(gaussians: &Gaussians<Vec<f32>>) -> (Vec3, f32) {
    const SHARE: f32 = 0.9;
    let median = |plane: usize| quantile(gaussians.plane(plane).collect(), 0.5);
    let centre = Vec3::new(median(MEAN), median(MEAN + 1), median(MEAN + 2));
    let distance = |index: usize| Vec3::from(gaussians.get::<3>(index, MEAN)).distance(centre);
    let radius = quantile((0..gaussians.count).map(distance).collect(), SHARE);
    (centre, if radius > 0.0 { radius } else { 1.0 })
}

fn quantile(mut numbers: Vec<f32>, share: f32) -> f32 {
    let Some(last) = numbers.len().checked_sub(1) else { return 0.0 };
    let place = (share * last as f32) as usize;
    *numbers.select_nth_unstable_by(place, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat3;
    use specula_scene::orientation::estimate;

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
    fn a_view_in_another_frame_is_not_stretched_and_shows_no_less() {
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
    fn one_begins_upright_whatever_is_rolled() {
        for (rolled, first) in [(0, Some(0)), (2, Some(2)), (8, None)] {
            let known = circle(rolled);
            let orientation = estimate(known.iter().map(|(_, camera)| camera), &[]).unwrap();
            let around = Surroundings::of(&orientation, known.clone());
            assert_eq!((around.first, around.up), (first, Vec3::Z), "{rolled} pictures on their side");
            let [right, down, forward] = [0, 1, 2].map(|k| around.start.camera_from_world.row(k));
            assert!(right.z.abs() < 1e-6 && down.z < 0.0, "the horizon is level, and the sky above");
            assert!(
                forward.distance(known[0].1.camera_from_world.row(2)) < 1e-6,
                "one looks where the first camera does"
            );
            let tour = Tour::around(&orientation, &known, 8, None);
            assert!(tour.cameras.iter().all(|(_, camera)| camera.camera_from_world.row(0).z.abs() < 1e-6));
            assert!(
                around.centre.length() < 1e-5 && (tour.cameras[0].1.position.length() - 20.0_f32.sqrt()).abs() < 1e-4
            );
        }
    }

    #[test]
    fn a_turntable_goes_to_and_fro_where_cameras_leave_much_of_the_circle_out() {
        let all_around = circle(0);
        let [start, len] = [2.5_f32, 3.0];
        let side: Vec<NamedCamera> = (0..20)
            .map(|k| {
                let (sin, cos) = (start + len * k as f32 / 19.0).sin_cos();
                let eye = Vec3::new(4.0 * cos, 4.0 * sin, 2.0);
                (k.to_string(), Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.7, 90, 60))
            })
            .collect();
        // From above, and from close by, one sees what one does not see from the circle.
        let [above, close] = [Vec3::new(0.4, 0.1, 4.4), Vec3::new(1.5, 0.5, 0.8)];
        let others = [above, close].map(|eye| Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.7, 90, 60));
        let side: Vec<NamedCamera> =
            side.into_iter().chain(others.map(|camera| ("other".to_owned(), camera))).collect();
        let angles = |known: &[NamedCamera]| {
            let orientation = estimate(known.iter().map(|(_, camera)| camera), &[]).unwrap();
            let tour = Tour::around(&orientation, known, 12, None);
            let angle = |camera: &Camera| camera.position.y.atan2(camera.position.x).rem_euclid(TAU);
            tour.cameras.iter().map(|(_, camera)| angle(camera)).collect::<Vec<f32>>()
        };
        let widest = |mut angles: Vec<f32>| {
            angles.sort_by(f32::total_cmp);
            angles.windows(2).map(|pair| pair[1] - pair[0]).fold(angles[0] + TAU - angles[11], f32::max)
        };
        assert!((widest(angles(&all_around)) - TAU / 12.0).abs() < 1e-4, "evenly around");
        let turns = angles(&side);
        assert!(turns.iter().all(|turn| (start - 1e-3..start + len + 1e-3).contains(turn)), "{turns:?}");
        assert!((turns[0] - start).abs() < 1e-3 && (turns[6] - start - len).abs() < 1e-3, "from end to end: {turns:?}");
        assert!((turns[1] - turns[11]).abs() < 1e-4, "and back the same way");
    }

    #[test]
    fn a_few_cameras_leave_nothing_out() {
        for count in [1, 3, 8] {
            let angles = (0..count).map(|k| 0.3 + TAU * k as f32 / count as f32).collect();
            assert_eq!(Arc::of(angles), None, "{count} cameras, evenly spread");
        }
        assert_eq!(Arc::of(Vec::new()), None);
    }
}
