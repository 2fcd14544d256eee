//! Which way is up in a scene, where its middle is and how far from it one stands, as its cameras tell.
//!
//! A reconstruction has a world of any orientation, place and unit. What people do with cameras says the rest:
//!
//! - **Up.** Pictures are taken level, upright or on their side: a horizon lies along one axis of the picture. So up is the
//!   unit vector u with the least Σ min((x·u)², (y·u)²) over the axes x and y of all pictures that are not tilted, each of
//!   which costs as much as a limit. For a given choice of axes that is the smallest eigenvector of Σ a aᵀ; choice and vector are improved in
//!   turns from many starts. Where minima are as good as equal, up is rather across the views than along them, and
//!   pictures are rather upright than on their side.
//! - **Which end of it.** Where most pictures are upright, they say; else cameras look down at things rather than up; else
//!   the sum of the pictures' ups.
//! - **The middle** is nearest to all optical axes: the least sum of distances, by weighted least squares in turns. Where
//!   axes are parallel or meet behind the cameras, it lies before their mean, as deep as the points that they see; in their
//!   mean, where they look all ways.
//!
//! Everything but the following turns with the world: where cameras do not decide, an axis of the world that is near is
//! taken, and one that is off by rounding alone is exactly that axis.

use core::f64::consts::FRAC_PI_4;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use specula_core::{camera::Camera, eigen, sphere};

/// Sine of the tilt about the view at which a picture is not taken for level: 20°.
const TILTED: f64 = 0.342;
/// Sine of the angle between the view and up, below which a picture has nothing upright: 6°.
const STEEP: f64 = 0.1;
/// Directions from which up is looked for, over half the sphere.
const STARTS: usize = 96;
/// Turns of choosing axes and fitting, at most; a handful is usual.
const TURNS: usize = 32;
/// What looking along up counts for beside a tilt: less than the tilts of wrong answers, more than nothing.
const ALONG: f64 = 0.05;
/// What a picture on its side counts for beside a tilt.
const SIDEWAYS: f64 = 0.01;
/// How level pictures are held, before any is looked at: 3°, in radians. It counts as much as one more picture.
const HAND: f64 = 0.052;
/// From this standard error on nothing is decided: 6°, in radians.
const UNDECIDED: f64 = 0.105;
/// Below this length, a mean of unit vectors has no direction.
const SCATTERED: f64 = 0.5;
/// A mean sine from which on cameras look down or up.
const SLOPED: f64 = 0.05;
/// Cosine from which on an axis of the world is taken where nothing is decided.
const CLOSE: f64 = 0.8;
/// What `f32` leaves of a direction.
const ROUNDED: f64 = 1e-4;
/// Mean squared sine between optical axes, below which they are parallel: 2°.
const PARALLEL: f64 = 1e-3;
/// Turns of the weighted least squares.
const REWEIGHTED: usize = 16;
/// Distances from an axis below this share of the cameras' spread weigh alike.
const NEAR_AXIS: f64 = 0.01;

/// Up, middle and distance of a scene, and how that is known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Orientation {
    /// What is above, in the world: a unit vector.
    pub up: [f64; 3],
    /// The point that cameras look at.
    pub centre: [f64; 3],
    /// The median distance of cameras from there, above 0.
    pub distance: f64,
    /// What tells up.
    pub told_by: UpSource,
    /// How many cameras there are.
    pub cameras: usize,
    /// How many of their pictures are on their side or upside down.
    pub rolled: usize,
    /// The standard error of up in degrees, as pictures agree; none where nothing is decided.
    pub error_degrees: Option<f64>,
}

/// What tells which way is up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpSource {
    /// Pictures are level, and most of them upright.
    Upright,
    /// Pictures are level, and cameras look down.
    Height,
    /// Pictures are level, and that is all: the sum of their ups says which end.
    Level,
    /// Cameras are too few or too much alike: the mean of the pictures' ups.
    Mean,
    /// The same, and all look one way without any common up, so that is taken for down; or +z, where nothing is common.
    Nothing,
    /// Somebody said so.
    Hand,
}

/// A camera's axes in the world.
#[derive(Clone, Copy)]
struct Axes {
    right: DVec3,
    down: DVec3,
    forward: DVec3,
    position: DVec3,
}

