//! Parts of a scene to keep: a region, or the objects on a plane in it, such as a table.
//!
//! The plane is found among the vertices of the scene's surface with upward normals: the height
//! that most of them share, then the plane with the least squared distances from the vertices near
//! it. Objects are the connected parts of the Gaussians above it, and what is at the height of the
//! plane below them: their feet, since the plane of a blurred surface lies too high. Remains of
//! walls are neither connected with them nor small.

use crate::foreground::Foreground;
use core::{fmt, str::FromStr};
use glam::{DMat3, DVec3, Vec3};
use specula_core::{
    activation::sigmoid,
    near_field::NearField,
    region::Ball,
    scene::{Gaussians, LOG_SCALE, MEAN, OPACITY},
};
use std::collections::{BTreeMap, BTreeSet};

/// Part of a scene to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Crop {
    /// A region.
    Region(Foreground),
    /// Objects on a plane in the region of [`Foreground::Auto`].
    Object,
}

/// Text that is not a [`Crop`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("use auto, object, a share of the cameras' distance such as 0.5, or a ball as X,Y,Z,RADIUS")]
pub struct InvalidCrop;

impl FromStr for Crop {
    type Err = InvalidCrop;

    fn from_str(text: &str) -> Result<Self, InvalidCrop> {
        match text.parse() {
            _ if text == "object" => Ok(Self::Object),
            Ok(region) if region != Foreground::All => Ok(Self::Region(region)),
            _ => Err(InvalidCrop),
        }
    }
}

impl fmt::Display for Crop {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Region(region) => region.fmt(out),
            Self::Object => out.write_str("object"),
        }
    }
}

/// Cosine of the largest angle between up and a normal of the plane's vertices.
const COS_MAX: f32 = 0.87;
/// Slices of the ball's height in the search for the plane, and those that it may fill.
const SLICES: usize = 80;
const THICKNESS: usize = 3;
/// Greatest height above the centre, as a share of the radius: a lid is higher.
const HEIGHT_MAX: f32 = 0.25;
/// Least number of vertices of the plane, and their least share of those with upward normals.
const COUNT_MIN: usize = 64;
const SHARE_MIN: f32 = 0.15;
/// Repetitions of the fit, each without the vertices that are far from the plane.
const FITS: usize = 3;
/// Distances from the plane, as multiples of their standard deviation, that its margin covers.
const DEVIATIONS: f64 = 2.0;
/// The same for the distances of the points that are fitted.
const FITTED_DEVIATIONS: f64 = 3.0;
/// Least and greatest margin above the plane, as shares of the radius.
const MARGIN: [f64; 2] = [0.01, 0.03];

/// Largest deviation of an object's Gaussians, as a share of the radius: those of blurred walls are
/// larger.
const DEVIATION_MAX: f32 = 0.1;
/// Edge of a cell in the search for connected parts, as a share of the radius, and the least sum of
/// the opacities in a cell of such a part.
const CELL: f32 = 0.04;
const OPACITY_MIN: f32 = 0.5;
/// Least share of a part in the opacities of the greatest one.
const PART_MIN: f32 = 0.05;
/// Cells above the plane that make the outline of the objects' feet, and depth of the feet below
/// it, as a share of the radius.
const OUTLINE: i32 = 2;
const FOOT: f32 = 0.12;

/// Plane that an object stands on, with a margin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Support {
    center: Vec3,
    radius: f32,
    /// East and north.
    axes: [Vec3; 2],
    /// Its normal over the cosine of its angle to up.
    slope: Vec3,
    level: f32,
}

/// Objects that stand on a plane.
#[derive(Clone, Debug)]
pub(crate) struct Objects {
    support: Support,
    /// Cells of their connected parts, and those around them: east, north, height above the plane.
    cells: BTreeSet<[i32; 3]>,
    /// Columns of cells with a foot.
    feet: BTreeSet<[i32; 2]>,
}

