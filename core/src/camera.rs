//! A pinhole camera: looks along +z, x to the right, y down; pixel centres at + ½.
//!
//! Scenes may have any unit. If the cameras spread over less than one unit, their near plane scales
//! with them (`near_of`). Learning rates, thresholds and the cube of random points follow the same
//! extent.

use crate::{
    bin::{TILE_SIZE, tile_count},
    cutoffs::ProjectionModel,
    each,
    light_frame::LightFrame,
    real::Real,
    vector::{Mat3, Vec3, vec3},
};
use glam::{Mat3 as GlamMat3, Vec3 as GlamVec3};

/// Default near plane: Gaussians closer to the camera plane than this are not drawn (INRIA's value,
/// in scene units).
pub const NEAR: f32 = 0.2;

/// Pinhole camera: pose, intrinsics, near plane and size of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Rotation from world to camera axes.
    pub camera_from_world: GlamMat3,
    /// The camera's centre, in world space.
    pub position: GlamVec3,
    /// Focal lengths along x and y, in pixels.
    pub focal_px: [f32; 2],
    /// Principal point, in pixels from the upper left corner.
    pub principal_px: [f32; 2],
    /// Gaussians closer to the camera plane than this are not drawn; at least zero.
    pub near: f32,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Rotation from world axes to those of the picture's light ([`mod@crate::light_frame`]);
    /// `None` for a light that stands still in the world.
    pub light_from_world: Option<GlamMat3>,
    /// Number of the picture's light among those of its scene, from 0; stages are given that light.
    pub light: u32,
    /// Part of the picture to render; `None` for all. Its pixels have the same bits as in the whole
    /// picture, and others may be empty.
    pub scissor: Option<Scissor>,
}

/// Rectangle of pixels of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scissor {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Scissor {
    /// True if the rectangle lies in a picture of this size.
    pub fn fits(&self, width: u32, height: u32) -> bool {
        let ends = |first: u32, len: u32, size: u32| first.checked_add(len).is_some_and(|end| end <= size);
        ends(self.x, self.width, width) && ends(self.y, self.height, height)
    }
}

/// Tiles of a picture that are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileWindow {
    /// First column, and one past the last.
    pub columns: [u32; 2],
    /// First row, and one past the last.
    pub rows: [u32; 2],
}

/// [`Camera::near`] of a scene with this camera extent: [`NEAR`], or less in a scene that is
/// smaller than one unit.
pub fn near_of(extent: f32) -> f32 {
    NEAR * extent.min(1.0)
}

/// Largest difference between R Rᵀ and the identity in the matrix of a camera: that of a rotation
/// written with four digits.
pub const ROTATION_ERROR: f64 = 1e-3;

/// Matrix that is not that of a pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum CameraError {
    /// A number is not finite.
    NotFinite,
    /// The last row of the view matrix is not 0, 0, 0, 1.
    LastRow,
    /// The view matrix scales or shears.
    Rotation,
    /// The intrinsics have a skew, another last row, or a focal length that is not positive.
    Intrinsics,
}

impl core::fmt::Display for CameraError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        out.write_str(match self {
            Self::NotFinite => "a number of the camera's matrices is not finite",
            Self::LastRow => {
                "the last row of the view matrix is not 0, 0, 0, 1; give the matrix from world to camera, row by row"
            }
            Self::Rotation => {
                "the first three columns of the view matrix are no rotation; divide a scale out of the matrix, and \
                 apply it to the scene"
            }
            Self::Intrinsics => {
                "the intrinsics are not fx 0 cx, 0 fy cy, 0 0 1 with positive focal lengths; undistort the picture to \
                 a pinhole without skew"
            }
        })
    }
}

impl core::error::Error for CameraError {}

impl Camera {
    /// A camera at `position` that looks at `target`, with `up` upwards in the picture, and
    /// [`NEAR`] for its near plane.
    ///
    /// `fov_x` is the horizontal field of view in radians, in (0, π). `up` must not be parallel to
    /// the view.
    pub fn look_at(position: GlamVec3, target: GlamVec3, up: GlamVec3, fov_x: f32, width: u32, height: u32) -> Self {
        let forward = (target - position).normalize();
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        let focal = 0.5 * width as f32 / crate::math::tan(0.5 * fov_x);
        Self {
            camera_from_world: GlamMat3::from_cols(right, down, forward).transpose(),
            position,
            focal_px: [focal, focal],
            principal_px: [0.5 * width as f32, 0.5 * height as f32],
            near: NEAR,
            width,
            height,
            light_from_world: None,
            scissor: None,
            light: 0,
        }
    }

