//! From where a scene is looked at: the model's own cameras, those of a file, or a circle around it.

use crate::{
    args::{Look, Split},
    failure::Failure,
    scene::Opened,
};
use core::f32::consts::{FRAC_PI_2, TAU};
use glam::{Mat3, Vec3};
use specula_core::{
    camera::{Camera, near_of},
    scene::{Gaussians, MEAN},
};
use specula_io::cameras::{self, NamedCamera};
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
}

impl Tour {
    /// The cameras that were asked for, or those that fit best.
    pub(crate) fn choose(look: &Look, opened: &Opened) -> Result<Self, Failure> {
        let mut tour = Self::unsized_tour(look, opened)?;
        tour.set_near(own_cameras(opened)?);
        if let Some([width, height]) = look.size {
            tour.cameras.iter_mut().for_each(|(_, camera)| *camera = camera.resized(width, height));
        }
        Ok(tour)
    }

    /// The cameras of a scene's test views, else all of its own, else a circle around it.
    pub(crate) fn of_scene(opened: &Opened) -> Result<Vec<Camera>, Failure> {
        let own = own_cameras(opened)?;
        let mut tour = match own.clone() {
            Some(own) => Self::of_split(None, own, opened)?,
            None => Self::around(&opened.scene.gaussians, &[], ORBIT, None),
        };
        tour.set_near(own);
        Ok(tour.cameras.into_iter().map(|(_, camera)| camera).collect())
    }

    /// The cameras that a scene was fitted to: those that are not its test views, where it says which, else all of its own.
    pub(crate) fn fitted(opened: &Opened) -> Result<Option<Vec<Camera>>, Failure> {
        let Some(own) = own_cameras(opened)? else { return Ok(None) };
        let tests = opened.test_views().filter(|count| *count < own.len()).unwrap_or(0);
        let mut tour = Self { name: "fitted", cameras: own[tests..].to_vec(), split: None, is_turntable: false };
        tour.set_near(Some(own));
        Ok(Some(tour.cameras.into_iter().map(|(_, camera)| camera).collect()))
    }

