//! Colour spaces of the numbers in picture files.
//!
//! Cameras' lists name pictures of 8 bits in sRGB, or linear ones: OpenEXR, 16-bit PNG and TIFF.
//! Linear colours are converted to Rec. 709's primaries, with the white point adapted by
//! Bradford's matrix, and kept as numbers on the curve of sRGB without a limit at white.

use crate::{
    error::{Error, Result},
    input::Input,
};
use glam::{DMat3, DVec3};
use image::{DynamicImage, Rgba32FImage};
use serde::Serialize;

/// Chromaticities of red, green, blue and white, x and y of each.
pub(crate) type Primaries = [[f64; 2]; 4];

/// Primaries of Rec. 709 and sRGB, with the white D65.
pub(crate) const REC_709: Primaries = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];
/// Primaries AP1 of ACEScg, with the white of ACES.
const AP1: Primaries = [[0.713, 0.293], [0.165, 0.83], [0.128, 0.044], [0.32168, 0.33767]];
/// Largest difference between chromaticities that count as equal.
const SAME: f64 = 0.01;
/// Bradford's responses of the cones to X, Y, Z, row by row.
const BRADFORD: [[f64; 3]; 3] = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
/// Relative difference of a gamma from one that counts as none.
const LINEAR_GAMMA: f32 = 1e-3;

/// Space of the numbers in the pictures of a data set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum InputSpace {
    /// That of the files: OpenEXR is linear, in the primaries that it names or those of Rec. 709,
    /// and PNG with a gamma of 1; all else is sRGB.
    #[default]
    Auto,
    /// On the curve of sRGB, in Rec. 709's primaries.
    Srgb,
    /// Linear, in Rec. 709's primaries.
    Linear,
    /// Linear, in those of ACEScg (AP1).
    AcesCg,
}

impl InputSpace {
    /// Space by its name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Auto, Self::Srgb, Self::Linear, Self::AcesCg].into_iter().find(|space| space.name() == name)
    }

    /// Name in options and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Srgb => "srgb",
            Self::Linear => "linear",
            Self::AcesCg => "acescg",
        }
    }

    /// Whether numbers are linear, of a file that says so itself or not.
    pub(crate) const fn is_linear(self, says_so: bool) -> bool {
        match self {
            Self::Auto => says_so,
            Self::Srgb => false,
            Self::Linear | Self::AcesCg => true,
        }
    }

    /// Primaries of a file that names some itself or not.
    pub(crate) fn primaries(self, named: Option<Primaries>) -> Primaries {
        match self {
            Self::Auto => named.unwrap_or(REC_709),
            Self::Srgb | Self::Linear => REC_709,
            Self::AcesCg => AP1,
        }
    }
}

/// Matrix from linear red, green and blue to CIE XYZ, with Y = 1 for white.
pub(crate) fn xyz_from_rgb(primaries: Primaries) -> DMat3 {
    let [red, green, blue, white] = primaries.map(|[x, y]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y));
    let columns = DMat3::from_cols(red, green, blue);
    columns * DMat3::from_diagonal(columns.inverse() * white)
}

/// Matrix from linear colours to those of Rec. 709; `None` if these are its primaries.
fn rec_709_from(primaries: Primaries) -> Option<DMat3> {
    let mut pairs = primaries.as_flattened().iter().zip(REC_709.as_flattened());
    if pairs.all(|(found, known)| (found - known).abs() <= SAME) {
        return None;
    }
    let cones = DMat3::from_cols_array_2d(&BRADFORD).transpose();
    let [from, to] = [primaries, REC_709].map(xyz_from_rgb);
    let white = |matrix: DMat3| cones * (matrix * DVec3::ONE);
    let adapted = cones.inverse() * DMat3::from_diagonal(white(to) / white(from)) * cones;
    Some(to.inverse() * adapted * from)
}

/// Linear colours in Rec. 709's primaries.
pub(crate) fn to_rec_709(image: DynamicImage, primaries: Primaries) -> DynamicImage {
    let Some(matrix) = rec_709_from(primaries) else { return image };
    let mut image: Rgba32FImage = image.into_rgba32f();
    for pixel in image.pixels_mut() {
        let [red, green, blue, _] = pixel.0.map(f64::from);
        pixel.0[..3].copy_from_slice(&(matrix * DVec3::new(red, green, blue)).as_vec3().to_array());
    }
    image.into()
}

/// Whether a PNG says that its numbers are linear.
pub(crate) fn is_linear_png(input: Input<'_>) -> Result<bool> {
    let reader = png::Decoder::new(input.open()?).read_info();
    let reader = reader.map_err(|error| Error::Image { path: input.path().to_owned(), cause: error.to_string() })?;
    let gamma = reader.info().gamma().map(png::ScaledFloat::into_value);
    Ok(gamma.is_some_and(|gamma| (gamma - 1.0).abs() < LINEAR_GAMMA))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published to seven digits, for example in the documentation of OpenColorIO's ACES
    /// configurations.
    #[test]
    fn acescg_is_converted_by_the_published_matrix() {
        let expected = [
            [1.705_051, -0.621_792_1, -0.083_258_9],
            [-0.130_256_4, 1.140_804_7, -0.010_548_3],
            [-0.024_003_3, -0.128_969, 1.152_972_3],
        ];
        let matrix = rec_709_from(AP1).expect("the primaries differ").transpose().to_cols_array_2d();
        for (found, expected) in matrix.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 2e-5, "{matrix:?}");
        }
        assert_eq!(rec_709_from(REC_709), None);
    }

    #[test]
    fn white_stays_white() {
        let wide = [[0.708, 0.292], [0.17, 0.797], [0.131, 0.046], [0.3127, 0.329]];
        for primaries in [AP1, wide] {
            let white = rec_709_from(primaries).expect("the primaries differ") * DVec3::ONE;
            assert!((white - DVec3::ONE).length() < 1e-12, "{white}");
        }
    }
}
