//! Pareto front of settings by error and cost.

/// Indices of Pareto-optimal points (error, cost) by increasing error. Of equal points only the
/// first is kept; points with NaN are excluded.
pub fn pareto(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|k| points[*k].iter().all(|x| !x.is_nan())).collect();
    order.sort_by(|a, b| {
        let ([error_a, cost_a], [error_b, cost_b]) = (points[*a], points[*b]);
        error_a.total_cmp(&error_b).then(cost_a.total_cmp(&cost_b)).then(a.cmp(b))
    });
    let mut least = f64::INFINITY;
    order.retain(|k| {
        let is_cheaper = points[*k][1] < least;
        least = least.min(points[*k][1]);
        is_cheaper
    });
    order
}

/// Index of the cheapest point within an error; `None` if there is none.
pub fn cheapest(points: &[[f64; 2]], error: f64) -> Option<usize> {
    let fits = (0..points.len()).filter(|k| points[*k][0] <= error && !points[*k][1].is_nan());
    fits.min_by(|a, b| points[*a][1].total_cmp(&points[*b][1]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dominated_points_are_not_on_the_front() {
        let points = [[1.0, 5.0], [2.0, 4.0], [2.0, 4.0], [3.0, 4.5], [4.0, 1.0], [0.5, f64::NAN]];
        assert_eq!(pareto(&points), [0, 1, 4]);
        assert!(pareto(&[]).is_empty());
    }

    #[test]
    fn the_cheapest_is_close_enough() {
        let points = [[1.0, 5.0], [2.0, 4.0], [3.0, 4.5], [4.0, 1.0]];
        assert_eq!([0.5, 1.0, 3.5, 9.0].map(|error| cheapest(&points, error)), [None, Some(0), Some(1), Some(3)]);
    }
}