    /// Camera of a world-to-camera matrix and of intrinsics, with [`NEAR`] for its near plane.
    ///
    /// `view` holds the rows of \[R | t\], which map a world point to camera space: x to the right,
    /// y down, z along the view (OpenCV). `intrinsics` holds the rows of \[fx 0 cx; 0 fy cy; 0 0
    /// 1\], in pixels, pixel centres at + ½.
    ///
    /// # Errors
    ///
    /// [`CameraError`]: a number that is not finite, an R that is no rotation, or intrinsics of
    /// another form.
    pub fn from_matrices(
        view: &[[f32; 4]; 4],
        intrinsics: &[[f32; 3]; 3],
        width: u32,
        height: u32,
    ) -> Result<Self, CameraError> {
        let [[fx, skew, cx], [zero, fy, cy], last] = *intrinsics;
        let numbers = view.as_flattened().iter().chain(intrinsics.as_flattened());
        if !numbers.fold(0.0_f32, |sum, x| sum + 0.0 * x).is_finite() {
            return Err(CameraError::NotFinite);
        }
        if view[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err(CameraError::LastRow);
        }
        if [skew, zero] != [0.0; 2] || last != [0.0, 0.0, 1.0] || fx <= 0.0 || fy <= 0.0 {
            return Err(CameraError::Intrinsics);
        }
        let wide = |row: [f32; 4]| row.map(f64::from);
        let rows = [wide(view[0]), wide(view[1]), wide(view[2])];
        let dot = |a: [f64; 4], b: [f64; 4]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let is_off = |i: usize, j: usize| {
            let off = dot(rows[i], rows[j]) - f64::from(u8::from(i == j));
            !(-ROTATION_ERROR..=ROTATION_ERROR).contains(&off)
        };
        if (0..3).any(|i| (i..3).any(|j| is_off(i, j))) {
            return Err(CameraError::Rotation);
        }
        let center = |k: usize| -(rows[0][k] * rows[0][3] + rows[1][k] * rows[1][3] + rows[2][k] * rows[2][3]) as f32;
        let [x, y, z] = [view[0], view[1], view[2]].map(|[x, y, z, _]| GlamVec3::new(x, y, z));
        Ok(Self {
            camera_from_world: GlamMat3::from_cols(x, y, z).transpose(),
            position: GlamVec3::new(center(0), center(1), center(2)),
            focal_px: [fx, fy],
            principal_px: [cx, cy],
            near: NEAR,
            width,
            height,
            light_from_world: None,
            scissor: None,
            light: 0,
        })
    }

