//! Scene orientation from cameras: up direction, centre and viewing distance.
//!
//! The world of a reconstruction has an arbitrary rotation, origin and unit. The cameras determine
//! the rest:
//!
//! - **Axis of up.** Photographs are taken level, upright or on their side, so that the horizon is
//!   parallel to one axis of the picture. Up is the unit vector u that minimises Σ min((x·u)²,
//!   (y·u)²) over the axes x and y of all pictures; tilted pictures contribute a constant instead.
//!   For a fixed choice of axes u is the smallest eigenvector of Σ a aᵀ; the choice and u are
//!   refined alternately from many start directions. Among minima of nearly equal cost, small terms
//!   prefer u perpendicular to the view directions, and upright pictures to pictures on their side.
//! - **Sign of up.** The majority of upright pictures decides; else cameras are assumed to look
//!   down rather than up; else the sum of the pictures' up directions decides.
//! - **Centre.** The point with the smallest sum of distances from all optical axes, by iteratively
//!   reweighted least squares. If the axes are parallel or intersect behind the cameras: the point
//!   in front of the cameras' mean at the median depth of the scene's points, or the mean itself if
//!   the view directions cancel.
//!
//! The result is equivariant under rotations of the world, except that a nearby axis of the world
//! replaces an up direction that the cameras do not determine, and an axis within rounding error
//! replaces the estimate.

mod direction;

pub use direction::{InvalidUpDirection, UpDirection, description};

use crate::framing::framing;
use core::f64::consts::FRAC_PI_4;
use glam::{DMat3, DVec3, Vec3};
use specula_core::{camera::Camera, eigen, scene::Gaussians, sphere};
use specula_io::{
    model_folder::ModelInfo,
    orientation::{Orientation, UpSource},
};

/// Sine of the roll from which a picture counts as tilted: 20°.
const TILTED_SIN: f64 = 0.342;
/// Sine of the angle between view and up below which a picture has no upright direction: 6°.
const ALONG_UP_SIN: f64 = 0.1;
/// Start directions of the search for up, over half the sphere.
const START_COUNT: usize = 96;
/// Maximum iterations of choosing axes and fitting up; a handful is usual.
const FIT_ITERATIONS_MAX: usize = 32;
/// Cost of looking along up, relative to a squared tilt of 1: below the tilts of wrong answers,
/// above zero.
const ALONG_UP_COST: f64 = 0.05;
/// Cost of a picture on its side, relative to a squared tilt of 1.
const SIDEWAYS_COST: f64 = 0.01;
/// Prior standard deviation of the roll of hand-held pictures, in radians: 3°, with the weight of
/// one picture.
const ROLL_PRIOR_RAD: f64 = 0.052;
/// Standard error from which up is undetermined, in radians: 6°.
const UP_ERROR_MAX_RAD: f64 = 0.105;
/// Length of a mean of unit vectors below which it has no direction.
const MEAN_LENGTH_MIN: f64 = 0.5;
/// Mean sine of the cameras' pitch above which they look down or up.
const PITCH_SIN_MIN: f64 = 0.05;
/// Cosine of the angle to an axis of the world, 37°, within which the axis replaces an undetermined
/// up.
const SNAP_COS: f64 = 0.8;
/// Distance of unit vectors that are equal up to the rounding of `f32` cameras.
const ROUNDING: f64 = 1e-4;
/// Mean squared sine between optical axes below which they are parallel: 2°.
const PARALLEL_SIN2: f64 = 1e-3;
/// Iterations of the reweighted least squares.
const REWEIGHT_ITERATIONS: usize = 16;
/// Lower bound of distances in the weights, as a share of the cameras' spread.
const AXIS_DISTANCE_MIN: f64 = 0.01;

/// Axes and position of a camera in world space.
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

    /// Axis of the picture that is closer to level.
    fn level(&self, up: DVec3) -> DVec3 {
        if self.right.dot(up).abs() <= self.down.dot(up).abs() { self.right } else { self.down }
    }

    /// Returns whether the picture is tilted by less than [`TILTED_SIN`].
    fn is_level(&self, up: DVec3) -> bool {
        let [across, along] = [self.right.dot(up).abs(), self.down.dot(up).abs()];
        let slope = across.hypot(along);
        slope < ALONG_UP_SIN || across.min(along) <= TILTED_SIN * slope
    }

    /// Roll of the picture about its view in radians, counterclockwise from upright; none for a
    /// view along up.
    fn roll(&self, up: DVec3) -> Option<f64> {
        let (across, above) = (self.right.dot(up), -self.down.dot(up));
        (across.hypot(above) >= ALONG_UP_SIN).then(|| across.atan2(above))
    }
}