    /// Cameras all around a scene, evenly spread over a sphere: for what has to be seen from everywhere.
    pub(crate) fn sphere(gaussians: &Gaussians<Vec<f32>>, count: u32) -> Vec<Camera> {
        let (centre, distance) = whole(gaussians);
        let [width, height] = SIZE;
        let camera = |direction: [f32; 3]| {
            let outwards = Vec3::from(direction);
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

    fn unsized_tour(look: &Look, opened: &Opened) -> Result<Self, Failure> {
        if let Some(file) = &look.cameras {
            let cameras = cameras::read_cameras(file, look.size.unwrap_or(SIZE))?;
            return Ok(Self { name: "cameras", cameras, split: None, is_turntable: false });
        }
        let own = own_cameras(opened)?;
        match (look.turntable, own) {
            (Some(count), own) => Ok(Self::around(&opened.scene.gaussians, &own.unwrap_or_default(), count, look.size)),
            (None, Some(own)) => Self::of_split(look.split, own, opened),
            (None, None) if look.split.is_some() => Err(Failure::Input(
                "the scene has no cameras of its own to take --split from; name some with --cameras, or use --turntable"
                    .into(),
            )),
            (None, None) => Ok(Self::around(&opened.scene.gaussians, &[], ORBIT, look.size)),
        }
    }

    /// The model's cameras, which are listed test views first.
    fn of_split(asked: Option<Split>, mut own: Vec<NamedCamera>, opened: &Opened) -> Result<Self, Failure> {
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
        Ok(Self { name: split.name(), cameras: own, split: Some(split), is_turntable: false })
    }

    /// A circle, as high above the scene as the known cameras are in the mean.
    pub(crate) fn around(
        gaussians: &Gaussians<Vec<f32>>,
        known: &[NamedCamera],
        count: u32,
        size: Option<[u32; 2]>,
    ) -> Self {
        let orbit = Orbit::of(gaussians, known);
        let like = known.first().map(|(_, camera)| *camera);
        let camera_at =
            |index: u32| (format!("{index:05}"), orbit.camera(TAU * index as f32 / count as f32, like, size));
        Self { name: "turntable", cameras: (0..count).map(camera_at).collect(), split: None, is_turntable: true }
    }
}

/// Where one stands who wants to look around in a scene.
#[derive(Debug)]
pub(crate) struct Surroundings {
    /// The cameras that the scene knows.
    pub(crate) known: Vec<NamedCamera>,
    /// A camera to begin with.
    pub(crate) start: Camera,
    /// What the cameras look at.
    pub(crate) centre: Vec3,
    pub(crate) up: Vec3,
}

impl Surroundings {
    /// Of Gaussians, and the cameras that are known with them.
    pub(crate) fn of(gaussians: &Gaussians<Vec<f32>>, mut known: Vec<NamedCamera>) -> Self {
        let orbit = Orbit::of(gaussians, &known);
        let around: Vec<Camera> =
            (0..ORBIT).map(|index| orbit.camera(TAU * index as f32 / ORBIT as f32, None, None)).collect();
        let near = match known.is_empty() {
            true => near_of(extent_of_cameras(around.iter())),
            false => near_of(extent_of_cameras(known.iter().map(|(_, camera)| camera))),
        };
        known.iter_mut().for_each(|(_, camera)| camera.near = near);
        let start = known.first().map_or(around[0], |(_, camera)| *camera);
        Self { start: Camera { near, ..start }, known, centre: orbit.centre, up: orbit.up }
    }
}

/// The cameras of the folder of a model, test views first.
pub(crate) fn own_cameras(opened: &Opened) -> Result<Option<Vec<NamedCamera>>, Failure> {
    let file = opened.folder.as_ref().map(|folder| folder.join("cameras.json"));
    match file.filter(|file| file.is_file()) {
        Some(file) => Ok(Some(cameras::read(&file)?)),
        None => Ok(None),
    }
}

/// A circle around a scene.
struct Orbit {
    centre: Vec3,
    up: Vec3,
    distance: f32,
    /// Above the horizon, in radians.
    elevation: f32,
}

impl Orbit {
    fn of(gaussians: &Gaussians<Vec<f32>>, known: &[NamedCamera]) -> Self {
        const ELEVATION: f32 = 0.4;
        const HIGHEST: f32 = 1.0;
        if known.is_empty() {
            let (centre, distance) = whole(gaussians);
            return Self { centre, up: Vec3::Z, distance, elevation: ELEVATION };
        }
        let centre = seen_point(known);
        let (share, up) = (1.0 / known.len() as f32, above(known));
        let distance = share * known.iter().map(|(_, camera)| camera.position.distance(centre)).sum::<f32>();
        let height = share * known.iter().map(|(_, camera)| up.dot(camera.position - centre)).sum::<f32>();
        let elevation = (height / distance.max(f32::MIN_POSITIVE)).clamp(-1.0, 1.0).asin().clamp(0.0, HIGHEST);
        Self { centre, up, distance, elevation }
    }

    fn camera(&self, turn: f32, like: Option<Camera>, size: Option<[u32; 2]>) -> Camera {
        let east = self.up.any_orthonormal_vector();
        let outwards = east * turn.cos() + self.up.cross(east) * turn.sin();
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

/// What is above, as cameras stand: +z where there are none.
pub(crate) fn above(known: &[NamedCamera]) -> Vec3 {
    // The second row of the rotation is down in the picture.
    let up = -known.iter().map(|(_, camera)| camera.camera_from_world.row(1)).sum::<Vec3>();
    straightened(up.try_normalize().unwrap_or(Vec3::Z))
}

/// What is above in a scene, as its own cameras stand.
pub(crate) fn above_in(opened: &Opened) -> Result<Vec3, Failure> {
    Ok(above(&own_cameras(opened)?.unwrap_or_default()))
}

/// Unit directions, evenly spread over the sphere: a Fibonacci lattice, each with the same share of it.
pub(crate) fn directions(count: usize) -> impl Iterator<Item = [f32; 3]> {
    const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
    (0..count).map(move |k| {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let (sin, cos) = (k as f64 * GOLDEN_ANGLE).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        [radius * cos, radius * sin, z].map(|x| x as f32)
    })
}

/// At most so many things, evenly spread over all.
pub(crate) fn evenly<T: Copy>(things: &[T], most: usize) -> Vec<T> {
    let count = things.len().min(most);
    (0..count).map(|k| things[(2 * k + 1) * things.len() / (2 * count)]).collect()
}

/// An axis of the world that is close to `up`, or else `up` itself.
fn straightened(up: Vec3) -> Vec3 {
    const CLOSE: f32 = 0.8;
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    let close = axes.into_iter().find(|axis| axis.dot(up).abs() > CLOSE);
    close.map_or(up, |axis| axis * axis.dot(up).signum())
}

/// The point that is nearest to the optical axes of all cameras.
fn seen_point(known: &[NamedCamera]) -> Vec3 {
    let mut across = Mat3::ZERO;
    let mut sum = Vec3::ZERO;
    for (_, camera) in known {
        let axis = camera.camera_from_world.row(2);
        let projection = Mat3::IDENTITY - Mat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        across += projection;
        sum += projection * camera.position;
    }
    let parallel = across.determinant() < 1e-4 * (known.len() as f32).powi(3);
    let mean = known.iter().map(|(_, camera)| camera.position).sum::<Vec3>() / known.len() as f32;
    if parallel { mean + known[0].1.camera_from_world.row(2) } else { across.inverse() * sum }
}

/// The middle of a scene, and the distance from which all of it is seen.
fn whole(gaussians: &Gaussians<Vec<f32>>) -> (Vec3, f32) {
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

    #[test]
    fn cameras_around_a_point_see_that_point() {
        let target = Vec3::new(0.3, -0.2, 0.5);
        let at = |turn: f32| {
            let position = target + Vec3::new(4.0 * turn.cos(), 4.0 * turn.sin(), 2.0);
            (String::new(), Camera::look_at(position, target, Vec3::Z, 0.7, 100, 100))
        };
        let known: Vec<NamedCamera> = (0..5).map(|k| at(k as f32)).collect();
        assert!(seen_point(&known).distance(target) < 1e-4);
        assert!(straightened(Vec3::new(0.1, 0.2, 0.95).normalize()) == Vec3::Z);
    }
}
