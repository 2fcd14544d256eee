//! Directions on the faces of a cube: addresses, footprints, solid angles.
//!
//! Faces are +X −X +Y −Y +Z −Z, as in OpenGL, Vulkan and WebGPU. A map of resolution n is stored
//! with an *apron*: each face is surrounded by the neighbouring texels of the adjacent faces, (n +
//! 2)² texels in all. A bilinear footprint then always lies inside one padded face, and lookups are
//! continuous across every edge and corner.
//!
//! A texel beyond an edge is up to half a texel further along it than the bilinear footprint
//! assumes, as in every seamless cube map. So the effective direction of a lookup is up to √2 / 6n
//! off within half a texel of the edges, and up to 1 / n², by the curvature of the face, elsewhere.

use crate::{
    double::Double,
    math,
    real::Real,
    vector::{Vec3, vec3},
};
use core::ops::Sub;

/// Faces of a cube.
pub const FACE_COUNT: usize = 6;

/// Numbers of texels of a map with apron.
pub const fn padded_len(resolution: usize) -> usize {
    FACE_COUNT * (resolution + 2) * (resolution + 2)
}

/// Index of a texel in a map without apron.
pub const fn texel_index(face: usize, column: usize, row: usize, resolution: usize) -> usize {
    (face * resolution + row) * resolution + column
}

/// Face, column and row of a texel by its index in a map without apron, the inverse of
/// [`texel_index`].
pub const fn texel_of_index(index: usize, resolution: usize) -> (usize, usize, usize) {
    let area = resolution * resolution;
    (index / area, index % resolution, index % area / resolution)
}

/// Index of a texel in a map with apron; column and row run from −1 to the resolution.
pub const fn padded_index(face: usize, column: isize, row: isize, resolution: usize) -> usize {
    let width = resolution + 2;
    (face * width + (row + 1) as usize) * width + (column + 1) as usize
}

/// The direction, not of unit length, of a point (u, v) in \[−1, 1\]² on a face; v points down the
/// rows.
pub fn direction(face: usize, u: f64, v: f64) -> [f64; 3] {
    match face {
        0 => [1.0, -v, -u],
        1 => [-1.0, -v, u],
        2 => [u, 1.0, v],
        3 => [u, -1.0, -v],
        4 => [u, -v, 1.0],
        _ => [-u, -v, -1.0],
    }
}

/// Unit direction of a texel's centre.
pub fn texel_direction(face: usize, column: usize, row: usize, resolution: usize) -> [f64; 3] {
    let centre = |k: usize| (2 * k + 1) as f64 / resolution as f64 - 1.0;
    let d = direction(face, centre(column), centre(row));
    let length = math::sqrt64(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    d.map(|c| c / length)
}

/// Solid angle of a texel, in steradians; all texels of a map sum to 4π.
///
/// The rectangle from (0, 0) to (x, y) on the plane z = 1 covers atan2(xy, √(x² + y² + 1)).
pub fn texel_solid_angle(column: usize, row: usize, resolution: usize) -> f64 {
    let corner = |x: f64, y: f64| math::atan264(x * y, math::sqrt64(x * x + y * y + 1.0));
    let edge = |k: usize| 2.0 * k as f64 / resolution as f64 - 1.0;
    let (x0, x1, y0, y1) = (edge(column), edge(column + 1), edge(row), edge(row + 1));
    corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
}

/// [`texel_solid_angle`] of all texels of a map without apron, in the order of [`texel_index`].
pub fn solid_angles(resolution: usize) -> impl Iterator<Item = f64> {
    (0..FACE_COUNT * resolution * resolution)
        .map(move |index| texel_solid_angle(index % resolution, index / resolution % resolution, resolution))
}

/// Surrounds a map with its apron, in the caller's memory: `texel` reads the map without apron by
/// [`texel_index`].
///
/// # Panics
///
/// If `padded` has not [`padded_len`] texels.
pub fn pad<R: Real>(resolution: usize, texel: impl Fn(usize) -> Vec3<R>, padded: &mut [Vec3<R>]) {
    assert_eq!(padded.len(), padded_len(resolution), "a padded map has (resolution + 2)² texels a face");
    let (width, inside) = (resolution + 2, 0..resolution as isize);
    for (index, color) in padded.iter_mut().enumerate() {
        let [row, column] = [index / width % width, index % width].map(|k| k as isize - 1);
        let face = index / (width * width);
        *color = if inside.contains(&row) && inside.contains(&column) {
            texel(texel_index(face, column as usize, row as usize, resolution))
        } else {
            let Apron { texels: [first, others @ ..], count } = apron_sources(face, column, row, resolution);
            let sum = others[..count - 1].iter().fold(texel(first), |sum, other| sum + texel(*other));
            sum * sum.x.constant(1.0 / count as f32)
        };
    }
}

/// Source texels of an apron texel in the map without apron: one across an edge; at a corner, where
/// three faces meet, the mean of the three around it. Column and row are those of [`padded_index`].
pub fn apron_sources(face: usize, column: isize, row: isize, resolution: usize) -> Apron {
    let last = resolution as isize - 1;
    let (inner_column, inner_row) = (column.clamp(0, last), row.clamp(0, last));
    let across = |column, row| neighbour(face, column, row, resolution);
    if inner_column == column || inner_row == row {
        return Apron { texels: [across(column, row); 3], count: 1 };
    }
    Apron { texels: [across(inner_column, inner_row), across(column, inner_row), across(inner_column, row)], count: 3 }
}

/// Source of an apron texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Apron {
    /// Indices into the map without apron.
    pub texels: [usize; 3],
    /// Number of texels in use, each with weight 1 / count.
    pub count: usize,
}