impl Objects {
    /// Objects among Gaussians in a ball.
    pub(crate) fn on(support: Support, gaussians: &Gaussians<Vec<f32>>, ball: &Ball) -> Self {
        let mut opacities: BTreeMap<[i32; 3], f32> = BTreeMap::new();
        for index in (0..gaussians.count).filter(|index| support.takes(gaussians, *index)) {
            let mean = gaussians.get::<3>(index, MEAN);
            if ball.contains(mean) && support.is_below(mean) {
                let [opacity] = gaussians.get::<1>(index, OPACITY).map(sigmoid);
                *opacities.entry(support.cell(mean)).or_default() += opacity;
            }
        }
        opacities.retain(|_, opacity| *opacity >= OPACITY_MIN);
        let parts = connected(&opacities);
        let weight = |part: &Vec<[i32; 3]>| part.iter().map(|cell| opacities[cell]).sum::<f32>();
        let greatest = parts.iter().map(weight).fold(0.0, f32::max);
        let large = parts.iter().filter(|part| weight(part) >= PART_MIN * greatest).flatten();
        let own: BTreeSet<[i32; 3]> = large.copied().collect();
        let feet = own.iter().filter(|[.., height]| *height < OUTLINE).map(|[east, north, _]| [*east, *north]);
        Self { support, feet: feet.collect(), cells: own.iter().flat_map(around).collect() }
    }

    /// Whether a point belongs to an object.
    pub(crate) fn contain(&self, point: [f32; 3]) -> bool {
        let [east, north, height] = self.support.cell(point);
        match self.support.is_below(point) {
            true => self.cells.contains(&[east, north, height]),
            false => self.support.height(point) > -FOOT * self.support.radius && self.feet.contains(&[east, north]),
        }
    }
}

/// A cell and its 26 neighbours.
fn around([x, y, z]: &[i32; 3]) -> impl Iterator<Item = [i32; 3]> + use<> {
    let [x, y, z] = [*x, *y, *z];
    (0..27).map(move |k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1])
}

/// Connected parts of cells.
fn connected(cells: &BTreeMap<[i32; 3], f32>) -> Vec<Vec<[i32; 3]>> {
    let mut left: BTreeSet<[i32; 3]> = cells.keys().copied().collect();
    let mut parts = Vec::new();
    while let Some(first) = left.iter().next().copied() {
        left.remove(&first);
        let mut part = vec![first];
        let mut next = 0;
        while let Some(cell) = part.get(next).copied() {
            part.extend(around(&cell).filter(|other| left.remove(other)));
            next += 1;
        }
        parts.push(part);
    }
    parts
}

impl Support {
    /// Plane of a surface in a ball; `None` if too few vertices lie on one.
    pub(crate) fn of(surface: &NearField<Vec<f32>>, ball: &Ball, up: Vec3) -> Option<Self> {
        let center = Vec3::from(ball.center);
        let axes = <[Vec3; 2]>::from(up.any_orthonormal_pair());
        // East, north and height, relative to the radius.
        let place = |vertex: usize| {
            let numbers = surface.vertex(vertex);
            let [position, normal] = [0, 3].map(|from| Vec3::from_slice(&numbers[from..]));
            let faces_up = normal.normalize_or_zero().dot(up) > COS_MAX;
            let from_center = (position - center) / ball.radius;
            (faces_up && ball.contains(position.to_array()))
                .then(|| Vec3::new(axes[0].dot(from_center), axes[1].dot(from_center), up.dot(from_center)))
        };
        let places: Vec<Vec3> = (0..surface.vertex_count).filter_map(place).collect();
        let mut counts = [0_usize; SLICES];
        let slice = |height: f32| ((0.5 * (height + 1.0) * SLICES as f32) as usize).min(SLICES - 1);
        places.iter().for_each(|place| counts[slice(place.z)] += 1);
        let layers = counts.windows(THICKNESS).map(|layer| layer.iter().sum::<usize>()).enumerate();
        let low = layers.take_while(|(first, _)| *first <= slice(HEIGHT_MAX));
        let (first, count) = low.max_by_key(|(first, count)| (*count, core::cmp::Reverse(*first)))?;
        if count < COUNT_MIN || (count as f32) < SHARE_MIN * places.len() as f32 {
            return None;
        }
        let slice_height = 2.0 / SLICES as f64;
        let mut plane = DVec3::new(0.0, 0.0, (first as f64 + 0.5 * THICKNESS as f64) * slice_height - 1.0);
        let (mut tolerance, mut deviation) = (THICKNESS as f64 * slice_height, 0.0);
        for _ in 0..FITS {
            (plane, deviation) = fitted(&places, plane, tolerance)?;
            tolerance = (FITTED_DEVIATIONS * deviation).max(0.5 * slice_height);
        }
        let margin = (DEVIATIONS * deviation).clamp(MARGIN[0], MARGIN[1]);
        let slope = up - axes[0] * plane.x as f32 - axes[1] * plane.y as f32;
        Some(Self { center, radius: ball.radius, axes, slope, level: (plane.z + margin) as f32 * ball.radius })
    }

