//! Directions over the sphere.

use crate::math;

/// Golden angle, π (3 − √5), in radians: it keeps neighbours of a spiral farthest from all others.
pub(crate) const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Unit directions, evenly spread over the sphere from +z to −z: a Fibonacci lattice with equal
/// areas.
pub fn directions(count: usize) -> impl Iterator<Item = [f64; 3]> {
    (0..count).map(move |k| {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let turn = k as f64 * GOLDEN_ANGLE;
        let radius = math::sqrt64(1.0 - z * z);
        [radius * math::cos64(turn), radius * math::sin64(turn), z]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_unit_length_and_a_mean_of_zero() {
        const COUNT: usize = 500;
        let mut sum = [0.0; 3];
        for direction in directions(COUNT) {
            let length: f64 = direction.iter().map(|x| x * x).sum();
            assert!((length - 1.0).abs() < 1e-14, "{direction:?}");
            (0..3).for_each(|k| sum[k] += direction[k] / COUNT as f64);
        }
        // As even as a lattice whose neighbours are a share of √(4π / 500) apart can be.
        assert!(sum.iter().all(|x| x.abs() < 1e-2), "{sum:?}");
    }
}