/// Estimates the orientation of a scene from its cameras and any known points; none without
/// cameras.
pub fn estimate<'a>(cameras: impl IntoIterator<Item = &'a Camera>, points: &[[f32; 3]]) -> Option<Orientation> {
    let axes: Vec<Axes> = cameras.into_iter().map(Axes::of).collect();
    if axes.is_empty() {
        return None;
    }
    let (up, up_source, error) = estimate_up(&axes);
    let centre = estimate_centre(&axes, points);
    let distance = median(axes.iter().map(|camera| camera.position.distance(centre)).collect());
    Some(Orientation {
        up: up.to_array(),
        centre: centre.to_array(),
        distance: if distance > 0.0 { distance } else { 1.0 },
        up_source,
        cameras: axes.len(),
        rolled: count_rolled(&axes, up),
        error_degrees: error.map(f64::to_degrees),
    })
}

/// Recorded orientation of a model, else the estimate from its cameras; `None` without either.
pub fn recorded_or_estimated<'a>(
    info: Option<&ModelInfo>,
    cameras: impl IntoIterator<Item = &'a Camera>,
) -> Option<Orientation> {
    let recorded = info.and_then(|info| info.orientation).filter(Orientation::is_valid);
    recorded.or_else(|| estimate(cameras, &[]))
}

/// Orientation of Gaussians without cameras: up is +z, as in Blender, and all of them are seen from
/// the viewing distance.
pub fn of_gaussians(gaussians: &Gaussians<Vec<f32>>) -> Orientation {
    let (centre, distance) = framing(gaussians);
    Orientation {
        up: [0.0, 0.0, 1.0],
        centre: centre.as_dvec3().to_array(),
        distance: distance.into(),
        up_source: UpSource::Nothing,
        cameras: 0,
        rolled: 0,
        error_degrees: None,
    }
}

/// Up direction in world space, a unit vector.
pub fn up(orientation: &Orientation) -> Vec3 {
    Vec3::from(orientation.up.map(|x| x as f32))
}

/// Centre in world space.
pub fn centre(orientation: &Orientation) -> Vec3 {
    Vec3::from(orientation.centre.map(|x| x as f32))
}

/// Replaces the up direction by the user's, a vector of any length but 0.
#[must_use]
pub fn with_up<'a>(
    orientation: Orientation,
    up: [f64; 3],
    cameras: impl IntoIterator<Item = &'a Camera>,
) -> Orientation {
    let up = DVec3::from(up);
    let up = (up / up.abs().max_element()).normalize();
    let axes: Vec<Axes> = cameras.into_iter().map(Axes::of).collect();
    let rolled = count_rolled(&axes, up);
    Orientation { up: up.to_array(), up_source: UpSource::Hand, rolled, error_degrees: None, ..orientation }
}

/// Returns whether a camera's picture is upright; so is every picture of a view along up.
pub fn is_upright(orientation: &Orientation, camera: &Camera) -> bool {
    has_upright_picture(&Axes::of(camera), orientation.up.into())
}

fn has_upright_picture(axes: &Axes, up: DVec3) -> bool {
    axes.roll(up).is_none_or(|roll| roll.abs() <= FRAC_PI_4)
}

fn count_rolled(axes: &[Axes], up: DVec3) -> usize {
    axes.iter().filter(|camera| !has_upright_picture(camera, up)).count()
}

/// Estimates up, with its source and its standard error in radians if it is determined.
fn estimate_up(axes: &[Axes]) -> (DVec3, UpSource, Option<f64>) {
    let candidates =
        sphere::directions(2 * START_COUNT).take(START_COUNT).map(|start| LevelFit::from(axes, start.into()));
    let best = candidates.min_by(|one, other| one.cost.total_cmp(&other.cost)).expect("there are starts");
    if best.error >= UP_ERROR_MAX_RAD {
        let (up, source) = undetermined_up(axes);
        return (up, source, None);
    }
    let (sign, source) = sign_of_up(axes, best.up);
    (snapped_to_rounding(best.up * sign), source, Some(best.error))
}

/// An axis of up, fitted to level pictures.
struct LevelFit {
    up: DVec3,
    cost: f64,
    /// Standard error in radians; infinite if all level axes are parallel.
    error: f64,
}