impl Axes {
    fn of(camera: &Camera) -> Self {
        let row = |k: usize| camera.camera_from_world.row(k).as_dvec3().normalize();
        Self { right: row(0), down: row(1), forward: row(2), position: camera.position.as_dvec3() }
    }

    /// The picture's axis that is more level.
    fn level(&self, up: DVec3) -> DVec3 {
        if self.right.dot(up).abs() <= self.down.dot(up).abs() { self.right } else { self.down }
    }

    /// Whether that axis is near enough to being level.
    fn is_level(&self, up: DVec3) -> bool {
        let [across, along] = [self.right.dot(up).abs(), self.down.dot(up).abs()];
        let slope = across.hypot(along);
        slope < STEEP || across.min(along) <= TILTED * slope
    }

    /// By how much the picture is turned about the view, in radians, counterclockwise from upright; none where one looks
    /// along up.
    fn roll(&self, up: DVec3) -> Option<f64> {
        let (across, above) = (self.right.dot(up), -self.down.dot(up));
        (across.hypot(above) >= STEEP).then(|| across.atan2(above))
    }
}

impl Orientation {
    /// As cameras tell, and the points that they see, if any are known; none without cameras.
    pub fn of<'a>(cameras: impl IntoIterator<Item = &'a Camera>, points: &[[f32; 3]]) -> Option<Self> {
        let axes: Vec<Axes> = cameras.into_iter().map(Axes::of).collect();
        if axes.is_empty() {
            return None;
        }
        let (up, told_by, error) = up_of(&axes);
        let centre = centre_of(&axes, points);
        let distance = median(axes.iter().map(|own| own.position.distance(centre)).collect());
        Some(Self {
            up: up.to_array(),
            centre: centre.to_array(),
            distance: if distance > 0.0 { distance } else { 1.0 },
            told_by,
            cameras: axes.len(),
            rolled: rolled(&axes, up),
            error_degrees: error.map(f64::to_degrees),
        })
    }

    /// The same with another direction of any length but 0 above, because somebody said so.
    #[must_use]
    pub fn with_up<'a>(self, up: [f64; 3], cameras: impl IntoIterator<Item = &'a Camera>) -> Self {
        let up = DVec3::from(up);
        let up = (up / up.abs().max_element()).normalize();
        let axes: Vec<Axes> = cameras.into_iter().map(Axes::of).collect();
        Self { up: up.to_array(), told_by: UpSource::Hand, rolled: rolled(&axes, up), error_degrees: None, ..self }
    }

    /// Whether up and middle are such at all: a file may say anything.
    pub fn is_sound(&self) -> bool {
        let is_unit = (DVec3::from(self.up).length() - 1.0).abs() < ROUNDED;
        is_unit && DVec3::from(self.centre).is_finite() && self.distance > 0.0 && self.distance.is_finite()
    }

    /// Whether the picture of a camera is upright, or has nothing upright.
    pub fn is_upright(&self, camera: &Camera) -> bool {
        is_upright(&Axes::of(camera), self.up.into())
    }
}

fn is_upright(axes: &Axes, up: DVec3) -> bool {
    axes.roll(up).is_none_or(|roll| roll.abs() <= FRAC_PI_4)
}

fn rolled(axes: &[Axes], up: DVec3) -> usize {
    axes.iter().filter(|own| !is_upright(own, up)).count()
}

/// Up, what tells it, and its standard error in radians where it is decided.
fn up_of(axes: &[Axes]) -> (DVec3, UpSource, Option<f64>) {
    let candidates = sphere::directions(2 * STARTS).take(STARTS).map(|start| Level::from(axes, start.into()));
    let best = candidates.min_by(|one, other| one.cost.total_cmp(&other.cost)).expect("there are starts");
    if best.error >= UNDECIDED {
        let (up, told) = undecided(axes);
        return (up, told, None);
    }
    let (sign, told) = end_of(axes, best.up);
    (unrounded(best.up * sign), told, Some(best.error))
}

/// A direction across which pictures lie level.
struct Level {
    up: DVec3,
    cost: f64,
    /// Standard error, in radians; infinite where the level axes lie along one line.
    error: f64,
}