    /// Height of a point above the plane and its margin.
    fn height(&self, point: [f32; 3]) -> f32 {
        self.slope.dot(Vec3::from(point) - self.center) - self.level
    }

    /// Cell of a point: east, north and height above the plane.
    fn cell(&self, point: [f32; 3]) -> [i32; 3] {
        let from_center = Vec3::from(point) - self.center;
        let [east, north] = self.axes.map(|axis| axis.dot(from_center));
        [east, north, self.height(point)].map(|x| (x / (CELL * self.radius)).floor() as i32)
    }

    /// Whether a Gaussian is small enough for an object's.
    pub(crate) fn takes(&self, gaussians: &Gaussians<Vec<f32>>, index: usize) -> bool {
        let log_scale_max = (DEVIATION_MAX * self.radius).ln();
        gaussians.get::<3>(index, LOG_SCALE).iter().all(|log_scale| *log_scale < log_scale_max)
    }

    /// True if the plane, with its margin, is below a point.
    pub(crate) fn is_below(&self, point: [f32; 3]) -> bool {
        self.height(point) > 0.0
    }
}

/// Plane with the least squared distances from the points within a tolerance of another plane, and
/// their standard deviation; `None` if the points lie on a line.
fn fitted(places: &[Vec3], plane: DVec3, tolerance: f64) -> Option<(DVec3, f64)> {
    let all = places.iter().map(|place| place.as_dvec3());
    let near: Vec<DVec3> = all.filter(|at| distance(*at, plane).abs() < tolerance).collect();
    let count = near.len() as f64;
    let (mut products, mut sums) = (DMat3::ZERO, DVec3::ZERO);
    for at in &near {
        let row = DVec3::new(at.x, at.y, 1.0);
        products += DMat3::from_cols(row * row.x, row * row.y, row);
        sums += row * at.z;
    }
    // That of points on a line is zero; negated, so that it is refused if it is not a number.
    if !(products.determinant() > 1e-9 * count.powi(3)) {
        return None;
    }
    let plane = products.inverse() * sums;
    let squares = near.iter().map(|at| distance(*at, plane).powi(2)).sum::<f64>();
    Some((plane, (squares / count).sqrt()))
}

