//! What is behind the Gaussians.

use crate::typed::{kept_as_typed, numbers};
use core::{fmt, str::FromStr};
use specula_train::view::View;

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
}