impl Level {
    /// The best one that is reached from a start: first with all pictures, then without those that are tilted.
    fn from(axes: &[Axes], start: DVec3) -> Self {
        let (up, _) = settled(axes, start, |_, _| true);
        let (up, error) = settled(axes, up, Axes::is_level);
        let cost = |own: &Axes| {
            let level = own.level(up);
            let tilt = if own.is_level(up) { level.dot(up).powi(2) } else { TILTED * TILTED };
            let side = if level == own.down { SIDEWAYS } else { 0.0 };
            tilt + side + ALONG * own.forward.dot(up).powi(2)
        };
        Self { up, cost: axes.iter().map(cost).sum(), error }
    }
}

/// Where choosing axes and fitting up to them comes to rest, and the standard error there, by the pictures that count.
fn settled(axes: &[Axes], start: DVec3, counts: impl Fn(&Axes, DVec3) -> bool) -> (DVec3, f64) {
    let (mut up, mut error) = (start, f64::INFINITY);
    for _ in 0..TURNS {
        let level = axes.iter().filter(|own| counts(own, up)).map(|own| own.level(up));
        let (mut sum, mut count) = (DMat3::ZERO, 0.0);
        for axis in level {
            sum += outer(axis);
            count += 1.0;
        }
        let [(least, vector), (second, _), _] = eigen::symmetric(sum.to_cols_array_2d());
        let variance = (least.max(0.0) + HAND * HAND) / f64::max(count - 1.0, 1.0);
        error = (variance / second).sqrt();
        let next = DVec3::from(vector);
        let is_settled = next.dot(up).abs() > 1.0 - 1e-15;
        up = next;
        if is_settled || count == 0.0 {
            break;
        }
    }
    (up, if error.is_nan() { f64::INFINITY } else { error })
}

/// Which end of an axis is above, as ±1, and what tells.
fn end_of(axes: &[Axes], up: DVec3) -> (f64, UpSource) {
    let rolls: Vec<f64> = axes.iter().filter_map(|own| own.roll(up)).map(f64::abs).collect();
    let upright = rolls.iter().filter(|roll| **roll <= FRAC_PI_4).count();
    let upside_down = rolls.iter().filter(|roll| **roll >= 3.0 * FRAC_PI_4).count();
    let slope = axes.iter().map(|own| own.forward.dot(up)).sum::<f64>() / axes.len() as f64;
    let sum = -axes.iter().map(|own| own.down.dot(up)).sum::<f64>();
    if 2 * upright.max(upside_down) > axes.len() {
        (if upright > upside_down { 1.0 } else { -1.0 }, UpSource::Upright)
    } else if slope.abs() > SLOPED {
        (-slope.signum(), UpSource::Height)
    } else {
        (sum.signum(), UpSource::Level)
    }
}

/// What is taken for up where cameras do not decide.
fn undecided(axes: &[Axes]) -> (DVec3, UpSource) {
    let mean = |of: fn(&Axes) -> DVec3| axes.iter().map(of).sum::<DVec3>() / axes.len() as f64;
    let (above, backwards) = (mean(|own| -own.down), mean(|own| -own.forward));
    if above.length() >= SCATTERED {
        (straightened(above.normalize()), UpSource::Mean)
    } else if backwards.length() >= SCATTERED {
        (straightened(backwards.normalize()), UpSource::Nothing)
    } else {
        (DVec3::Z, UpSource::Nothing)
    }
}

/// An axis of the world that is close to `up`, or else `up` itself.
fn straightened(up: DVec3) -> DVec3 {
    let close = DVec3::AXES.into_iter().find(|axis| axis.dot(up).abs() > CLOSE);
    close.map_or(up, |axis| axis * axis.dot(up).signum())
}

/// The axis of the world that `up` is up to rounding, or else `up` itself.
fn unrounded(up: DVec3) -> DVec3 {
    let axes = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    axes.into_iter().find(|axis| axis.distance(up) < ROUNDED).unwrap_or(up)
}