/// Height of a point above the plane z = a x + b y + c, (a, b, c).
fn distance(at: DVec3, plane: DVec3) -> f64 {
    at.z - plane.dot(DVec3::new(at.x, at.y, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{
        near_field::VERTEX_LEN,
        random,
        scene::{Layout, len_of_values},
    };

    #[test]
    fn only_words_shares_and_balls_are_crops() {
        let ball = Foreground::Ball { centre: [1.0, -2.0, 0.5], radius: 3.0 };
        for (text, expected) in [
            ("auto", Crop::Region(Foreground::Auto)),
            ("object", Crop::Object),
            ("0.75", Crop::Region(Foreground::Share(0.75))),
            ("1,-2,0.5,3", Crop::Region(ball)),
        ] {
            assert_eq!(text.parse(), Ok(expected), "{text:?}");
            assert_eq!(expected.to_string().parse(), Ok(expected), "{text:?} as it is written");
        }
        for wrong in ["", "all", "objects", "0", "1,2,3"] {
            assert!(wrong.parse::<Crop>().is_err(), "{wrong:?} passed for a crop");
        }
    }

    /// Surface of vertices and their normals.
    fn surface(vertices: &[(Vec3, Vec3)]) -> NearField<Vec<f32>> {
        let number = |(position, normal): &(Vec3, Vec3)| {
            let mut numbers = [0.0; VERTEX_LEN];
            numbers[..3].copy_from_slice(&position.to_array());
            numbers[3..6].copy_from_slice(&normal.to_array());
            numbers
        };
        let values = vertices.iter().flat_map(number).collect();
        NearField::of_sizes([0, 0, vertices.len()], 1e-3, values)
    }

    /// Points of a ball that stands on a rough table, which leans by a tenth, below the table's
    /// normal `up`; `table` of 40² vertices.
    fn on_a_table(up: Vec3, lean: f32, table: usize) -> (Vec<(Vec3, Vec3)>, Vec3) {
        let [east, north] = <[Vec3; 2]>::from(up.any_orthonormal_pair());
        let normal = (up - lean * east).normalize();
        let mut vertices: Vec<(Vec3, Vec3)> = (0..table)
            .map(|k| {
                let [x, y, rough] = [0, 1, 2].map(|axis| 2.0 * random::uniform(axis, 0, k as u64) - 1.0);
                (2.0 * x * east + 2.0 * y * north + (2.0 * lean * x - 1.0 + 0.01 * rough) * up, normal)
            })
            .collect();
        vertices.extend((0..2000).map(|k| {
            let (height, turn) = (1.0 - 2.0 * (k as f32 + 0.5) / 2000.0, 2.4 * k as f32);
            let across = (1.0 - height * height).sqrt();
            let out = across * (turn.cos() * east + turn.sin() * north) + height * up;
            (0.9 * out, out)
        }));
        (vertices, normal)
    }

    #[test]
    fn the_table_is_found_and_not_the_ball_on_it() {
        let ball = Ball { center: [0.0; 3], radius: 2.0 };
        for up in [Vec3::Z, Vec3::new(0.3, -0.9, 0.1).normalize()] {
            for lean in [0.0, 0.1] {
                let (vertices, _) = on_a_table(up, lean, 1600);
                let support = Support::of(&surface(&vertices), &ball, up).expect("there is a table");
                let kept = |range: core::ops::Range<usize>| {
                    range.filter(|k| support.is_below(vertices[*k].0.to_array())).count()
                };
                assert!(kept(0..1600) < 16, "{} of the table's vertices are left", kept(0..1600));
                assert!(kept(1600..3600) > 1900, "{} of the ball's vertices are left", kept(1600..3600));
            }
        }
    }

    #[test]
    fn objects_are_connected_small_and_have_feet() {
        let ball = Ball { center: [0.0; 3], radius: 2.0 };
        let (vertices, _) = on_a_table(Vec3::Z, 0.0, 1600);
        let support = Support::of(&surface(&vertices), &ball, Vec3::Z).expect("there is a table");
        // A cup that is sunk into the table, a speck of a wall, and its blur.
        let sunk = (0..2000).map(|k| {
            let turn = 2.4 * k as f32;
            Vec3::new(0.5 * turn.cos(), 0.5 * turn.sin(), -1.15 + 1.6 * (k as f32 + 0.5) / 2000.0)
        });
        let speck = [Vec3::new(1.6, 0.0, 0.5); 3];
        let positions: Vec<Vec3> = sunk.chain(speck).chain([Vec3::new(0.9, 0.0, 0.0)]).collect();
        let layout = Layout::radiance(0);
        let len = len_of_values(positions.len(), layout);
        let mut gaussians = Gaussians { count: positions.len(), layout, values: vec![0.0; len] };
        for (index, position) in positions.iter().enumerate() {
            let is_blur = index + 1 == positions.len();
            gaussians.set(index, MEAN, position.to_array());
            gaussians.set(index, LOG_SCALE, [if is_blur { -1.0 } else { -4.0 }; 3]);
            gaussians.set(index, OPACITY, [3.0]);
        }
        let objects = Objects::on(support, &gaussians, &ball);
        let kept = |index: usize| support.takes(&gaussians, index) && objects.contain(positions[index].to_array());
        let below = (0..2000).filter(|index| !support.is_below(positions[*index].to_array()));
        let (below, feet): (Vec<usize>, Vec<usize>) = (below.clone().collect(), below.filter(|k| kept(*k)).collect());
        assert!(below.len() > 50 && feet.len() > below.len() / 2, "{} of {} are feet", feet.len(), below.len());
        assert!((0..2000).filter(|index| kept(*index)).count() > 1900, "the cup stays");
        assert!((2000..2004).all(|index| !kept(index)), "remains of walls go");
        assert!(!objects.contain([0.9, 0.9, -1.0]), "so does the table beside the cup");
    }

    #[test]
    fn without_a_table_there_is_no_plane() {
        let ball = Ball { center: [0.0; 3], radius: 2.0 };
        let (vertices, _) = on_a_table(Vec3::Z, 0.0, 0);
        assert_eq!(Support::of(&surface(&vertices), &ball, Vec3::Z), None, "a ball in the air");
        let (vertices, _) = on_a_table(Vec3::Z, 0.0, 1600);
        assert_eq!(Support::of(&surface(&vertices), &ball, Vec3::X), None, "a wall");
        assert_eq!(Support::of(&surface(&[]), &ball, Vec3::Z), None);
    }
}
