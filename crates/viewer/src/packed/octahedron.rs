//! Directions on a square: the sphere is projected onto an octahedron, whose lower half is folded
//! outwards over the corners of the square.

/// Octahedral coordinates in [−1, 1]² of a direction of any length; the upper pole for length 0.
pub(super) fn folded([x, y, z]: [f32; 3]) -> [f32; 2] {
    let size = x.abs() + y.abs() + z.abs();
    // Also for NaN.
    if size.is_nan() || size <= 0.0 {
        return [0.0; 2];
    }
    let [u, v] = [x / size, y / size];
    if z < 0.0 { turned([u, v]) } else { [u, v] }
}

/// Unit direction of octahedral coordinates.
pub(super) fn unfolded([u, v]: [f32; 2]) -> [f32; 3] {
    let z = 1.0 - u.abs() - v.abs();
    let [x, y] = if z < 0.0 { turned([u, v]) } else { [u, v] };
    let length = (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|number| number / length)
}

/// Mirrors coordinates at the edge between the halves.
fn turned([u, v]: [f32; 2]) -> [f32; 2] {
    [(1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a few operations.
    const ROUNDING: f32 = 1e-6;

    #[test]
    fn directions_round_trip_as_unit_vectors() {
        let steps = || (-4..=4).map(|k| k as f32 * 0.25);
        for direction in steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| [x, y, z]))) {
            let place = folded(direction);
            assert!(place.iter().all(|number| number.abs() <= 1.0), "{direction:?} is at {place:?}");
            let length = direction.iter().map(|x| x * x).sum::<f32>().sqrt();
            let unit = if length > 0.0 { direction.map(|x| x / length) } else { [0.0, 0.0, 1.0] };
            let apart = unfolded(place).iter().zip(unit).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(apart <= ROUNDING, "{direction:?} is {apart} apart");
        }
        assert_eq!(unfolded(folded([f32::NAN, 0.0, 1.0])), [0.0, 0.0, 1.0]);
    }
}
