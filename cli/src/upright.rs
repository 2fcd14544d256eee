//! A scene put upright for other programs: up along an axis of theirs, its middle in the origin, its cameras four units away.
//!
//! With R the rotation, c the middle and s the scale, a place p goes to s R (p − c). Means, quats, log scales, normals and
//! harmonics go along exactly; light is resampled.

use glam::{DMat3, DQuat, DVec3, Vec3};
use specula_core::{
    camera::Camera,
    scene::{Environment, Gaussians, LOG_SCALE, MEAN, QUAT, RadianceActivation},
    sh::MAX_COUNT,
    sh_turn,
};
use specula_io::{
    glb::Placement,
    latlong::{self, Stand, UpAxis},
    mesh::Mesh,
    orientation::Orientation,
};

/// How far cameras are from the origin then, in the median: about as in NeRF Synthetic.
const DISTANCE: f64 = 4.0;

/// From the scene's own world to one that is upright.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Upright {
    rotation: DMat3,
    scale: f64,
    centre: DVec3,
}

/// Which way axes of a world point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axes {
    /// x to the right, y up, z to the front: glTF, engines, `.spz`.
    YUp,
    /// x to the right, y down, z to the back: pictures, and viewers of INRIA's files.
    YDown,
    /// x to the right, y to the back, z up: Blender.
    ZUp,
}

impl Axes {
    /// What turns [`Axes::YUp`] into these.
    fn rotation(self) -> DMat3 {
        match self {
            Self::YUp => DMat3::IDENTITY,
            Self::YDown => DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
            Self::ZUp => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
        }
    }
}

impl Upright {
    /// Of a scene with these orientation. `first` is a camera that is in front of it, if there is any.
    pub(crate) fn of(orientation: &Orientation, first: Option<&Camera>, axes: Axes) -> Self {
        let (above, middle) = (DVec3::from(orientation.up), DVec3::from(orientation.centre));
        let beside = |direction: DVec3| direction.reject_from_normalized(above).try_normalize();
        let front = first.and_then(|camera| beside(camera.position.as_dvec3() - middle));
        let front = front.or_else(|| beside(DVec3::NEG_Y)).unwrap_or_else(|| above.any_orthonormal_vector());
        let y_up = DMat3::from_cols(above.cross(front), above, front).transpose();
        Self { rotation: axes.rotation() * y_up, scale: DISTANCE / orientation.distance, centre: middle }
    }

    fn place(&self, point: [f32; 3]) -> [f32; 3] {
        let moved = self.scale * (self.rotation * (DVec3::from(point.map(f64::from)) - self.centre));
        moved.as_vec3().to_array()
    }

    /// A direction, of the same length.
    pub(crate) fn direction(&self, direction: [f32; 3]) -> [f32; 3] {
        (self.rotation * DVec3::from(direction.map(f64::from))).as_vec3().to_array()
    }

    /// Plain Gaussians.
    pub(crate) fn gaussians(&self, gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
        let mut upright = gaussians.clone();
        let (turn, quat) = (sh_turn::turn(self.rows()), DQuat::from_mat3(&self.rotation));
        let (start, count) = (gaussians.layout.sh_start(), gaussians.layout.sh_count());
        for gaussian in 0..gaussians.count {
            upright.set(gaussian, MEAN, self.place(gaussians.get(gaussian, MEAN)));
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

    /// A surface.
    pub(crate) fn mesh(&self, mesh: Mesh) -> Mesh {
        let positions = mesh.positions.into_iter().map(|place| self.place(place)).collect();
        let normals = mesh.normals.into_iter().map(|normal| self.direction(normal)).collect();
        Mesh { positions, normals, ..mesh }
    }

    /// A camera, which sees the upright scene as it saw the scene.
    pub(crate) fn camera(&self, camera: &Camera) -> Camera {
        let back = self.rotation.transpose().as_mat3();
        Camera {
            camera_from_world: camera.camera_from_world * back,
            position: Vec3::from(self.place(camera.position.to_array())),
            near: camera.near * self.scale as f32,
            ..*camera
        }
    }

    /// How a lat-long map of the upright world stands in the scene's own.
    pub(crate) fn stand(&self, map: UpAxis) -> Stand {
        Stand::turned(map, DQuat::from_mat3(&self.rotation.transpose()))
    }

    /// Radiance of a light, bilinear between its texels.
    pub(crate) fn light(&self, values: &[f32], resolution: usize) -> Environment<Vec<f32>> {
        let (axis, radians) = DQuat::from_mat3(&self.rotation).to_axis_angle();
        let values = latlong::turned(values, resolution, axis.to_array(), radians);
        Environment { resolution, activation: RadianceActivation::Identity, values }
    }

    /// The same as a transformation of a node: numbers stay as they are.
    pub(crate) fn placement(&self) -> Placement {
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