impl LevelFit {
    /// Fits up from a start direction, first to all pictures, then without the tilted ones.
    fn from(axes: &[Axes], start: DVec3) -> Self {
        let (up, _) = fit_up(axes, start, |_, _| true);
        let (up, error) = fit_up(axes, up, Axes::is_level);
        let cost = |camera: &Axes| {
            let level = camera.level(up);
            let tilt = if camera.is_level(up) { level.dot(up).powi(2) } else { TILTED_SIN * TILTED_SIN };
            let side = if level == camera.down { SIDEWAYS_COST } else { 0.0 };
            tilt + side + ALONG_UP_COST * camera.forward.dot(up).powi(2)
        };
        Self { up, cost: axes.iter().map(cost).sum(), error }
    }
}

/// Alternates between choosing level axes and fitting up to them until it converges, over the
/// pictures that `counts` selects. Returns up and its standard error.
fn fit_up(axes: &[Axes], start: DVec3, counts: impl Fn(&Axes, DVec3) -> bool) -> (DVec3, f64) {
    let (mut up, mut error) = (start, f64::INFINITY);
    for _ in 0..FIT_ITERATIONS_MAX {
        let level = axes.iter().filter(|camera| counts(camera, up)).map(|camera| camera.level(up));
        let (mut sum, mut count) = (DMat3::ZERO, 0.0);
        for axis in level {
            sum += outer(axis);
            count += 1.0;
        }
        let [(least, vector), (second, _), _] = eigen::symmetric(sum.to_cols_array_2d());
        let variance = (least.max(0.0) + ROLL_PRIOR_RAD * ROLL_PRIOR_RAD) / f64::max(count - 1.0, 1.0);
        error = (variance / second).sqrt();
        let next = DVec3::from(vector);
        let has_converged = next.dot(up).abs() > 1.0 - 1e-15;
        up = next;
        if has_converged || count == 0.0 {
            break;
        }
    }
    (up, if error.is_nan() { f64::INFINITY } else { error })
}

/// Sign of up along its axis, ±1, and its source.
fn sign_of_up(axes: &[Axes], up: DVec3) -> (f64, UpSource) {
    let rolls: Vec<f64> = axes.iter().filter_map(|camera| camera.roll(up)).map(f64::abs).collect();
    let upright = rolls.iter().filter(|roll| **roll <= FRAC_PI_4).count();
    let upside_down = rolls.iter().filter(|roll| **roll >= 3.0 * FRAC_PI_4).count();
    let slope = axes.iter().map(|camera| camera.forward.dot(up)).sum::<f64>() / axes.len() as f64;
    let sum = -axes.iter().map(|camera| camera.down.dot(up)).sum::<f64>();
    if 2 * upright.max(upside_down) > axes.len() {
        (if upright > upside_down { 1.0 } else { -1.0 }, UpSource::Upright)
    } else if slope.abs() > PITCH_SIN_MIN {
        (-slope.signum(), UpSource::Height)
    } else {
        (sum.signum(), UpSource::Level)
    }
}

/// Up direction if the cameras do not determine it.
fn undetermined_up(axes: &[Axes]) -> (DVec3, UpSource) {
    let mean = |axis: fn(&Axes) -> DVec3| axes.iter().map(axis).sum::<DVec3>() / axes.len() as f64;
    let (above, backwards) = (mean(|camera| -camera.down), mean(|camera| -camera.forward));
    if above.length() >= MEAN_LENGTH_MIN {
        (snapped_to_axis(above.normalize()), UpSource::Mean)
    } else if backwards.length() >= MEAN_LENGTH_MIN {
        (snapped_to_axis(backwards.normalize()), UpSource::Nothing)
    } else {
        (DVec3::Z, UpSource::Nothing)
    }
}

/// Axis of the world within [`SNAP_COS`] of `up`, or else `up` itself.
fn snapped_to_axis(up: DVec3) -> DVec3 {
    let close = DVec3::AXES.into_iter().find(|axis| axis.dot(up).abs() > SNAP_COS);
    close.map_or(up, |axis| axis * axis.dot(up).signum())
}

/// Axis of the world within [`ROUNDING`] of `up`, or else `up` itself.
fn snapped_to_rounding(up: DVec3) -> DVec3 {
    let axes = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    axes.into_iter().find(|axis| axis.distance(up) < ROUNDING).unwrap_or(up)
}

