//! Background of pictures: a colour, the unfiltered radiance of an environment behind each pixel,
//! or none, in transparent pictures.

use crate::{
    environment::radiance,
    ground::Ground,
    text::{numbers, serialize_as_text},
};
use core::{fmt, str::FromStr};
use specula_core::{
    camera::Camera,
    color::{composite, is_unknown, linear_from_srgb, over, srgb_from_linear},
    scene::{Environment, Image, RadianceActivation},
};
use specula_io::{
    latlong::{self, LatLong, MapOrientation},
    picture::{self, DynamicImage, RgbaImage},
};
use specula_train::{evaluate::over_background, view::View};
use std::sync::Arc;

/// Resolutions of an environment behind pictures, in texels along a face's edge.
const RESOLUTIONS: [usize; 2] = [64, 1024];

/// Colour in sRGB, each channel from 0 to 1; `black`, `white` or three numbers as text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundColor(pub [f32; 3]);

/// Text that is not a [`BackgroundColor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("use black, white, or three numbers from 0 to 1 such as 0.5,0.5,0.5")]
pub struct InvalidColor;

impl BackgroundColor {
    /// Black.
    pub const BLACK: Self = Self([0.0; 3]);
    /// White.
    pub const WHITE: Self = Self([1.0; 3]);

    /// Background of data sets without a given one: white if any picture is transparent, else
    /// black.
    pub const fn default_for(is_transparent: bool) -> Self {
        if is_transparent { Self::WHITE } else { Self::BLACK }
    }
}

impl FromStr for BackgroundColor {
    type Err = InvalidColor;

    fn from_str(text: &str) -> Result<Self, InvalidColor> {
        match text {
            "black" => return Ok(Self::BLACK),
            "white" => return Ok(Self::WHITE),
            _ => {}
        }
        match numbers::<f32>(text).as_deref() {
            Some([r, g, b]) if [r, g, b].iter().all(|channel| (0.0..=1.0).contains(*channel)) => Ok(Self([*r, *g, *b])),
            _ => Err(InvalidColor),
        }
    }
}

impl fmt::Display for BackgroundColor {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.0;
        write!(out, "{r},{g},{b}")
    }
}

serialize_as_text!(BackgroundColor);

/// Requested background: a colour, `env` for the environment light, or `transparent` for none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BackgroundChoice {
    /// A colour.
    Color(BackgroundColor),
    /// Light that the scene reflects.
    Environment,
    /// None: pictures have alpha.
    Transparent,
}

/// Text that is not a [`BackgroundChoice`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("use black, white, env, transparent, or three numbers from 0 to 1 such as 0.5,0.5,0.5")]
pub struct InvalidBackground;

impl BackgroundChoice {
    /// Colour of the background, if it is one.
    pub const fn color(self) -> Option<BackgroundColor> {
        match self {
            Self::Color(color) => Some(color),
            Self::Environment | Self::Transparent => None,
        }
    }
}

impl FromStr for BackgroundChoice {
    type Err = InvalidBackground;

    fn from_str(text: &str) -> Result<Self, InvalidBackground> {
        match text {
            "env" => Ok(Self::Environment),
            "transparent" => Ok(Self::Transparent),
            color => color.parse().map(Self::Color).map_err(|_: InvalidColor| InvalidBackground),
        }
    }
}

/// Background of pictures.
#[derive(Clone, Debug)]
pub enum Backdrop {
    /// A colour.
    Color(BackgroundColor),
    /// Light at infinite distance.
    Environment(Environment<Vec<f32>>),
    /// None: pictures have straight alpha.
    Transparent,
    /// Another background with a ground that catches shadows.
    Ground(Box<Self>, Arc<Ground>),
}

