//! Parts of a scene to keep: a region, or the objects on a plane in it, such as a table.
//!
//! The plane is found among the vertices of the scene's surface with upward normals: the height
//! that most of them share, then the plane with the least squared distances from the vertices near
//! it.

use crate::foreground::Foreground;
use core::{fmt, str::FromStr};
use glam::{DMat3, DVec3, Vec3};
use specula_core::{near_field::NearField, region::Ball};

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

/// Plane that an object stands on, with a margin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Support {
    center: Vec3,
    /// Its normal over the cosine of its angle to up.
    slope: Vec3,
    level: f32,
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
        Some(Self { center, slope, level: (plane.z + margin) as f32 * ball.radius })
    }

    /// True if the plane, with its margin, is below a point.
    pub(crate) fn is_below(&self, point: [f32; 3]) -> bool {
        self.slope.dot(Vec3::from(point) - self.center) > self.level
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
    use specula_core::{near_field::VERTEX_LEN, random};

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
    fn without_a_table_there_is_no_plane() {
        let ball = Ball { center: [0.0; 3], radius: 2.0 };
        let (vertices, _) = on_a_table(Vec3::Z, 0.0, 0);
        assert_eq!(Support::of(&surface(&vertices), &ball, Vec3::Z), None, "a ball in the air");
        let (vertices, _) = on_a_table(Vec3::Z, 0.0, 1600);
        assert_eq!(Support::of(&surface(&vertices), &ball, Vec3::X), None, "a wall");
        assert_eq!(Support::of(&surface(&[]), &ball, Vec3::Z), None);
    }
}
