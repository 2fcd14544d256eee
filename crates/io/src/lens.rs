//! Lens models of COLMAP and OpenCV, and removal of their distortion from pictures.
//!
//! A ray through (x, y, 1) in camera axes, x right, y down, has the slopes (x, y). A distortion
//! maps slopes to slopes; focal lengths and principal point map these to pixels. Pixel centres are
//! at + ½. Formulas follow COLMAP's page on camera models and OpenCV's on calibration and fisheye
//! cameras.

use crate::pixels::Pixels;

/// Steps of the search for the slope where a polynomial folds back.
const REACH_STEPS: u32 = 2048;

/// Distortion of a lens: a map of ray slopes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// No distortion.
    #[default]
    None,
    /// Brown's polynomials with OpenCV's rational factor: COLMAP's SIMPLE_RADIAL, RADIAL, OPENCV,
    /// FULL_OPENCV.
    Polynomial {
        /// k1 to k6: the factor (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶).
        radial: [f64; 6],
        /// p1 and p2, for a decentred lens.
        tangential: [f64; 2],
    },
    /// Equidistant, with a polynomial in the angle: COLMAP's SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE,
    /// OPENCV_FISHEYE, THIN_PRISM_FISHEYE.
    Fisheye {
        /// k1 to k4: the factor 1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸.
        radial: [f64; 4],
        /// p1 and p2, for a decentred lens.
        tangential: [f64; 2],
        /// sx1 and sy1, for a lens tilted against the sensor.
        prism: [f64; 2],
    },
    /// COLMAP's FOV (Devernay and Faugeras 2001): the factor atan(2 r tan(ω/2)) / (r ω).
    FieldOfView {
        /// ω in radians.
        omega: f64,
    },
}

impl Distortion {
    /// Replaces a distortion whose coefficients are all zero by [`Distortion::None`].
    pub(crate) fn simplified(self) -> Self {
        match self {
            Self::Polynomial { radial, tangential } if radial == [0.0; 6] && tangential == [0.0; 2] => Self::None,
            Self::FieldOfView { omega: 0.0 } => Self::None,
            other => other,
        }
    }

    /// Distorted slopes of a ray.
    pub fn apply(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        match *self {
            Self::None => [x, y],
            Self::Polynomial { tangential, .. } => {
                let factor = self.factor(x.hypot(y));
                let [dx, dy] = tangential_shift(tangential, [x, y]);
                [x * factor + dx, y * factor + dy]
            }
            Self::Fisheye { tangential, prism, .. } => {
                let r = x.hypot(y);
                let to_angle = if r > 0.0 { r.atan() / r } else { 1.0 };
                let at = [x * to_angle, y * to_angle];
                let square = at[0] * at[0] + at[1] * at[1];
                let [dx, dy] = tangential_shift(tangential, at);
                let factor = self.factor(r);
                [x * factor + dx + prism[0] * square, y * factor + dy + prism[1] * square]
            }
            Self::FieldOfView { .. } => {
                let factor = self.factor(x.hypot(y));
                [x * factor, y * factor]
            }
        }
    }

    /// Radial factor for a ray of slope `r`, without tangential and prism terms.
    fn factor(&self, r: f64) -> f64 {
        match *self {
            Self::None => 1.0,
            Self::Polynomial { radial: [k1, k2, k3, k4, k5, k6], .. } => {
                let s = r * r;
                (1.0 + s * (k1 + s * (k2 + s * k3))) / (1.0 + s * (k4 + s * (k5 + s * k6)))
            }
            Self::Fisheye { radial: [k1, k2, k3, k4], .. } => {
                let angle = r.atan();
                let s = angle * angle;
                let to_angle = if r > 0.0 { angle / r } else { 1.0 };
                to_angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
            }
            Self::FieldOfView { omega } => {
                let widened = 2.0 * (0.5 * omega).tan();
                match (omega == 0.0, r == 0.0) {
                    (true, _) => 1.0,
                    (false, true) => widened / omega,
                    (false, false) => (r * widened).atan() / (r * omega),
                }
            }
        }
    }

    /// Largest slope, up to `most`, below which distorted slopes increase with the slope. Beyond it
    /// a polynomial folds back, and pixels see other rays.
    fn reach(&self, most: f64) -> f64 {
        let slope_at = |step: u32| most * f64::from(step) / f64::from(REACH_STEPS);
        let mut last = 0.0;
        for step in 1..=REACH_STEPS {
            let seen = slope_at(step) * self.factor(slope_at(step));
            // The comparison is also false for NaN.
            if !(seen > last) {
                return slope_at(step - 1);
            }
            last = seen;
        }
        most
    }
}