    /// The same view at another size; focal lengths and principal point scale along. A scissor,
    /// which belongs to the size, is removed here and in all that change the size.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let scale = [width as f32 / self.width as f32, height as f32 / self.height as f32];
        Self {
            focal_px: [self.focal_px[0] * scale[0], self.focal_px[1] * scale[1]],
            principal_px: [self.principal_px[0] * scale[0], self.principal_px[1] * scale[1]],
            width,
            height,
            scissor: None,
            ..*self
        }
    }

    /// The same view with pictures of at most `edge_max` pixels along their longer edge, the other
    /// rounded up.
    #[must_use]
    pub fn limited(&self, edge_max: u32) -> Self {
        let longest = self.width.max(self.height);
        if longest <= edge_max {
            return *self;
        }
        let reduced = |edge: u32| (u64::from(edge) * u64::from(edge_max)).div_ceil(u64::from(longest)) as u32;
        self.resized(reduced(self.width), reduced(self.height))
    }

    /// The view in a frame of another aspect ratio, without distortion: the whole picture at the
    /// largest scale that fits, and more of the scene if the frame is wider or taller. If aspect
    /// ratios agree up to the rounding of a pixel, [`Camera::resized`].
    #[must_use]
    pub fn framed(&self, width: u32, height: u32) -> Self {
        let (old, new) = ([self.width, self.height].map(|n| n as f32), [width, height].map(|n| n as f32));
        let scale = [new[0] / old[0], new[1] / old[1]];
        let is_same_shape = (scale[0] * old[1] - new[1]).abs() < 1.0 || (scale[1] * old[0] - new[0]).abs() < 1.0;
        if is_same_shape {
            return self.resized(width, height);
        }
        let scale = scale[0].min(scale[1]);
        let principal = |axis: usize| (self.principal_px[axis] - 0.5 * old[axis]) * scale + 0.5 * new[axis];
        Self {
            focal_px: self.focal_px.map(|focal| focal * scale),
            principal_px: [principal(0), principal(1)],
            width,
            height,
            scissor: None,
            ..*self
        }
    }

    /// The same view as a picture turned clockwise by 90°: the point (x, y) of the picture moves to
    /// (height − y, x).
    #[must_use]
    pub fn turned_clockwise(&self) -> Self {
        let axes = self.camera_from_world;
        Self {
            camera_from_world: GlamMat3::from_cols(-axes.row(1), axes.row(0), axes.row(2)).transpose(),
            focal_px: [self.focal_px[1], self.focal_px[0]],
            principal_px: [self.height as f32 - self.principal_px[1], self.principal_px[0]],
            width: self.height,
            height: self.width,
            scissor: None,
            ..*self
        }
    }

    /// Clockwise turns of the picture by 90°, 0 to 3, after which the direction `up` in the world
    /// points most nearly up; 0 if `up` is along the line of sight.
    #[must_use]
    pub fn turns_upright(&self, up: GlamVec3) -> usize {
        let up = self.camera_from_world * up;
        let is_across = up.x.abs() > up.y.abs();
        match (is_across, up.x > 0.0, up.y > 0.0) {
            (true, false, _) => 1,
            (true, true, _) => 3,
            (false, _, true) => 2,
            (false, _, false) => 0,
        }
    }

    /// The same view as a picture turned by [`Camera::turns_upright`].
    #[must_use]
    pub fn upright(&self, up: GlamVec3) -> Self {
        (0..self.turns_upright(up)).fold(*self, |camera, _| camera.turned_clockwise())
    }

    /// Tiles that the rendered part of the picture touches.
    pub fn tile_window(&self) -> TileWindow {
        let all = [self.width, self.height];
        let (first, end) = match self.scissor {
            Some(Scissor { x, y, width, height }) => ([x, y], [x.saturating_add(width), y.saturating_add(height)]),
            None => ([0; 2], all),
        };
        let along = |axis: usize| {
            let end = tile_count(end[axis].min(all[axis]));
            [(first[axis] / TILE_SIZE).min(end), end]
        };
        TileWindow { columns: along(0), rows: along(1) }
    }

    /// Width and height of the picture, in pixels.
    pub fn size_px(&self) -> [f32; 2] {
        [self.width as f32, self.height as f32]
    }

    /// The direction from the camera through an image point, in camera space, with z = 1.
    pub fn ray_in_camera(&self, x_px: f32, y_px: f32) -> GlamVec3 {
        GlamVec3::new(
            (x_px - self.principal_px[0]) / self.focal_px[0],
            (y_px - self.principal_px[1]) / self.focal_px[1],
            1.0,
        )
    }

    /// The same camera in the number type of formulas.
    #[inline(always)]
    pub fn lift<R: Real>(&self, like: R) -> CameraOf<R> {
        let [limit_x, limit_y] = self.slope_limit();
        CameraOf {
            camera_from_world: Mat3::constant(like, self.camera_from_world),
            position: Vec3::constant(like, self.position),
            focal_px: [like.constant(self.focal_px[0]), like.constant(self.focal_px[1])],
            principal_px: [like.constant(self.principal_px[0]), like.constant(self.principal_px[1])],
            slope_limit: [like.constant(limit_x), like.constant(limit_y)],
            near: like.constant(self.near),
            light: self.lift_light(like),
        }
    }

    /// The same camera under the scene's first light, which stands still in the world.
    #[must_use]
    pub const fn under_still_light(self) -> Self {
        Self { light_from_world: None, light: 0, ..self }
    }

    /// Axes of the picture's light in the number type of formulas.
    #[inline(always)]
    fn lift_light<R: Real>(&self, like: R) -> LightFrame<R> {
        match self.light_from_world {
            Some(light_from_world) => LightFrame { light_from_world: Some(Mat3::constant(like, light_from_world)) },
            None => LightFrame::WORLD,
        }
    }

    /// 1.3 times the largest |x/z| and |y/z| seen: beyond it the local affine projection is
    /// evaluated at the limit.
    fn slope_limit(&self) -> [f32; 2] {
        let extent = [self.width as f32, self.height as f32];
        core::array::from_fn(|axis| {
            let far_edge = f32::max(self.principal_px[axis], extent[axis] - self.principal_px[axis]);
            SLOPE_MARGIN * far_edge / self.focal_px[axis]
        })
    }
}

