//! Image quality measures.

use crate::math;

/// Peak signal-to-noise ratio, in dB, of pictures in \[0, 1\] from their mean squared error;
/// infinite for equal ones.
pub fn psnr(mean_squared_error: f64) -> f64 {
    -10.0 * math::log264(mean_squared_error) / core::f64::consts::LOG2_10
}

/// Angle between two normals, in degrees; neither needs unit length. From atan2 of sine and cosine,
/// so that small angles keep their digits.
pub fn angle_degrees(a: [f32; 3], b: [f32; 3]) -> f64 {
    let [ax, ay, az] = a.map(f64::from);
    let [bx, by, bz] = b.map(f64::from);
    let cross = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
    let sine = math::sqrt64(cross.iter().map(|c| c * c).sum());
    math::atan264(sine, ax * bx + ay * by + az * bz).to_degrees()
}

/// A picture's value in 8 bits: clamped to \[0, 1\] and rounded to the nearest of 256 steps.
pub fn quantize(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}
