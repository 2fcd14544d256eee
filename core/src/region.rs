//! Parts of space.
//!
//! A foreground restricts reflections to a ball. The raw tint of a Gaussian outside of it is held
//! at −64 after each densification. σ(−64) = 1.6e-28 is negligible against any colour, and
//! gradients proportional to it against Adam's ε, so neither tint nor light takes a step, and no
//! other stage needs a special case.

/// Ball in world units, including its surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Its centre.
    pub center: [f32; 3],
    /// Its radius, not negative.
    pub radius: f32,
}

impl Ball {
    /// True if a point is in the ball: |p − c|² ≤ r². Points that are not finite are outside.
    pub fn contains(&self, point: [f32; 3]) -> bool {
        let [x, y, z] = core::array::from_fn(|axis| point[axis] - self.center[axis]);
        x * x + y * y + z * z <= self.radius * self.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_contains_its_surface_and_nothing_beyond_it() {
        let ball = Ball { center: [1.0, -2.0, 0.5], radius: 2.0 };
        for point in [[1.0, -2.0, 0.5], [3.0, -2.0, 0.5], [1.0, -4.0, 0.5], [2.0, -3.0, 1.5]] {
            assert!(ball.contains(point), "{point:?} is in it");
        }
        for point in [[3.001, -2.0, 0.5], [-0.5, -3.0, 2.0], [f32::NAN, -2.0, 0.5], [1.0, f32::INFINITY, 0.5]] {
            assert!(!ball.contains(point), "{point:?} is not");
        }
    }
}