/// Limit of the slopes at which the projection's Jacobian is evaluated, in half fields of view
/// (INRIA's value).
pub const SLOPE_MARGIN: f32 = 1.3;

/// A [`Camera`] in the number type of formulas.
#[derive(Clone, Copy, Debug)]
pub struct CameraOf<R> {
    /// Rotation from world to camera axes.
    pub camera_from_world: Mat3<R>,
    /// The camera's centre, in world space.
    pub position: Vec3<R>,
    /// Focal lengths, in pixels.
    pub focal_px: [R; 2],
    /// Principal point, in pixels.
    pub principal_px: [R; 2],
    /// Largest |x/z| and |y/z| at which the Jacobian is evaluated.
    pub slope_limit: [R; 2],
    /// Near plane: only deeper Gaussians are drawn.
    pub near: R,
    /// Axes of the picture's light.
    pub light: LightFrame<R>,
}

impl<R: Real> CameraOf<R> {
    /// The same camera for a projection model: only the affine one limits the slopes of its
    /// Jacobian.
    #[must_use]
    #[inline(always)]
    pub fn for_projection(self, projection: ProjectionModel) -> Self {
        let free = self.slope_limit[0].constant(f32::MAX);
        let slope_limit = if projection == ProjectionModel::Affine { self.slope_limit } else { [free; 2] };
        Self { slope_limit, ..self }
    }
    /// The direction from an image point to the camera, in world space, of unit length.
    #[inline(always)]
    pub fn view_dir(&self, x_px: R, y_px: R) -> Vec3<R> {
        let ray = vec3(
            (x_px - self.principal_px[0]) / self.focal_px[0],
            (y_px - self.principal_px[1]) / self.focal_px[1],
            x_px.constant(1.0),
        );
        let ray = self.camera_from_world.transform_transposed(ray);
        ray * -ray.length_squared().sqrt().recip()
    }
    /// A world point in camera space. The centre is subtracted first, so far from the origin
    /// nothing cancels.
    #[inline(always)]
    pub fn to_camera(&self, point: Vec3<R>) -> Vec3<R> {
        self.camera_from_world.transform(point - self.position)
    }
}

/// Gradient of a camera's pose, as if the nine numbers of its rotation were independent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraGrad<R> {
    /// Gradient of the rotation from world to camera axes.
    pub camera_from_world: Mat3<R>,
    /// Gradient of the camera's centre, in world space.
    pub position: Vec3<R>,
}

impl<R: Real> CameraGrad<R> {
    /// No gradient.
    #[inline(always)]
    pub fn zero(like: R) -> Self {
        Self { camera_from_world: Mat3 { rows: [Vec3::zero(like); 3] }, position: Vec3::zero(like) }
    }
    /// Gradient with these numbers: the rotation by rows, then the centre.
    #[inline(always)]
    pub fn from_rows([x, y, z, position]: [Vec3<R>; 4]) -> Self {
        Self { camera_from_world: Mat3 { rows: [x, y, z] }, position }
    }
    /// All numbers, in the order of [`Self::from_rows`].
    #[inline(always)]
    pub fn rows(&self) -> [Vec3<R>; 4] {
        let [x, y, z] = self.camera_from_world.rows;
        [x, y, z, self.position]
    }
    /// The same where the mask holds, zero elsewhere.
    #[must_use]
    #[inline(always)]
    pub fn keep(self, mask: R::Mask) -> Self {
        Self::from_rows(self.rows().map(|row| each!(row, n => n.keep(mask))))
    }
    /// Gradient of the view matrix \[R | t\] of the same camera, t = −R c: that of R, by rows, and
    /// that of t, as if all twelve numbers were independent.
    ///
    /// With the gradient g of the centre c = −R⁻¹ t, t has −R g, and R gains (−R g) cᵀ.
    pub fn view_matrix(&self, camera: &CameraOf<R>) -> (Mat3<R>, Vec3<R>) {
        let translation = -camera.camera_from_world.transform(self.position);
        let [x, y, z] = self.camera_from_world.rows;
        let center = camera.position;
        let rows = [
            x.add_scaled(translation.x, center),
            y.add_scaled(translation.y, center),
            z.add_scaled(translation.z, center),
        ];
        (Mat3 { rows }, translation)
    }
}
