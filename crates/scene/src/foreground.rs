//! Foreground of a scene, the Gaussians that reflect the light: `all`, `auto`, a share of the
//! cameras' distance, or a ball as text.

use crate::{
    orientation::centre,
    text::{numbers, serialize_as_text},
};
use core::{fmt, str::FromStr};
use specula_core::region::Ball;
use specula_io::orientation::Orientation;

/// Default radius of the foreground, relative to the cameras' distance from the centre.
const SHARE: f32 = 0.5;

/// Region of the Gaussians that reflect the light; others have only a view-dependent colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Foreground {
    /// All Gaussians.
    All,
    /// Ball around the scene's centre, with half the cameras' distance as its radius.
    Auto,
    /// Ball around the scene's centre, with this share of the cameras' distance as its radius.
    Share(f32),
    /// Ball in the world of the data set.
    Ball {
        /// Its centre.
        centre: [f64; 3],
        /// Its radius.
        radius: f32,
    },
}

impl Foreground {
    /// Ball in a scene with this orientation and this origin in the data set's world; `None` for
    /// all Gaussians.
    pub fn ball(self, orientation: Option<&Orientation>, origin: [f64; 3]) -> Option<Ball> {
        match self {
            Self::All => None,
            Self::Auto => Self::Share(SHARE).ball(orientation, origin),
            Self::Share(share) => orientation
                .map(|found| Ball { center: centre(found).to_array(), radius: share * found.distance as f32 }),
            Self::Ball { centre, radius } => {
                Some(Ball { center: [0, 1, 2].map(|axis| (centre[axis] - origin[axis]) as f32), radius })
            }
        }
    }
}

/// Text that is not a [`Foreground`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("use all, auto, a share of the cameras' distance such as 0.5, or a ball as x,y,z,radius")]
pub struct InvalidForeground;

impl FromStr for Foreground {
    type Err = InvalidForeground;

    fn from_str(text: &str) -> Result<Self, InvalidForeground> {
        match text {
            "all" => return Ok(Self::All),
            "auto" => return Ok(Self::Auto),
            _ => {}
        }
        let finite = numbers(text).filter(|numbers| numbers.iter().all(|number: &f64| (*number as f32).is_finite()));
        match finite.as_deref() {
            Some([share]) if *share as f32 > 0.0 => Ok(Self::Share(*share as f32)),
            Some([x, y, z, radius]) if *radius as f32 > 0.0 => {
                Ok(Self::Ball { centre: [*x, *y, *z], radius: *radius as f32 })
            }
            _ => Err(InvalidForeground),
        }
    }
}

impl fmt::Display for Foreground {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => out.write_str("all"),
            Self::Auto => out.write_str("auto"),
            Self::Share(share) => write!(out, "{share}"),
            Self::Ball { centre: [x, y, z], radius } => write!(out, "{x},{y},{z},{radius}"),
        }
    }
}

serialize_as_text!(Foreground);

/// Sentence on a foreground.
pub fn description(ball: &Ball) -> String {
    let [x, y, z] = ball.center;
    format!(
        "reflections are fitted in the foreground, within {:.3} of ({x:.3}, {y:.3}, {z:.3}), not in the background",
        ball.radius
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_words_shares_and_balls_are_foregrounds() {
        let ball = Foreground::Ball { centre: [1.0, -2.0, 0.5], radius: 3.0 };
        for (text, expected) in [
            ("all", Foreground::All),
            ("auto", Foreground::Auto),
            ("0.75", Foreground::Share(0.75)),
            ("1, -2,0.5,3", ball),
        ] {
            assert_eq!(text.parse(), Ok(expected), "{text:?}");
            assert_eq!(expected.to_string().parse(), Ok(expected), "{text:?} as it is written");
        }
        let moved = ball.ball(None, [0.5, -4.0, 0.0]).expect("it is a ball");
        assert_eq!((moved.center, moved.radius), ([0.5, 2.0, 0.5], 3.0));
        for wrong in ["", "some", "0", "-1", "1,2,3", "0,0,0,0", "0,0,0,-1", "NaN", "inf", "0,0,NaN,1", "1,2,3,4,5"] {
            assert!(wrong.parse::<Foreground>().is_err(), "{wrong:?} passed for a foreground");
        }
    }
}
