//! Upright placement of a scene for other programs: up along one of their axes, the centre at the
//! origin, the cameras at a median distance of four units.
//!
//! Gaussians are transformed exactly ([`Similarity`]); light is resampled.

use crate::Similarity;
use glam::{DMat3, DQuat, DVec3, Vec3};
use specula_core::{
    camera::Camera,
    scene::{Environment, Gaussians, RadianceActivation},
};
use specula_io::{
    glb::Placement,
    latlong::{self, MapOrientation, UpAxis},
    mesh::Mesh,
    orientation::Orientation,
};

/// Median distance of the cameras from the origin, about that of NeRF Synthetic.
const CAMERA_DISTANCE: f64 = 4.0;

/// Similarity transform from the world of a scene to an upright one.
#[derive(Clone, Copy, Debug)]
pub struct Upright {
    similarity: Similarity,
}

/// Axes of an upright world, right-handed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisConvention {
    /// x right, y up, z to the front: glTF, game engines, `.spz`.
    YUp,
    /// x right, y down, z to the back: pictures, and viewers of INRIA's files.
    YDown,
    /// x right, y to the back, z up: Blender.
    ZUp,
}

impl AxisConvention {
    /// Rotation from [`AxisConvention::YUp`].
    fn rotation(self) -> DMat3 {
        match self {
            Self::YUp => DMat3::IDENTITY,
            Self::YDown => DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
            Self::ZUp => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
        }
    }
}

impl Upright {
    /// Transform of a scene. `front` is a camera in front of it; without one, −y of the scene's
    /// world is the front.
    pub fn new(orientation: &Orientation, front: Option<&Camera>, axes: AxisConvention) -> Self {
        let (up, centre) = (DVec3::from(orientation.up), DVec3::from(orientation.centre));
        let horizontal = |direction: DVec3| direction.reject_from_normalized(up).try_normalize();
        let front = front.and_then(|camera| horizontal(camera.position.as_dvec3() - centre));
        let front = front.or_else(|| horizontal(DVec3::NEG_Y)).unwrap_or_else(|| up.any_orthonormal_vector());
        let y_up = DMat3::from_cols(up.cross(front), up, front).transpose();
        let scale = CAMERA_DISTANCE / orientation.distance;
        Self { similarity: Similarity { rotation: axes.rotation() * y_up, scale, centre, translation: DVec3::ZERO } }
    }

    /// Only the rotation to the up axis: −y of a world with +z up becomes the front. Positions keep
    /// their origin and scale.
    pub fn turned(orientation: &Orientation, axes: AxisConvention) -> Self {
        let Similarity { rotation, .. } = Self::new(orientation, None, axes).similarity;
        let similarity = Similarity { rotation, scale: 1.0, centre: DVec3::ZERO, translation: DVec3::ZERO };
        Self { similarity }
    }

    /// Half a turn about x, between worlds with y up and worlds with y down.
    pub fn half_turn() -> Self {
        let rotation = AxisConvention::YDown.rotation();
        let similarity = Similarity { rotation, scale: 1.0, centre: DVec3::ZERO, translation: DVec3::ZERO };
        Self { similarity }
    }

    /// Point, transformed.
    pub fn point(&self, point: [f32; 3]) -> [f32; 3] {
        self.similarity.point(point)
    }

    /// Direction, rotated, of the same length.
    pub fn direction(&self, direction: [f32; 3]) -> [f32; 3] {
        self.similarity.direction(direction)
    }

    /// Gaussians, transformed.
    pub fn gaussians(&self, gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
        let mut upright = gaussians.clone();
        self.similarity.transform(&mut upright, 0..gaussians.count);
        upright
    }

    /// Mesh, transformed.
    pub fn mesh(&self, mesh: Mesh) -> Mesh {
        let positions = mesh.positions.into_iter().map(|point| self.point(point)).collect();
        let normals = mesh.normals.into_iter().map(|normal| self.direction(normal)).collect();
        Mesh { positions, normals, ..mesh }
    }

    /// Camera with the same picture of the upright scene.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let Similarity { rotation, scale, .. } = self.similarity;
        let world_from_upright = rotation.transpose().as_mat3();
        Camera {
            camera_from_world: camera.camera_from_world * world_from_upright,
            position: Vec3::from(self.point(camera.position.to_array())),
            near: camera.near * scale as f32,
            ..*camera
        }
    }

    /// Orientation in the scene's world of a lat-long map in the upright world.
    pub fn map_orientation(&self, map: UpAxis) -> MapOrientation {
        MapOrientation::rotated(map, DQuat::from_mat3(&self.similarity.rotation.transpose()))
    }

    /// Radiance of a cube map, rotated, bilinear between its texels.
    pub fn light(&self, values: &[f32], resolution: usize) -> Environment<Vec<f32>> {
        let (axis, radians) = DQuat::from_mat3(&self.similarity.rotation).to_axis_angle();
        let values = latlong::rotated(values, resolution, axis.to_array(), radians);
        Environment { resolution, activation: RadianceActivation::Identity, values }
    }

    /// Transform of a glTF node, for numbers that stay in the scene's world.
    pub fn node_transform(&self) -> Placement {
        let Similarity { rotation, scale, centre, .. } = self.similarity;
        Placement {
            rotation: DQuat::from_mat3(&rotation).to_array(),
            translation: (-scale * (rotation * centre)).to_array(),
            scale,
        }
    }
}