fn neighbour(face: usize, column: isize, row: isize, resolution: usize) -> usize {
    const JUST_BEYOND: f64 = 1.0 + 1e-9;
    let centre = |k: isize| ((2 * k + 1) as f64 / resolution as f64 - 1.0).clamp(-JUST_BEYOND, JUST_BEYOND);
    let d = direction(face, centre(column), centre(row));
    let (face, u, v) = face_of(d);
    let texel = |u: f64| (((u + 1.0) * 0.5 * resolution as f64) as usize).min(resolution - 1);
    texel_index(face, texel(u), texel(v), resolution)
}

/// Face and position on it, for hosts.
pub fn face_of([x, y, z]: [f64; 3]) -> (usize, f64, f64) {
    let point = project(vec3(Double(x), Double(y), Double(z)));
    (point.face.0 as usize, point.u.0, point.v.0)
}

/// A direction as a point on a face, with the inputs of its gradient.
#[derive(Clone, Copy, Debug)]
pub struct FacePoint<R: Real> {
    /// The face, 0 to 5.
    pub face: R,
    /// Position along the columns, in \[−1, 1\].
    pub u: R,
    /// Position down the rows, in \[−1, 1\].
    pub v: R,
    inverse_major: R,
    sign: R,
    is_y: R::Mask,
    is_z: R::Mask,
}

/// The point of the cube that a direction, not zero, passes through.
#[inline(always)]
pub fn project<R: Real>(d: Vec3<R>) -> FacePoint<R> {
    let one = d.x.constant(1.0);
    let (ax, ay, az) = (d.x.abs(), d.y.abs(), d.z.abs());
    let is_z = ax.max(ay).less(az);
    let is_y = ax.less(ay) & !is_z;
    let choose = |x: R, y: R, z: R| R::select(is_z, z, R::select(is_y, y, x));

    let major = choose(d.x, d.y, d.z);
    let sign = R::select(major.less(d.x.zero()), -one, one);
    let size = major.abs();
    let inverse_major = R::select(size.zero().less(size), size, one).recip();
    let across = choose(-d.z * sign, d.x, d.x * sign);
    let down = choose(-d.y, d.z * sign, -d.y);
    FacePoint {
        face: choose(one.zero(), one * 2.0, one * 4.0) + (one - sign) * 0.5,
        u: across * inverse_major,
        v: down * inverse_major,
        inverse_major,
        sign,
        is_y,
        is_z,
    }
}