/// The point that cameras look at.
fn centre_of(axes: &[Axes], points: &[[f32; 3]]) -> DVec3 {
    let mean = axes.iter().map(|own| own.position).sum::<DVec3>() / axes.len() as f64;
    let spread = median(axes.iter().map(|own| own.position.distance(mean)).collect());
    let meeting = meeting_point(axes, NEAR_AXIS * spread);
    let is_before =
        |point: &DVec3| 2 * axes.iter().filter(|own| own.forward.dot(*point - own.position) > 0.0).count() > axes.len();
    meeting.filter(is_before).unwrap_or_else(|| {
        let view = axes.iter().map(|own| own.forward).sum::<DVec3>() / axes.len() as f64;
        let view = if view.length() < SCATTERED { DVec3::ZERO } else { view.normalize() };
        let depths = points.iter().map(|point| view.dot(DVec3::from(point.map(f64::from)) - mean));
        let seen: Vec<f64> = depths.filter(|depth| *depth > 0.0).collect();
        let depth = if seen.is_empty() { spread } else { median(seen) };
        mean + view * if depth > 0.0 { depth } else { 1.0 }
    })
}

/// The point with the least sum of distances from all optical axes, distances below `near` taken for it; none where they are
/// parallel.
fn meeting_point(axes: &[Axes], near: f64) -> Option<DVec3> {
    let mut weights = vec![1.0; axes.len()];
    let mut point = DVec3::ZERO;
    for _ in 0..REWEIGHTED {
        let (mut across, mut sum, mut total) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (own, weight) in axes.iter().zip(&weights) {
            let projection = (DMat3::IDENTITY - outer(own.forward)) * *weight;
            across += projection;
            sum += projection * own.position;
            total += weight;
        }
        let [(least, _), ..] = eigen::symmetric(across.to_cols_array_2d());
        if !(least > PARALLEL * total) {
            return None;
        }
        point = across.inverse() * sum;
        for (own, weight) in axes.iter().zip(&mut weights) {
            *weight = 1.0 / own.forward.cross(point - own.position).length().max(near).max(f64::MIN_POSITIVE);
        }
    }
    Some(point)
}

fn outer(axis: DVec3) -> DMat3 {
    DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z)
}