/// Estimates the point that the cameras look at.
fn estimate_centre(axes: &[Axes], points: &[[f32; 3]]) -> DVec3 {
    let mean = axes.iter().map(|camera| camera.position).sum::<DVec3>() / axes.len() as f64;
    let spread = median(axes.iter().map(|camera| camera.position.distance(mean)).collect());
    let meeting = meeting_point(axes, AXIS_DISTANCE_MIN * spread);
    let is_before = |point: &DVec3| {
        2 * axes.iter().filter(|camera| camera.forward.dot(*point - camera.position) > 0.0).count() > axes.len()
    };
    meeting.filter(is_before).unwrap_or_else(|| {
        let view = axes.iter().map(|camera| camera.forward).sum::<DVec3>() / axes.len() as f64;
        let view = if view.length() < MEAN_LENGTH_MIN { DVec3::ZERO } else { view.normalize() };
        let depths = points.iter().map(|point| view.dot(DVec3::from(point.map(f64::from)) - mean));
        let seen: Vec<f64> = depths.filter(|depth| *depth > 0.0).collect();
        let depth = if seen.is_empty() { spread } else { median(seen) };
        mean + view * if depth > 0.0 { depth } else { 1.0 }
    })
}

/// Point with the smallest sum of distances from all optical axes, each at least `near`; `None` for
/// parallel axes.
fn meeting_point(axes: &[Axes], near: f64) -> Option<DVec3> {
    let mut weights = vec![1.0; axes.len()];
    let mut point = DVec3::ZERO;
    for _ in 0..REWEIGHT_ITERATIONS {
        let (mut across, mut sum, mut total) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (camera, weight) in axes.iter().zip(&weights) {
            let projection = (DMat3::IDENTITY - outer(camera.forward)) * *weight;
            across += projection;
            sum += projection * camera.position;
            total += weight;
        }
        let [(least, _), ..] = eigen::symmetric(across.to_cols_array_2d());
        if !(least > PARALLEL_SIN2 * total) {
            return None;
        }
        point = across.inverse() * sum;
        for (camera, weight) in axes.iter().zip(&mut weights) {
            *weight = 1.0 / camera.forward.cross(point - camera.position).length().max(near).max(f64::MIN_POSITIVE);
        }
    }
    Some(point)
}

fn outer(axis: DVec3) -> DMat3 {
    DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z)
}