/// Gradient of `u` and `v` of [`project`] with respect to the direction.
#[inline(always)]
pub fn project_vjp<R: Real>(point: &FacePoint<R>, grad_u: R, grad_v: R) -> Vec3<R> {
    let choose = |x: R, y: R, z: R| R::select(point.is_z, z, R::select(point.is_y, y, x));
    let across = grad_u * point.inverse_major;
    let down = grad_v * point.inverse_major;
    let major = -(across * point.u + down * point.v) * point.sign;
    vec3(
        choose(major, across, across * point.sign),
        choose(-down, major, -down),
        choose(-across * point.sign, down * point.sign, major),
    )
}

/// Four neighbouring texels of a padded map, and the position of a point between them.
#[derive(Clone, Copy, Debug)]
pub struct TexelFootprint<R> {
    /// Index of the upper left texel; the others are at + 1, + (n + 2) and + (n + 3).
    pub texel: R,
    /// Weight of the right column, in \[0, 1\].
    pub right: R,
    /// Weight of the lower row, in \[0, 1\].
    pub lower: R,
}

/// The bilinear footprint of a point on a map of this resolution. Indices are exact up to
/// [`crate::prefilter::RESOLUTION_MAX`].
#[inline(always)]
pub fn footprint<R: Real>(point: &FacePoint<R>, resolution: R) -> TexelFootprint<R> {
    let half = resolution * 0.5;
    let last = resolution - 0.5;
    // From the centre of the apron's first texel, so in [½, n + ½].
    let x = (point.u + 1.0).mul_add(half, half.constant(0.5)).max(half.constant(0.5)).min(last + 1.0);
    let y = (point.v + 1.0).mul_add(half, half.constant(0.5)).max(half.constant(0.5)).min(last + 1.0);
    let (column, row) = (x.floor(), y.floor());
    let width = resolution + 2.0;
    TexelFootprint { texel: (point.face * width + row) * width + column, right: x - column, lower: y - row }
}

/// Colour that is interpolated, in whatever form an executor reads it from memory; `R` is a weight.
pub trait TexelColor<R>: Copy + Sub<Output = Self> {
    /// self + factor · other.
    #[must_use]
    fn add_scaled(self, factor: R, other: Self) -> Self;
}

impl<R: Real> TexelColor<R> for Vec3<R> {
    #[inline(always)]
    fn add_scaled(self, factor: R, other: Self) -> Self {
        Self::add_scaled(self, factor, other)
    }
}

/// Bilinear mean of four texels, and its slopes.
#[derive(Clone, Copy, Debug)]
pub struct BilinearSample<C> {
    /// The mean.
    pub mean: C,
    /// Slope along the columns, per texel.
    pub to_right: C,
    /// Slope down the rows, per texel.
    pub downwards: C,
}

/// Bilinear mean, with its slopes, of the four texels of a footprint: upper left, upper right,
/// lower left, lower right.
#[inline(always)]
pub fn bilinear_sample<R: Copy, C: TexelColor<R>>([a, b, c, d]: [C; 4], right: R, lower: R) -> BilinearSample<C> {
    let (top, bottom) = (b - a, d - c);
    let upper = a.add_scaled(right, top);
    let downwards = c.add_scaled(right, bottom) - upper;
    BilinearSample {
        mean: upper.add_scaled(lower, downwards),
        to_right: top.add_scaled(lower, bottom - top),
        downwards,
    }
}

/// Mean of [`bilinear_sample`].
#[inline(always)]
pub fn bilinear<R: Real>(texels: [Vec3<R>; 4], right: R, lower: R) -> Vec3<R> {
    bilinear_sample(texels, right, lower).mean
}

/// Gradient of [`bilinear`] with respect to `right` and `lower`.
#[inline(always)]
pub fn bilinear_vjp<R: Real>(texels: [Vec3<R>; 4], right: R, lower: R, grad: Vec3<R>) -> (R, R) {
    let BilinearSample { to_right, downwards, .. } = bilinear_sample(texels, right, lower);
    (grad.dot(to_right), grad.dot(downwards))
}

/// Weights of the four texels in [`bilinear`], by which their gradients are multiplied.
#[inline(always)]
pub fn bilinear_weights<R: Real>(right: R, lower: R) -> [R; 4] {
    let (left, upper) = (-right + 1.0, -lower + 1.0);
    [left * upper, right * upper, left * lower, right * lower]
}
