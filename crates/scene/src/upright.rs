//! Upright placement of a scene for other programs: up along one of their axes, the centre at the
//! origin, the cameras at a median distance of four units.
//!
//! With the rotation R, the centre c and the scale s, a point p becomes s R (p − c). Means, quats,
//! log scales, normals and harmonics are transformed exactly; light is resampled.

use glam::{DMat3, DQuat, DVec3, Vec3};
use specula_core::{
    camera::Camera,
    scene::{Environment, Gaussians, LOG_SCALE, MEAN, QUAT, RadianceActivation},
    sh::MAX_COUNT,
    sh_turn,
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
    rotation: DMat3,
    scale: f64,
    centre: DVec3,
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
        Self { rotation: axes.rotation() * y_up, scale: CAMERA_DISTANCE / orientation.distance, centre }
    }

    /// Point, transformed.
    pub fn point(&self, point: [f32; 3]) -> [f32; 3] {
        let moved = self.scale * (self.rotation * (DVec3::from(point.map(f64::from)) - self.centre));
        moved.as_vec3().to_array()
    }

    /// Direction, rotated, of the same length.
    pub fn direction(&self, direction: [f32; 3]) -> [f32; 3] {
        (self.rotation * DVec3::from(direction.map(f64::from))).as_vec3().to_array()
    }

    /// Gaussians without shading attributes, transformed.
    pub fn gaussians(&self, gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
        let mut upright = gaussians.clone();
        let (turn, quat) = (sh_turn::turn(self.rows()), DQuat::from_mat3(&self.rotation));
        let (start, count) = (gaussians.layout.sh_start(), gaussians.layout.sh_count());
        for gaussian in 0..gaussians.count {
            upright.set(gaussian, MEAN, self.point(gaussians.get(gaussian, MEAN)));
            let [w, x, y, z] = gaussians.get::<4>(gaussian, QUAT).map(f64::from);
            let turned = (quat * DQuat::from_xyzw(x, y, z, w)).as_quat();
            upright.set(gaussian, QUAT, [turned.w, turned.x, turned.y, turned.z]);
            let log_scales = gaussians.get::<3>(gaussian, LOG_SCALE);
            upright.set(gaussian, LOG_SCALE, log_scales.map(|log_scale| log_scale + self.scale.ln() as f32));
            let mut harmonics = [[0.0; 3]; MAX_COUNT];
            (0..count).for_each(|k| harmonics[k] = gaussians.get(gaussian, start + 3 * k));
            let harmonics = sh_turn::turned(&turn, &harmonics);
            (0..count).for_each(|k| upright.set(gaussian, start + 3 * k, harmonics[k]));
        }
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
        let world_from_upright = self.rotation.transpose().as_mat3();
        Camera {
            camera_from_world: camera.camera_from_world * world_from_upright,
            position: Vec3::from(self.point(camera.position.to_array())),
            near: camera.near * self.scale as f32,
            ..*camera
        }
    }

    /// Orientation in the scene's world of a lat-long map in the upright world.
    pub fn map_orientation(&self, map: UpAxis) -> MapOrientation {
        MapOrientation::rotated(map, DQuat::from_mat3(&self.rotation.transpose()))
    }

    /// Radiance of a cube map, rotated, bilinear between its texels.
    pub fn light(&self, values: &[f32], resolution: usize) -> Environment<Vec<f32>> {
        let (axis, radians) = DQuat::from_mat3(&self.rotation).to_axis_angle();
        let values = latlong::rotated(values, resolution, axis.to_array(), radians);
        Environment { resolution, activation: RadianceActivation::Identity, values }
    }

    /// Transform of a glTF node, for numbers that stay in the scene's world.
    pub fn node_transform(&self) -> Placement {
        Placement {
            rotation: DQuat::from_mat3(&self.rotation).to_array(),
            translation: (-self.scale * (self.rotation * self.centre)).to_array(),
            scale: self.scale,
        }
    }

    fn rows(&self) -> [[f64; 3]; 3] {
        self.rotation.transpose().to_cols_array_2d()
    }
}