/// Median, or 0 of an empty list.
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

    /// Twice the rounding error of a direction from `f32` rotations of cameras.
    const EXACT: f64 = 2e-6;
    const COUNT: u64 = 40;
    const MIDDLE: Vec3 = Vec3::new(0.3, -0.2, 0.5);

    /// Cameras around [`MIDDLE`] in a world with +z up, at a distance of 4 and at elevations from
    /// `low` to `high`, each picture rolled by quarter turns and by normally distributed `degrees`.
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

    /// Cameras after a similarity transform of the world.
    fn elsewhere(cameras: &[Camera], turn: Quat, scale: f32, shift: Vec3) -> Vec<Camera> {
        let moved = |camera: &Camera| Camera {
            camera_from_world: camera.camera_from_world * Mat3::from_quat(turn.inverse()),
            position: scale * (turn * camera.position) + shift,
            ..*camera
        };
        cameras.iter().map(moved).collect()
    }

    fn of(cameras: &[Camera]) -> Orientation {
        estimate(cameras, &[]).unwrap()
    }

    /// Angle between the estimated up and another direction, in radians.
    fn off(found: &Orientation, up: DVec3) -> f64 {
        DVec3::from(found.up).angle_between(up)
    }

    fn some_turn(seed: u64) -> Quat {
        Quat::from_vec4(glam::Vec4::from_array(core::array::from_fn(|k| normal(seed, 9, k as u64))).normalize())
    }

    #[test]
    fn up_is_found_for_rolled_pictures_in_any_world() {
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
                    // Level pictures on their side do not distinguish above from below.
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
    fn rolled_pictures_are_counted_and_the_source_is_recorded() {
        let found = of(&ring([0.2, 0.6], |k| k % 4 / 3, 0.0));
        assert_eq!((found.cameras, found.rolled, found.up_source), (40, 10, UpSource::Upright));
        let found = of(&ring([0.2, 0.6], |_| 1, 0.0));
        assert_eq!((found.rolled, found.up_source), (40, UpSource::Height));
        let by_hand = with_up(found, [0.0, 0.0, -2.0], &ring([0.2, 0.6], |_| 1, 0.0));
        assert_eq!((by_hand.up, by_hand.up_source, by_hand.error_degrees), ([0.0, 0.0, -1.0], UpSource::Hand, None));
        assert_eq!(with_up(found, [0.0, 1e300, 0.0], &[]).up, [0.0, 1.0, 0.0], "of any length");
        assert!(by_hand.is_valid() && !Orientation { up: [0.0; 3], ..by_hand }.is_valid());
    }

    #[test]
    fn camera_shake_and_tilted_pictures_hardly_matter() {
        for (seed, heights) in [[0.0, 0.3], [0.2, 0.9], [0.5, 1.3]].into_iter().enumerate() {
            let mut cameras = ring(heights, uniform_quarters, 3.0);
            for k in 0..5 {
                cameras[7 * k] = rolled(cameras[7 * k], 0.7);
            }
            let turn = some_turn(seed as u64);
            let found = of(&elsewhere(&cameras, turn, 1.0, Vec3::ZERO));
            let error = off(&found, (turn * Vec3::Z).as_dvec3()).to_degrees();
            // 3° of 35 pictures leave 0.7° in each of two directions; three times as much is one in
            // a hundred.
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
    fn parallel_cameras_use_the_up_of_their_pictures_and_the_depth_of_their_points() {
        let at = |k: u64| {
            let position = Vec3::new(0.2 * k as f32, 0.1 * uniform(3, 0, k), 0.0);
            Camera::look_at(position, position + Vec3::new(0.01 * normal(3, 1, k), 0.0, 5.0), Vec3::NEG_Y, 0.7, 100, 80)
        };
        let cameras: Vec<Camera> = (0..9).map(at).collect();
        let found =
            estimate(&cameras, &[[0.0, 0.0, 6.0], [1.0, 1.0, 7.0], [0.0, 0.0, 90.0], [0.0, 0.0, -9.0]]).unwrap();
        assert!(off(&found, DVec3::NEG_Y) < 0.02, "{found:?}");
        assert_eq!(found.rolled, 0);
        assert!((found.centre[2] - 7.0).abs() < 0.1, "the median of what is seen: {found:?}");
    }

    #[test]
    fn undetermined_orientations_have_a_defined_result() {
        assert!(estimate(&[], &[]).is_none(), "no camera");
        let one = &ring([0.5, 0.5], |_| 0, 0.0)[..1];
        let found = of(one);
        assert_eq!(
            (found.up, found.up_source),
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
        assert!(off(&found, DVec3::Z) < EXACT && found.up_source == UpSource::Height, "of any heading: {found:?}");
        let there_and_back: Vec<Camera> = (0..12).map(|k| down(k, (k % 2) as f32 * TAU as f32 / 2.0)).collect();
        assert_eq!((of(&there_and_back).up, of(&there_and_back).up_source), ([0.0, 0.0, 1.0], UpSource::Nothing));
        let same: Vec<Camera> = (0..12).map(|k| down(k, 0.0)).collect();
        assert_eq!((of(&same).up, of(&same).up_source), ([1.0, 0.0, 0.0], UpSource::Mean), "as if it were a wall");
    }

    #[test]
    fn cameras_that_look_outwards_have_their_centre_among_them() {
        let outwards = |camera: &Camera| Camera { position: 2.0 * MIDDLE - camera.position, ..*camera };
        let turned: Vec<Camera> = ring([0.1, 0.1], |_| 0, 0.0).iter().map(outwards).collect();
        let found = of(&turned);
        assert!(DVec3::from(found.centre).distance(MIDDLE.as_dvec3()) < 2.0, "{found:?}");
        assert!(off(&found, DVec3::Z) < EXACT);
    }

    #[test]
    fn the_estimate_is_equivariant_under_rotations() {
        let cameras = ring([0.0, 0.8], uniform_quarters, 4.0);
        let before = of(&cameras);
        let turn = some_turn(77);
        let after = of(&elsewhere(&cameras, turn, 1.0, Vec3::ZERO));
        let turn = DQuat::from_xyzw(turn.x.into(), turn.y.into(), turn.z.into(), turn.w.into());
        assert!(off(&after, turn * DVec3::from(before.up)) < EXACT);
        assert_eq!((after.rolled, after.up_source), (before.rolled, before.up_source));
        let said = [before, after].map(|found| found.error_degrees.unwrap());
        assert!((said[0] - said[1]).abs() < 1e-4, "{said:?}");
    }
}