impl Backdrop {
    /// Lat-long map behind the views of some cameras: a cube with texels about as wide as a pixel,
    /// or as wide as the map's if those are wider.
    pub fn from_map<'a>(
        map: &LatLong,
        orientation: MapOrientation,
        cameras: impl IntoIterator<Item = &'a Camera>,
    ) -> Self {
        let [min, max] = RESOLUTIONS;
        let sharpest = cameras.into_iter().map(|camera| camera.focal_px[0]).fold(0.0, f32::max);
        let needed = (2.0 * sharpest) as usize;
        let resolution = needed.min(map.width / 2).clamp(min, max).next_power_of_two();
        let values = latlong::to_cube(map, resolution, orientation);
        Self::Environment(Environment { resolution, activation: RadianceActivation::Identity, values })
    }

    /// Rendered view over the background, with 8 bits a channel; without a background, with
    /// straight alpha.
    pub fn picture(&self, image: &Image<Vec<f32>>, camera: &Camera) -> DynamicImage {
        let planes = match self {
            Self::Color(BackgroundColor(color)) => over_background(image, *color),
            Self::Environment(light) => over_environment(image, light, camera),
            Self::Transparent => return transparent(image, |_| 1.0).into(),
            Self::Ground(behind, ground) if matches!(**behind, Self::Transparent) => {
                let shares = ground.shares(camera);
                let passed = |pixel: usize| srgb_from_linear(shares[pixel].iter().sum::<f32>() / 3.0);
                return transparent(image, passed).into();
            }
            Self::Ground(..) => over_colors(image, &self.colors(camera)),
        };
        picture::rgb(image.width, image.height, &planes).into()
    }

    /// Colours behind each pixel of a camera, row by row, in sRGB.
    fn colors(&self, camera: &Camera) -> Vec<[f32; 3]> {
        match self {
            Self::Color(BackgroundColor(color)) => vec![*color; (camera.width * camera.height) as usize],
            Self::Environment(light) => environment_colors(light, camera),
            Self::Transparent => vec![[0.0; 3]; (camera.width * camera.height) as usize],
            Self::Ground(behind, ground) => {
                let mut colors = behind.colors(camera);
                let shadowed = |color: f32, share: f32| match share {
                    1.0 => color,
                    _ => srgb_from_linear(linear_from_srgb(color) * share),
                };
                for (color, share) in colors.iter_mut().zip(ground.shares(camera)) {
                    *color = core::array::from_fn(|k| shadowed(color[k], share[k]));
                }
                colors
            }
        }
    }

    /// Photograph over the background, with 8 bits a channel; without a background, as it is,
    /// unknown pixels clear.
    pub fn photograph(&self, view: &View) -> DynamicImage {
        let Camera { width, height, .. } = view.camera;
        let planes = match self {
            Self::Color(BackgroundColor(color)) => view.over(*color),
            Self::Environment(light) => photograph_over_environment(view, light),
            Self::Transparent => {
                let mut rgba = view.rgba.clone();
                rgba.chunks_exact_mut(4).filter(|pixel| is_unknown(pixel)).for_each(|pixel| pixel.fill(0));
                return RgbaImage::from_raw(width, height, rgba).expect("four bytes a pixel").into();
            }
            Self::Ground(behind, _) => return behind.photograph(view),
        };
        picture::rgb(width as usize, height as usize, &planes).into()
    }

    /// Colour of the background; black for an environment and without a background.
    pub fn color(&self) -> BackgroundColor {
        match self {
            Self::Color(color) => *color,
            Self::Environment(_) | Self::Transparent => BackgroundColor::BLACK,
            Self::Ground(behind, _) => behind.color(),
        }
    }
}

/// Rendered view with straight alpha in front of black that transmits a share of the background,
/// `passed` at each pixel: with premultiplied colours C and transmittance T, alpha is a = 1 − T ·
/// passed, and colours are C / a, at most white.
fn transparent(image: &Image<Vec<f32>>, passed: impl Fn(usize) -> f32) -> RgbaImage {
    let transmittance = image.plane(image.channels - 1);
    let alpha: Vec<f32> = (0..).zip(transmittance).map(|(pixel, t)| 1.0 - t * passed(pixel)).collect();
    let straight =
        |c: usize| image.plane(c).iter().zip(&alpha).map(|(color, a)| if *a > 0.0 { color / a } else { 0.0 });
    let planes: Vec<f32> = (0..3).flat_map(straight).collect();
    picture::rgba(image.width, image.height, &planes, &alpha)
}

