//! Origin of a scene in the world of its data set.
//!
//! Positions are `f32`, with 24 bits. In metres of a map projection (UTM) or relative to the
//! Earth's centre (ECEF) their steps are up to half a metre, so cameras far from the origin of
//! their world are moved to it before their positions become `f32`. A model stores positions
//! relative to its origin.

use glam::DVec3;
use serde::{Deserialize, Deserializer, de::Error as _};

/// Distance of the cameras' mean from the origin, relative to their spread, above which positions
/// are moved: there rounding is 1e-6 of the spread, about the size of the last steps of a training.
const FAR: f64 = 8.0;
/// Step of positions, relative to the cameras' distance from their origin, above which it is noted.
const COARSE: f64 = 1e-5;
/// Start of the comment of a PLY file.
const COMMENT: &str = "origin ";
/// Largest coordinate of an origin, so that sums of it and an `f32` stay far from infinity.
const ORIGIN_MAX: f64 = 1e30;

/// Origin of a data set with cameras at these positions: their mean, rounded to a power of ten
/// below their spread; zero if they are not far from the origin.
pub(crate) fn of_cameras(positions: &[DVec3]) -> [f64; 3] {
    let count = positions.len().max(1) as f64;
    let mean = positions.iter().fold(DVec3::ZERO, |sum, position| sum + *position / count);
    let spread = spread(positions, mean);
    // The comparison is false for NaN.
    if !(mean.length() > FAR * spread) {
        return [0.0; 3];
    }
    let step = 10_f64.powf(spread.log10().floor());
    let rounded = (mean / step).round() * step;
    Some(rounded.to_array()).filter(is_usable).unwrap_or_default()
}

/// Largest distance from a point; 1 if all positions are equal to it.
fn spread(positions: &[DVec3], from: DVec3) -> f64 {
    let spread = positions.iter().map(|position| position.distance(from)).fold(0.0, f64::max);
    if spread > 0.0 { spread } else { 1.0 }
}

/// Note on positions whose steps, as doubles far from the origin of their world, are coarse
/// relative to the cameras' spread.
pub(crate) fn note_coarse(origin: [f64; 3], positions: &[DVec3]) -> Option<String> {
    let most = DVec3::from(origin).abs().max_element();
    let step = most.next_up() - most;
    (step > COARSE * spread(positions, DVec3::ZERO)).then(|| {
        format!("positions are so far from 0 0 0 that doubles have steps of {step} there; move them nearer to it")
    })
}

/// Returns whether an origin is finite and within its range.
pub(crate) fn is_usable(origin: &[f64; 3]) -> bool {
    // The comparison is false for NaN.
    origin.iter().all(|number| number.abs() <= ORIGIN_MAX)
}

/// Reads an origin from a file.
///
/// # Errors
///
/// An origin beyond 10³⁰ units.
pub(crate) fn read<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 3], D::Error> {
    let origin = <[f64; 3]>::deserialize(from)?;
    match is_usable(&origin) {
        true => Ok(origin),
        false => Err(D::Error::custom(format_args!("the origin {origin:?} exceeds {ORIGIN_MAX:e} units"))),
    }
}

/// Returns whether positions are those of the data set's world.
pub fn is_zero(origin: &[f64; 3]) -> bool {
    *origin == [0.0; 3]
}

/// Comment of a PLY file; `None` if positions are in the data set's world.
pub fn comment(origin: [f64; 3]) -> Option<String> {
    let [x, y, z] = origin;
    (!is_zero(&origin)).then(|| format!("{COMMENT}{x} {y} {z}"))
}

/// Origin that the comments of a PLY file name, else zero.
pub fn of_comments(comments: &[String]) -> [f64; 3] {
    vectors_in(comments, COMMENT).find(is_usable).unwrap_or_default()
}

/// Vectors of three numbers that follow a prefix in the comments of a PLY file.
pub fn vectors_in(comments: &[String], prefix: &str) -> impl Iterator<Item = [f64; 3]> {
    comments.iter().filter_map(move |comment| {
        let words = comment.strip_prefix(prefix)?.split_ascii_whitespace();
        let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
        numbers.try_into().ok()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(centre: DVec3, radius: f64) -> [DVec3; 12] {
        core::array::from_fn(|k| {
            let (sin, cos) = (k as f64).sin_cos();
            centre + radius * DVec3::new(cos, sin, 0.3)
        })
    }

    #[test]
    fn cameras_near_the_origin_stay_where_they_are() {
        for (distance, radius) in [(0.0, 4.0), (3.0, 4.0), (100.0, 40.0), (1e-6, 1e-6)] {
            assert_eq!(of_cameras(&ring(DVec3::splat(distance), radius)), [0.0; 3], "{distance}, {radius}");
        }
        assert_eq!(of_cameras(&[DVec3::splat(2.0)]), [0.0; 3], "one camera");
        assert_eq!(of_cameras(&[]), [0.0; 3]);
        assert_eq!(of_cameras(&[DVec3::NAN, DVec3::ONE]), [0.0; 3]);
    }

    #[test]
    fn cameras_far_from_the_origin_get_one_of_few_digits() {
        let far = DVec3::new(448_123.4, 5_411_067.8, 120.0);
        assert_eq!(of_cameras(&ring(far, 4.0)), [448_123.0, 5_411_068.0, 121.0]);
        assert_eq!(of_cameras(&ring(far, 400.0)), [448_100.0, 5_411_100.0, 200.0]);
        let small = of_cameras(&ring(DVec3::X, 2e-3));
        assert!((small[0] - 1.0).abs() < 1.1e-3, "{small:?}");
    }

    #[test]
    fn positions_without_digits_are_noted() {
        let noted = |far: f64| {
            let far = DVec3::splat(far);
            let origin = of_cameras(&ring(far, 4.0));
            note_coarse(origin, &ring(far, 4.0).map(|position| position - DVec3::from(origin))).is_some()
        };
        assert!(!noted(0.0) && !noted(5e6) && noted(1e13) && noted(1e16));
    }

    #[test]
    fn comments_name_an_origin() {
        let origin = [448_123.5, -5_411_068.0, 1e-3];
        let comments = ["specula".to_owned(), comment(origin).expect("it is not zero")];
        assert_eq!(of_comments(&comments), origin);
        assert_eq!(comment([0.0; 3]), None);
        for other in
            ["origin 1 2 1e300", "origin 1 2", "origin 1 2 x", "origin 1 2 NaN", "origins 1 2 3", "origin 1 2 3 4"]
        {
            assert_eq!(of_comments(&[other.into()]), [0.0; 3], "{other}");
        }
    }
}
