//! Lights that turn with the camera: of an object on a turntable, or of a lamp on the camera.
//!
//! The world is that of the object. With the rotation C from world to camera axes, and C₀ that of
//! the first training picture, the light of a picture has the axes
//!
//! ```text
//! camera      R = C₀ᵀ C                            all of the camera's motion
//! turntable   R = the twist of C₀ᵀ C about up      only its turns about the table's axis
//! ```
//!
//! from world to light, so the light of the first picture is that of the world. A twist is the
//! rotation about an axis that is left when the swing of the axis is taken away: the difference of
//! the cameras' azimuths, whatever their elevations and their common roll.

use glam::{DMat3, DQuat, DVec3, Mat3, Vec3};
use specula_core::camera::Camera;

/// Squared length of a twist's quat below which the swing is by 180°, and the twist any.
const TWIST_MIN: f64 = 1e-12;

/// Thing against which the light of a capture stands still.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightFollows {
    /// The object: it was not moved.
    #[default]
    Scene,
    /// The camera's turns about the up direction: the object stood on a turntable.
    Turntable,
    /// The camera: the lamp was on it, or the object was held and turned before it.
    Camera,
}

impl LightFollows {
    /// Name of the option and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Turntable => "turntable",
            Self::Camera => "camera",
        }
    }
    /// The one of a name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Scene, Self::Turntable, Self::Camera].into_iter().find(|follows| follows.name() == name)
    }
}

/// Light that turns with the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowingLight {
    follows: LightFollows,
    /// Rotation from world to camera axes of the first training picture.
    first: Mat3,
    /// Up direction, a unit vector.
    up: Vec3,
}

impl FollowingLight {
    /// Light of pictures of which the first has this camera; `None` for a light that stands still
    /// in the scene. `up` is the axis of a turntable, a unit vector.
    pub fn new(follows: LightFollows, first: &Camera, up: Vec3) -> Option<Self> {
        (follows != LightFollows::Scene).then_some(Self { follows, first: first.camera_from_world, up })
    }

    /// Rotation from world axes to those of the light in a camera's picture.
    pub fn light_from_world(&self, camera: &Camera) -> Mat3 {
        let relative = self.first.as_dmat3().transpose() * camera.camera_from_world.as_dmat3();
        let relative = DQuat::from_mat3(&relative);
        let turn = match self.follows {
            LightFollows::Turntable => twist(relative, self.up.as_dvec3()),
            _ => relative.normalize(),
        };
        DMat3::from_quat(turn).as_mat3()
    }
}

/// Rotation from world to light in a picture of an object that was turned about a unit axis, by
/// degrees, counterclockwise from above.
pub fn light_of_turned_object(up: Vec3, degrees: f64) -> Mat3 {
    DMat3::from_axis_angle(up.as_dvec3(), degrees.to_radians()).as_mat3()
}

/// Twist of a rotation about a unit axis; none where the swing of the axis is by 180°.
fn twist(rotation: DQuat, axis: DVec3) -> DQuat {
    let along = rotation.xyz().dot(axis);
    let turn = DQuat::from_vec4((axis * along).extend(rotation.w));
    if turn.length_squared() < TWIST_MIN { DQuat::IDENTITY } else { turn.normalize() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of poses in `f32`.
    const ROUNDING: f32 = 1e-5;

    /// A camera at an azimuth and an elevation in degrees, rolled.
    fn camera(azimuth: f32, elevation: f32, roll: f32) -> Camera {
        let [azimuth, elevation, roll] = [azimuth, elevation, roll].map(f32::to_radians);
        let eye = Vec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        let camera = Camera::look_at(3.0 * eye, Vec3::ZERO, Vec3::Z, 0.7, 32, 32);
        Camera { camera_from_world: Mat3::from_rotation_z(roll) * camera.camera_from_world, ..camera }
    }

    #[test]
    fn the_light_of_a_turntable_turns_by_the_azimuth() {
        for roll in [0.0, 90.0] {
            let first = camera(20.0, 10.0, roll);
            let light = FollowingLight::new(LightFollows::Turntable, &first, Vec3::Z).expect("it follows");
            for (azimuth, elevation) in [(20.0, 10.0), (20.0, 70.0), (110.0, 10.0), (199.0, -40.0), (330.0, 85.0)] {
                let expected = Mat3::from_rotation_z((20.0_f32 - azimuth).to_radians());
                let found = light.light_from_world(&camera(azimuth, elevation, roll));
                assert!(found.abs_diff_eq(expected, ROUNDING), "{azimuth}, {elevation}, {roll}: {found}");
            }
        }
    }

    #[test]
    fn the_light_of_a_camera_keeps_its_place_in_every_picture() {
        let first = camera(20.0, 10.0, 0.0);
        let light = FollowingLight::new(LightFollows::Camera, &first, Vec3::Z).expect("it follows");
        let lamp = Vec3::new(0.3, -0.5, -0.2);
        let in_light = first.camera_from_world.transpose() * lamp;
        for (azimuth, elevation, roll) in [(20.0, 10.0, 0.0), (75.0, 60.0, 30.0), (201.0, -20.0, 0.0)] {
            let camera = camera(azimuth, elevation, roll);
            let in_world = camera.camera_from_world.transpose() * lamp;
            assert!((light.light_from_world(&camera) * in_world).abs_diff_eq(in_light, ROUNDING));
        }
        // Cameras at one height see a turntable and a light of theirs alike.
        let table = FollowingLight::new(LightFollows::Turntable, &first, Vec3::Z).expect("it follows");
        let other = camera(140.0, 10.0, 0.0);
        assert!(light.light_from_world(&other).abs_diff_eq(table.light_from_world(&other), ROUNDING));
    }

    #[test]
    fn a_light_that_stands_still_does_not_follow() {
        assert_eq!(FollowingLight::new(LightFollows::Scene, &camera(0.0, 0.0, 0.0), Vec3::Z), None);
    }
}