/// Colours of a photograph over a light, as three planes in sRGB.
fn photograph_over_environment(view: &View, light: &Environment<Vec<f32>>) -> Vec<f32> {
    let colors = environment_colors(light, &view.camera);
    let channel = |(pixel, color): (&[u8], &[f32; 3]), c: usize| {
        let [value, alpha] = [pixel[c], pixel[3]].map(|byte| f32::from(byte) / 255.0);
        over(value, alpha, color[c])
    };
    let plane = |c: usize| view.rgba.chunks_exact(4).zip(&colors).map(move |pair| channel(pair, c));
    (0..3).flat_map(plane).collect()
}

/// Colours of a rendered view over a light, as three planes in sRGB.
fn over_environment(image: &Image<Vec<f32>>, light: &Environment<Vec<f32>>, camera: &Camera) -> Vec<f32> {
    over_colors(image, &environment_colors(light, camera))
}

/// Colours of a rendered view over the background of each pixel, as three planes in sRGB.
fn over_colors(image: &Image<Vec<f32>>, behind: &[[f32; 3]]) -> Vec<f32> {
    let transmittance = image.plane(image.channels - 1);
    let plane = |c: usize| {
        let pixels = image.plane(c).iter().zip(transmittance).zip(behind);
        pixels.map(move |((color, transmittance), behind)| composite(*color, *transmittance, behind[c]))
    };
    (0..3).flat_map(plane).collect()
}

