//! Background of pictures: a colour, or the light.

use crate::typed::{kept_as_typed, numbers};
use core::{fmt, str::FromStr};
use specula_core::{
    camera::Camera,
    color::over,
    scene::{Environment, Image},
};
use specula_io::picture::{self, RgbImage};
use specula_scene::backdrop::{environment_colors, over_environment};
use specula_train::{evaluate::over_background, view::View};

/// Colour in sRGB, each channel from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Background(pub(crate) [f32; 3]);

impl Background {
    pub(crate) const BLACK: Self = Self([0.0; 3]);
    pub(crate) const WHITE: Self = Self([1.0; 3]);

    /// White for transparent pictures, else black, as is usual for such data sets.
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

impl fmt::Display for Background {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.0;
        write!(out, "{r},{g},{b}")
    }
}

kept_as_typed!(Background);

/// Background on the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Backdrop {
    /// A colour.
    Color(Background),
    /// The light that the scene reflects.
    Environment,
}

impl Backdrop {
    /// Colour of the background, if it is one.
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
    /// Light at infinite distance.
    Light(Environment<Vec<f32>>),
}

impl Behind {
    /// Rendered view over the background.
    pub(crate) fn picture(&self, image: &Image<Vec<f32>>, camera: &Camera) -> RgbImage {
        let planes = match self {
            Self::Color(Background(color)) => over_background(image, *color),
            Self::Light(light) => over_environment(image, light, camera),
        };
        picture::rgb(image.width, image.height, &planes)
    }

    /// Photograph over the background.
    pub(crate) fn truth(&self, view: &View) -> RgbImage {
        let Self::Light(light) = self else { return truth(view, self.color()) };
        let colors = environment_colors(light, &view.camera);
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

    /// Colour of the background; black for a light.
    pub(crate) fn color(&self) -> Background {
        match self {
            Self::Color(color) => *color,
            Self::Light(_) => Background::BLACK,
        }
    }
}

/// Photograph over a colour.
pub(crate) fn truth(view: &View, background: Background) -> RgbImage {
    picture::rgb(view.camera.width as usize, view.camera.height as usize, &view.over(background.0))
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_backdrop_is_a_colour_or_the_light() {
        assert_eq!("env".parse(), Ok(Backdrop::Environment));
        assert_eq!("white".parse(), Ok(Backdrop::Color(Background::WHITE)));
        assert!("sky".parse::<Backdrop>().is_err_and(|words| words.contains("env")));
    }
}