fn tangential_shift([p1, p2]: [f64; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    let square = x * x + y * y;
    [2.0 * p1 * x * y + p2 * (square + 2.0 * x * x), 2.0 * p2 * x * y + p1 * (square + 2.0 * y * y)]
}

/// A lens: the map from camera rays to the pixels of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal lengths along x and y, in pixels.
    pub focal_px: [f64; 2],
    /// Principal point in pixels from the upper left corner.
    pub principal_px: [f64; 2],
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Distortion of ray slopes.
    pub distortion: Distortion,
}

impl Lens {
    /// Pixel position of a ray with these slopes.
    pub fn pixel_of(&self, slopes: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.distortion.apply(slopes);
        [x * self.focal_px[0] + self.principal_px[0], y * self.focal_px[1] + self.principal_px[1]]
    }

    /// The lens for a downscaled or enlarged picture.
    pub(crate) fn resized(&self, width: u32, height: u32) -> Self {
        let [x, y] = [f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height)];
        Self {
            focal_px: [self.focal_px[0] * x, self.focal_px[1] * y],
            principal_px: [self.principal_px[0] * x, self.principal_px[1] * y],
            width,
            height,
            distortion: self.distortion,
        }
    }

    /// Resamples a picture to a pinhole camera of the same size, focal lengths and principal point:
    /// bilinear in sRGB between the four nearest pixels, weighted by alpha. Pixels that the lens
    /// did not see, or next to unknown ones, become unknown; parts outside of the pinhole's
    /// view are lost.
    pub fn undistorted(&self, picture: &Pixels) -> Pixels {
        assert_eq!([self.width, self.height], [picture.width, picture.height], "the lens is that of the picture");
        let reach = self.distortion.reach(self.farthest_slope());
        let pixel = |x: u32, y: u32| {
            let slopes = self.pinhole_slopes(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let is_inside = slopes[0].hypot(slopes[1]) <= reach;
            if is_inside { picture.between(self.pixel_of(slopes)) } else { None }
        };
        let row = |y: u32| (0..self.width).map(move |x| pixel(x, y));
        picture.resampled(self.width, self.height, (0..self.height).flat_map(row))
    }

    /// Slopes of the pinhole's ray at a pixel position.
    fn pinhole_slopes(&self, x_px: f64, y_px: f64) -> [f64; 2] {
        [(x_px - self.principal_px[0]) / self.focal_px[0], (y_px - self.principal_px[1]) / self.focal_px[1]]
    }

    /// Largest slope of the pinhole's rays, in the corners of the picture.
    fn farthest_slope(&self) -> f64 {
        let [width, height] = [f64::from(self.width), f64::from(self.height)];
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        let slope = |[x, y]: [f64; 2]| {
            let [x, y] = self.pinhole_slopes(x, y);
            x.hypot(y)
        };
        corners.into_iter().map(slope).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::color::UNKNOWN;

    /// Error of slopes after distortion and its inverse.
    const FOUND_AGAIN: f64 = 1e-9;
    /// Difference of a smooth picture, in steps of 255: bilinear weights and rounding, and half a
    /// pixel of the steepest slope at the border.
    const RESAMPLED: u8 = 4;
    const SIZE: [u32; 2] = [96, 64];

    /// Lenses of every model, with distortions as strong as real ones.
    fn lenses() -> Vec<Lens> {
        let polynomial = |radial, tangential| Distortion::Polynomial { radial, tangential };
        let fisheye = |radial, tangential, prism| Distortion::Fisheye { radial, tangential, prism };
        let distortions = [
            Distortion::None,
            polynomial([-0.12, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]),
            polynomial([0.15, -0.03, 0.0, 0.0, 0.0, 0.0], [0.002, -0.003]),
            polynomial([0.2, 0.02, 0.01, 0.3, 0.01, 0.001], [0.001, 0.001]),
            fisheye([0.0; 4], [0.0; 2], [0.0; 2]),
            fisheye([0.03, -0.01, 0.002, -0.001], [0.002, -0.001], [0.003, 0.001]),
            Distortion::FieldOfView { omega: 0.9 },
        ];
        let [width, height] = SIZE;
        let of = |distortion| Lens { focal_px: [80.0, 78.0], principal_px: [49.0, 31.0], width, height, distortion };
        distortions.map(of).to_vec()
    }

    /// Inverts a distortion by Newton's method with finite differences.
    fn before(distortion: &Distortion, to: [f64; 2]) -> [f64; 2] {
        const STEP: f64 = 1e-6;
        let mut at = to;
        for _ in 0..50 {
            let [here, right, below] = [[0.0, 0.0], [STEP, 0.0], [0.0, STEP]]
                .map(|step: [f64; 2]| distortion.apply([at[0] + step[0], at[1] + step[1]]));
            let [a, c] = [0, 1].map(|k| (right[k] - here[k]) / STEP);
            let [b, d] = [0, 1].map(|k| (below[k] - here[k]) / STEP);
            let [x, y] = [to[0] - here[0], to[1] - here[1]];
            let determinant = a * d - b * c;
            at = [at[0] + (d * x - b * y) / determinant, at[1] + (a * y - c * x) / determinant];
        }
        at
    }

    #[test]
    fn distortion_is_inverted() {
        for lens in lenses() {
            for step in 0..64 {
                let slopes = [0.07 * f64::from(step % 8) - 0.25, 0.06 * f64::from(step / 8) - 0.2];
                let found = before(&lens.distortion, lens.distortion.apply(slopes));
                let error = (found[0] - slopes[0]).hypot(found[1] - slopes[1]);
                assert!(error < FOUND_AGAIN, "{:?}: {slopes:?} came back as {found:?}", lens.distortion);
            }
        }
    }

    /// Test pattern as a function of ray slopes.
    fn color([x, y]: [f64; 2]) -> [u8; 4] {
        let wave = |phase: f64| (127.0 + 100.0 * (4.0 * x + 3.0 * y + phase).sin()).round() as u8;
        [wave(0.0), wave(2.0), wave(4.0), 255]
    }

    /// Picture of the test pattern through a lens.
    fn taken_through(lens: &Lens) -> Pixels {
        let pixel = |index: u32| {
            let [x, y] = [index % lens.width, index / lens.width].map(|place| f64::from(place) + 0.5);
            color(before(&lens.distortion, lens.pinhole_slopes(x, y)))
        };
        let rgba = (0..lens.width * lens.height).flat_map(pixel).collect();
        Pixels::of_bytes(lens.width, lens.height, rgba)
    }

    #[test]
    fn an_undistorted_picture_matches_a_pinhole() {
        for lens in lenses() {
            let found = lens.undistorted(&taken_through(&lens));
            let expected = taken_through(&Lens { distortion: Distortion::None, ..lens });
            let known = found.rgba.chunks(4).zip(expected.rgba.chunks(4)).filter(|(found, _)| *found != UNKNOWN);
            let most = known.clone().flat_map(|(a, b)| (0..4).map(|k| a[k].abs_diff(b[k]))).max();
            assert!(most <= Some(RESAMPLED), "{:?}: off by {most:?}", lens.distortion);
            assert!(known.count() > 5000, "{:?} sees most of the picture", lens.distortion);
        }
    }

    #[test]
    fn pixels_outside_of_the_lens_are_unknown() {
        let [width, height] = SIZE;
        let outwards = Distortion::Polynomial { radial: [0.5, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
        let lens = Lens { focal_px: [60.0; 2], principal_px: [48.0, 32.0], width, height, distortion: outwards };
        let picture = lens.undistorted(&Pixels::of_bytes(width, height, vec![255; 4 * 96 * 64]));
        assert_eq!(picture.rgba[..4], UNKNOWN);
        assert_eq!(picture.rgba[4 * (32 * 96 + 48)..][..4], [255; 4]);
    }

    #[test]
    fn a_polynomial_that_folds_back_shows_nothing_twice() {
        // The map r (1 − r²) turns back at r = 1/√3 and returns to zero at r = 1.
        let folding = Distortion::Polynomial { radial: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
        assert!((folding.reach(2.0) - 3.0_f64.sqrt().recip()).abs() < 1e-3, "{}", folding.reach(2.0));
        let [width, height] = SIZE;
        let lens = Lens { focal_px: [48.0; 2], principal_px: [48.0, 32.0], width, height, distortion: folding };
        let picture = lens.undistorted(&Pixels::of_bytes(width, height, vec![255; 4 * 96 * 64]));
        assert_eq!(picture.rgba[4 * 32 * 96..][..4], UNKNOWN);
    }

    #[test]
    fn lenses_that_are_not_finite_show_nothing() {
        let broken = Distortion::Polynomial { radial: [f64::NAN; 6], tangential: [0.0; 2] };
        assert_eq!(broken.reach(1.0), 0.0);
    }
}