/// Colours of a light behind each pixel of a camera, row by row: its radiance in the direction of
/// the pixel's centre, in sRGB from 0 to 1.
pub(crate) fn environment_colors(light: &Environment<Vec<f32>>, camera: &Camera) -> Vec<[f32; 3]> {
    let world_from_camera = camera.camera_from_world.transpose();
    let direction = |index: u32| {
        let [x, y] = [index % camera.width, index / camera.width].map(|pixel| pixel as f32 + 0.5);
        (world_from_camera * camera.ray_in_camera(x, y)).as_dvec3().to_array()
    };
    let directions: Vec<[f64; 3]> = (0..camera.width * camera.height).map(direction).collect();
    let seen = latlong::radiance_along(&radiance(light), light.resolution, &directions);
    seen.into_iter().map(|color| color.map(|channel| srgb_from_linear(channel).clamp(0.0, 1.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{cubemap, scene::RadianceActivation};

    #[test]
    fn the_background_of_a_pixel_is_the_light_from_its_direction() {
        const RESOLUTION: usize = 8;
        // Radiance is linear on a face, so bilinear lookups are exact.
        let texel = |index: usize| {
            let (face, row, column) = (index / 64, index / 8 % 8, index % 8);
            let [x, y, z] = cubemap::texel_direction(face, column, row, RESOLUTION);
            let major = x.abs().max(y.abs()).max(z.abs());
            [x, y, z].map(|component| (0.5 + 0.4 * component / major) as f32)
        };
        let values: Vec<f32> = (0..6 * RESOLUTION * RESOLUTION).flat_map(texel).collect();
        let light = Environment { resolution: RESOLUTION, activation: RadianceActivation::Identity, values };
        let camera =
            Camera::look_at(glam::Vec3::new(5.0, 2.0, 1.0), glam::Vec3::new(1.0, 2.0, 1.0), glam::Vec3::Z, 0.6, 6, 4);
        let seen = environment_colors(&light, &camera);
        assert_eq!(seen.len(), 24);
        // The camera looks along -x, with +y to its right and +z above.
        let half = 0.3_f32.tan();
        for (index, color) in seen.iter().enumerate() {
            let [right, down] = [(index % 6) as f32 - 2.5, (index / 6) as f32 - 1.5].map(|pixel| pixel * half / 3.0);
            let expected = [0.1, 0.5 + 0.4 * right, 0.5 - 0.4 * down].map(srgb_from_linear);
            let is_near = color.iter().zip(expected).all(|(own, expected)| (own - expected).abs() < 1e-5);
            assert!(is_near, "{color:?} instead of {expected:?} at {index}");
        }

        // The same as logarithms, and brighter than white.
        let values = light.values.iter().map(|radiance| radiance.ln()).collect();
        let learned = Environment { activation: RadianceActivation::Exponential, values, ..light.clone() };
        let is_same = |(a, b): (&[f32; 3], &[f32; 3])| (a[1] - b[1]).abs() < 1e-5;
        assert!(environment_colors(&learned, &camera).iter().zip(&seen).all(is_same), "exponents are not radiance");
        let bright = light.with_values(light.values.iter().map(|radiance| radiance * 1000.0).collect());
        assert!(environment_colors(&bright, &camera).iter().all(|color| *color == [1.0; 3]), "white is the most");
    }

    #[test]
    fn only_names_and_numbers_are_colours() {
        assert_eq!("white".parse(), Ok(BackgroundColor::WHITE));
        assert_eq!("0.25, 0.5,1".parse(), Ok(BackgroundColor([0.25, 0.5, 1.0])));
        assert_eq!(BackgroundColor([0.1, 0.5, 1.0]).to_string().parse(), Ok(BackgroundColor([0.1, 0.5, 1.0])));
        for wrong in ["", "grey", "1,2,3", "0,0", "0,0,0,0", "NaN,0,0"] {
            assert!(wrong.parse::<BackgroundColor>().is_err(), "{wrong:?} passed for a colour");
        }
    }

    #[test]
    fn a_transparent_picture_over_a_colour_is_the_picture_over_that_colour() {
        /// Rounding of a colour and of alpha to 8 bits, and of the result.
        const ROUNDING: f32 = 1.5 / 255.0;
        let camera = Camera::look_at(glam::Vec3::X * 4.0, glam::Vec3::ZERO, glam::Vec3::Z, 0.6, 4, 1);
        let alphas = [0.0, 0.25, 0.5, 1.0];
        let colors = alphas.map(|alpha| [0.9 * alpha, 0.5 * alpha, 0.1 * alpha]);
        let mut values: Vec<f32> = (0..3).flat_map(|c| colors.map(|color| color[c])).collect();
        values.extend(alphas.map(|alpha| 1.0 - alpha));
        let image = Image { width: 4, height: 1, channels: 4, values };
        let clear = Backdrop::Transparent.picture(&image, &camera).into_rgba8();
        assert_eq!(clear.get_pixel(0, 0).0, [0; 4], "nothing is there");
        assert!(clear.pixels().zip(alphas).all(|(pixel, alpha)| pixel.0[3] == (255.0 * alpha + 0.5) as u8));
        for background in [[0.0; 3], [1.0; 3], [0.2, 0.7, 0.4]] {
            let shown = Backdrop::Color(BackgroundColor(background)).picture(&image, &camera).into_rgb8();
            for (clear, shown) in clear.pixels().zip(shown.pixels()) {
                for c in 0..3 {
                    let [value, alpha, shown] =
                        [clear.0[c], clear.0[3], shown.0[c]].map(|byte| f32::from(byte) / 255.0);
                    let composited = over(value, alpha, background[c]);
                    assert!((composited - shown).abs() <= ROUNDING, "{clear:?} is not {shown} over {background:?}");
                }
            }
        }
    }

    #[test]
    fn a_background_is_a_colour_or_the_light() {
        assert_eq!("env".parse(), Ok(BackgroundChoice::Environment));
        assert_eq!("transparent".parse(), Ok(BackgroundChoice::Transparent));
        assert_eq!("white".parse(), Ok(BackgroundChoice::Color(BackgroundColor::WHITE)));
        assert!("sky".parse::<BackgroundChoice>().is_err_and(|error| error.to_string().contains("env")));
    }
}
