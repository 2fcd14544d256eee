//! What is behind the Gaussians.

use crate::typed::{kept_as_typed, numbers};
use core::{fmt, str::FromStr};
use specula_core::{
    camera::Camera,
    color::{composite, over, srgb_from_linear},
    scene::{Environment, Image},
};
use specula_io::{
    latlong,
    picture::{self, RgbImage},
};
use specula_scene::environment::radiance;
use specula_train::{evaluate::over_background, view::View};

/// A colour of sRGB, each channel from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Background(pub(crate) [f32; 3]);

impl Background {
    pub(crate) const BLACK: Self = Self([0.0; 3]);
    pub(crate) const WHITE: Self = Self([1.0; 3]);

    /// White where pictures are transparent, else black: what the field does, without having to be told.
    pub(crate) fn fitting(views: &[View]) -> Self {
        if views.iter().any(View::has_alpha) { Self::WHITE } else { Self::BLACK }
    }
}

impl FromStr for Background {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "black" => return Ok(Self::BLACK),
            "white" => return Ok(Self::WHITE),
            _ => {}
        }
        match numbers::<f32>(text).as_deref() {
            Some([r, g, b]) if [r, g, b].iter().all(|channel| (0.0..=1.0).contains(*channel)) => Ok(Self([*r, *g, *b])),
            _ => Err("use black, white, or three numbers from 0 to 1 such as 0.5,0.5,0.5".into()),
        }
    }
}

/// As it is typed.
impl fmt::Display for Background {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.0;
        write!(out, "{r},{g},{b}")
    }
}

kept_as_typed!(Background);

/// Background that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Backdrop {
    /// A colour.
    Color(Background),
    /// The light that the scene reflects.
    Environment,
}

impl Backdrop {
    /// The colour, where it is one.
    pub(crate) fn color(self) -> Option<Background> {
        match self {
            Self::Color(color) => Some(color),
            Self::Environment => None,
        }
    }
}

impl FromStr for Backdrop {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "env" {
            return Ok(Self::Environment);
        }
        let wrong = |_| "use black, white, env, or three numbers from 0 to 1 such as 0.5,0.5,0.5".to_owned();
        text.parse().map(Self::Color).map_err(wrong)
    }
}

/// Background of pictures.
#[derive(Debug)]
pub(crate) enum Behind {
    /// A colour.
    Color(Background),
    /// A light, from afar.
    Light(Environment<Vec<f32>>),
}

impl Behind {
    /// A rendered view over it.
    pub(crate) fn picture(&self, image: &Image<Vec<f32>>, camera: &Camera) -> RgbImage {
        let planes = match self {
            Self::Color(Background(color)) => over_background(image, *color),
            Self::Light(light) => over_colors(image, &environment_backdrop(light, camera)),
        };
        picture::rgb(image.width, image.height, &planes)
    }

    /// A photograph over it.
    pub(crate) fn truth(&self, view: &View) -> RgbImage {
        let Self::Light(light) = self else { return truth(view, self.color()) };
        let colors = environment_backdrop(light, &view.camera);
        let channel = |(pixel, color): (&[u8], &[f32; 3]), c: usize| {
            let [value, alpha] = [pixel[c], pixel[3]].map(|byte| f32::from(byte) / 255.0);
            over(value, alpha, color[c])
        };
        let plane = |c: usize| view.rgba.chunks_exact(4).zip(&colors).map(move |pair| channel(pair, c));
        picture::rgb(
            view.camera.width as usize,
            view.camera.height as usize,
            &(0..3).flat_map(plane).collect::<Vec<_>>(),
        )
    }

    /// The colour; black where it is none.
    pub(crate) fn color(&self) -> Background {
        match self {
            Self::Color(color) => *color,
            Self::Light(_) => Background::BLACK,
        }
    }
}

/// A photograph over a colour.
pub(crate) fn truth(view: &View, background: Background) -> RgbImage {
    picture::rgb(view.camera.width as usize, view.camera.height as usize, &view.over(background.0))
}

/// The colours of a view over a colour for each pixel, as three planes.
fn over_colors(image: &Image<Vec<f32>>, colors: &[[f32; 3]]) -> Vec<f32> {
    let passed = image.plane(image.channels - 1);
    let plane = |c: usize| {
        let pixels = image.plane(c).iter().zip(passed).zip(colors);
        pixels.map(move |((own, passed), behind)| composite(*own, *passed, behind[c]))
    };
    (0..3).flat_map(plane).collect()
}

/// The colour of the light behind each pixel of a camera, row by row: its unfiltered radiance in the direction of the pixel's
/// centre, as sRGB from 0 to 1.
fn environment_backdrop(light: &Environment<Vec<f32>>, camera: &Camera) -> Vec<[f32; 3]> {
    let world_from_camera = camera.camera_from_world.transpose();
    let direction = |index: u32| {
        let [x, y] = [index % camera.width, index / camera.width].map(|pixel| pixel as f32 + 0.5);
        (world_from_camera * camera.ray_in_camera(x, y)).as_dvec3().to_array()
    };
    let directions: Vec<[f64; 3]> = (0..camera.width * camera.height).map(direction).collect();
    let seen = latlong::along(&radiance(light.activation, &light.values), light.resolution, &directions);
    seen.into_iter().map(|color| color.map(|channel| srgb_from_linear(channel).clamp(0.0, 1.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{cubemap, scene::RadianceActivation};

    #[test]
    fn names_and_numbers_are_colours_and_nothing_else_is() {
        assert_eq!("white".parse(), Ok(Background::WHITE));
        assert_eq!("0.25, 0.5,1".parse(), Ok(Background([0.25, 0.5, 1.0])));
        assert_eq!(Background([0.1, 0.5, 1.0]).to_string().parse(), Ok(Background([0.1, 0.5, 1.0])));
        for wrong in ["", "grey", "1,2,3", "0,0", "0,0,0,0", "NaN,0,0"] {
            assert!(wrong.parse::<Background>().is_err(), "{wrong:?} passed for a colour");
        }
    }

    #[test]
    fn behind_each_pixel_is_the_light_from_its_direction() {
        const RESOLUTION: usize = 8;
        // Radiance is a linear function of the place on a face, which bilinear look-ups keep.
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
        let seen = environment_backdrop(&light, &camera);
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
        assert!(environment_backdrop(&learned, &camera).iter().zip(&seen).all(is_same), "exponents are not radiance");
        let bright = light.with_values(light.values.iter().map(|radiance| radiance * 1000.0).collect());
        assert!(environment_backdrop(&bright, &camera).iter().all(|color| *color == [1.0; 3]), "white is the most");
    }

    #[test]
    fn a_backdrop_is_a_colour_or_the_light() {
        assert_eq!("env".parse(), Ok(Backdrop::Environment));
        assert_eq!("white".parse(), Ok(Backdrop::Color(Background::WHITE)));
        assert!("sky".parse::<Backdrop>().is_err_and(|words| words.contains("env")));
    }
}