/// The median; 0 of nothing.
fn median(mut numbers: Vec<f64>) -> f64 {
    let middle = numbers.len() / 2;
    if numbers.is_empty() { 0.0 } else { *numbers.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{FRAC_PI_2, TAU};
    use glam::{DQuat, Mat3, Quat, Vec3};
    use specula_core::random::{normal, uniform};

    /// What `f32` rotations of cameras leave of a direction, twice over.
    const EXACT: f64 = 2e-6;
    const COUNT: u64 = 40;
    const MIDDLE: Vec3 = Vec3::new(0.3, -0.2, 0.5);

    /// Cameras around [`MIDDLE`] in a world with +z above, at a distance of 4 and of any height between these, each picture
    /// turned about its view by so many quarters, and further by a normal number of degrees.
    fn ring([low, high]: [f32; 2], quarters: impl Fn(u64) -> u64, degrees: f32) -> Vec<Camera> {
        let camera = |k: u64| {
            let (turn, height) = (TAU as f32 * uniform(5, 0, k), low + (high - low) * uniform(5, 1, k));
            let outwards = Vec3::new(turn.cos() * height.cos(), turn.sin() * height.cos(), height.sin());
            let upright = Camera::look_at(MIDDLE + 4.0 * outwards, MIDDLE, Vec3::Z, 0.7, 100, 80);
            rolled(upright, FRAC_PI_2 as f32 * quarters(k) as f32 + (degrees * normal(5, 2, k)).to_radians())
        };
        (0..COUNT).map(camera).collect()
    }

    fn rolled(camera: Camera, roll: f32) -> Camera {
        Camera { camera_from_world: Mat3::from_rotation_z(roll) * camera.camera_from_world, ..camera }
    }

    /// The same cameras in a world that is turned, moved and larger.
    fn elsewhere(cameras: &[Camera], turn: Quat, scale: f32, shift: Vec3) -> Vec<Camera> {
        let moved = |camera: &Camera| Camera {
            camera_from_world: camera.camera_from_world * Mat3::from_quat(turn.inverse()),
            position: scale * (turn * camera.position) + shift,
            ..*camera
        };
        cameras.iter().map(moved).collect()
    }

    fn of(cameras: &[Camera]) -> Orientation {
        Orientation::of(cameras, &[]).unwrap()
    }

    /// Radians between up as it was found and another.
    fn off(found: &Orientation, up: DVec3) -> f64 {
        DVec3::from(found.up).angle_between(up)
    }

    fn some_turn(seed: u64) -> Quat {
        Quat::from_vec4(glam::Vec4::from_array(core::array::from_fn(|k| normal(seed, 9, k as u64))).normalize())
    }

    #[test]
    fn any_pictures_may_be_rolled_by_quarters_and_the_world_be_any() {
        type Quarters = fn(u64) -> u64;
        let rolls: [(&str, Quarters); 6] = [
            ("none", |_| 0),
            ("half of them, by 90°", |k| k % 2),
            ("all, by 90°", |_| 1),
            ("all, by 270°", |_| 3),
            ("any, by any", |k| uniform_quarters(k)),
            ("all, by 180°, as a camera hangs", |k| if k < COUNT / 3 { 2 } else { 0 }),
        ];
        for (name, quarters) in rolls {
            for heights in [[0.0, 0.0], [0.2, 0.2], [0.1, 0.9], [0.8, 0.8], [-0.3, 1.2]] {
                for seed in 0..4 {
                    let cameras = ring(heights, quarters, 0.0);
                    // Pictures on their side at the height of what they look at do not tell above from below.
                    let is_told =
                        heights != [0.0, 0.0] || !matches!(name, "all, by 90°" | "all, by 270°" | "any, by any");
                    let (turn, scale, shift) =
                        (some_turn(seed), 0.01 * 10.0_f32.powi(seed as i32), Vec3::splat(seed as f32));
                    let found = of(&elsewhere(&cameras, turn, scale, shift));
                    let up = (turn * Vec3::Z).as_dvec3();
                    let error = if is_told { off(&found, up) } else { off(&found, up).min(off(&found, -up)) };
                    assert!(error < EXACT, "{name}, {heights:?}, {seed}: {error} rad, {found:?}");
                    let middle = (scale * (turn * MIDDLE) + shift).as_dvec3();
                    let distance = DVec3::from(found.centre).distance(middle);
                    assert!(distance < 1e-5 * f64::from(4.0 * scale + shift.length()), "{distance} beside {middle}");
                    assert!((found.distance / (4.0 * f64::from(scale)) - 1.0).abs() < 1e-4, "{found:?}");
                }
            }
        }
    }

    fn uniform_quarters(k: u64) -> u64 {
        (4.0 * uniform(5, 3, k)) as u64
    }

    #[test]
    fn rolled_pictures_are_counted_and_what_tells_is_told() {
        let found = of(&ring([0.2, 0.6], |k| k % 4 / 3, 0.0));
        assert_eq!((found.cameras, found.rolled, found.told_by), (40, 10, UpSource::Upright));
        let found = of(&ring([0.2, 0.6], |_| 1, 0.0));
        assert_eq!((found.rolled, found.told_by), (40, UpSource::Height));
        let by_hand = found.with_up([0.0, 0.0, -2.0], &ring([0.2, 0.6], |_| 1, 0.0));
        assert_eq!((by_hand.up, by_hand.told_by, by_hand.error_degrees), ([0.0, 0.0, -1.0], UpSource::Hand, None));
        assert_eq!(found.with_up([0.0, 1e300, 0.0], &[]).up, [0.0, 1.0, 0.0], "of any length");
        assert!(by_hand.is_sound() && !Orientation { up: [0.0; 3], ..by_hand }.is_sound());
    }

    #[test]
    fn hands_that_shake_and_pictures_that_are_tilted_hardly_matter() {
        for (seed, heights) in [[0.0, 0.3], [0.2, 0.9], [0.5, 1.3]].into_iter().enumerate() {
            let mut cameras = ring(heights, uniform_quarters, 3.0);
            for k in 0..5 {
                cameras[7 * k] = rolled(cameras[7 * k], 0.7);
            }
            let turn = some_turn(seed as u64);
            let found = of(&elsewhere(&cameras, turn, 1.0, Vec3::ZERO));
            let error = off(&found, (turn * Vec3::Z).as_dvec3()).to_degrees();
            // 3° of 35 pictures leave 0.7° in each of two directions; three times as much is one in a hundred.
            assert!(error < 2.1, "{heights:?}: {error}°");
            assert!(found.error_degrees.is_some_and(|said| said > 0.2 && error < 4.0 * said), "{error}° of {found:?}");
        }
    }

    #[test]
    fn pictures_of_blender_have_exactly_z_above() {
        for count in [3, 8, 40] {
            let found = of(&ring([0.1, 1.3], |_| 0, 0.0)[..count]);
            assert_eq!((found.up, found.rolled), ([0.0, 0.0, 1.0], 0), "{count} cameras: {found:?}");
        }
    }

    #[test]
    fn cameras_beside_each_other_take_the_ups_of_their_pictures_and_the_depth_of_their_points() {
        let at = |k: u64| {
            let position = Vec3::new(0.2 * k as f32, 0.1 * uniform(3, 0, k), 0.0);
            Camera::look_at(position, position + Vec3::new(0.01 * normal(3, 1, k), 0.0, 5.0), Vec3::NEG_Y, 0.7, 100, 80)
        };
        let cameras: Vec<Camera> = (0..9).map(at).collect();
        let found =
            Orientation::of(&cameras, &[[0.0, 0.0, 6.0], [1.0, 1.0, 7.0], [0.0, 0.0, 90.0], [0.0, 0.0, -9.0]]).unwrap();
        assert!(off(&found, DVec3::NEG_Y) < 0.02, "{found:?}");
        assert_eq!(found.rolled, 0);
        assert!((found.centre[2] - 7.0).abs() < 0.1, "the median of what is seen: {found:?}");
    }

    #[test]
    fn what_cameras_cannot_tell_has_a_known_outcome() {
        assert!(Orientation::of(&[], &[]).is_none(), "no camera");
        let one = &ring([0.5, 0.5], |_| 0, 0.0)[..1];
        let found = of(one);
        assert_eq!(
            (found.up, found.told_by),
            ([0.0, 0.0, 1.0], UpSource::Mean),
            "an axis that is near the picture's up"
        );
        assert!(found.error_degrees.is_none() && found.distance > 0.0, "{found:?}");

        let down = |k: u64, heading: f32| {
            let position = Vec3::new(k as f32, 0.5 * (k % 3) as f32, 10.0);
            Camera::look_at(position, position - Vec3::Z, Vec3::new(heading.cos(), heading.sin(), 0.0), 0.7, 100, 80)
        };
        let any: Vec<Camera> = (0..12).map(|k| down(k, 2.4 * k as f32)).collect();
        let found = of(&any);
        assert!(off(&found, DVec3::Z) < EXACT && found.told_by == UpSource::Height, "of any heading: {found:?}");
        let there_and_back: Vec<Camera> = (0..12).map(|k| down(k, (k % 2) as f32 * TAU as f32 / 2.0)).collect();
        assert_eq!((of(&there_and_back).up, of(&there_and_back).told_by), ([0.0, 0.0, 1.0], UpSource::Nothing));
        let same: Vec<Camera> = (0..12).map(|k| down(k, 0.0)).collect();
        assert_eq!((of(&same).up, of(&same).told_by), ([1.0, 0.0, 0.0], UpSource::Mean), "as if it were a wall");
    }

    #[test]
    fn cameras_that_look_outwards_have_their_middle_among_them() {
        let outwards = |camera: &Camera| Camera { position: 2.0 * MIDDLE - camera.position, ..*camera };
        let turned: Vec<Camera> = ring([0.1, 0.1], |_| 0, 0.0).iter().map(outwards).collect();
        let found = of(&turned);
        assert!(DVec3::from(found.centre).distance(MIDDLE.as_dvec3()) < 2.0, "{found:?}");
        assert!(off(&found, DVec3::Z) < EXACT);
    }

    #[test]
    fn a_turn_of_the_world_turns_what_is_found_and_nothing_else() {
        let cameras = ring([0.0, 0.8], uniform_quarters, 4.0);
        let before = of(&cameras);
        let turn = some_turn(77);
        let after = of(&elsewhere(&cameras, turn, 1.0, Vec3::ZERO));
        let turn = DQuat::from_xyzw(turn.x.into(), turn.y.into(), turn.z.into(), turn.w.into());
        assert!(off(&after, turn * DVec3::from(before.up)) < EXACT);
        assert_eq!((after.rolled, after.told_by), (before.rolled, before.told_by));
        let said = [before, after].map(|found| found.error_degrees.unwrap());
        assert!((said[0] - said[1]).abs() < 1e-4, "{said:?}");
    }
}
