//! Up direction of a scene on the command line.

use crate::typed::{kept_as_typed, numbers};
use core::{fmt, str::FromStr};
use specula_io::orientation::{Orientation, UpSource};

/// Axes by their names.
const AXES: [(&str, [f64; 3]); 6] = [
    ("x", [1.0, 0.0, 0.0]),
    ("y", [0.0, 1.0, 0.0]),
    ("z", [0.0, 0.0, 1.0]),
    ("-x", [-1.0, 0.0, 0.0]),
    ("-y", [0.0, -1.0, 0.0]),
    ("-z", [0.0, 0.0, -1.0]),
];

/// Up direction as given by the user: an axis, or a vector of any length but 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct UpChoice([f64; 3]);

impl FromStr for UpChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some((_, axis)) = AXES.iter().find(|(name, _)| *name == text.trim_start_matches('+')) {
            return Ok(Self(*axis));
        }
        match numbers::<f64>(text).as_deref() {
            Some([x, y, z]) if [x, y, z].iter().all(|x| x.is_finite()) && [x, y, z].iter().any(|x| **x != 0.0) => {
                Ok(Self([*x, *y, *z]))
            }
            _ => Err("use x, y, z, -x, -y, -z, or three numbers that are not all 0 such as 0,-0.9,-0.4".into()),
        }
    }
}

impl fmt::Display for UpChoice {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0;
        write!(out, "{x},{y},{z}")
    }
}

kept_as_typed!(UpChoice);

impl From<UpChoice> for [f64; 3] {
    fn from(UpChoice(up): UpChoice) -> Self {
        up
    }
}

/// Sentence on the orientation of a data set.
pub(crate) fn words(orientation: &Orientation) -> String {
    let Orientation { up, up_source, cameras, rolled, error_degrees, .. } = orientation;
    let up = direction_words(*up);
    let rolled = if *rolled > 0 { format!(", {rolled} of them on their side or upside down") } else { String::new() };
    match (up_source, error_degrees) {
        (UpSource::Hand, _) => format!("up is {up}, as given"),
        (UpSource::Mean | UpSource::Nothing, _) | (_, None) => format!(
            "up is taken to be {up}: {cameras} cameras are too alike to determine it; if it is wrong, set --scene-up X,Y,Z"
        ),
        (UpSource::Level, Some(error)) => format!(
            "up is {up} within {error:.1}°, or the opposite, from {cameras} cameras{rolled}; if it is the opposite, set \
             --scene-up X,Y,Z"
        ),
        (UpSource::Upright | UpSource::Height, Some(error)) => {
            format!("up is {up} within {error:.1}°, from {cameras} cameras{rolled}")
        }
    }
}

/// Name of an axis; components of another direction.
fn direction_words(direction: [f64; 3]) -> String {
    let axis = AXES.iter().find(|(_, axis)| *axis == direction);
    let sign = |name: &str| if name.starts_with('-') { name.to_owned() } else { format!("+{name}") };
    let numbers = || format!("({})", direction.map(|x| format!("{x:.3}")).join(", "));
    axis.map_or_else(numbers, |(name, _)| sign(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_is_read_as_it_is_typed() {
        for (text, expected) in [("z", [0.0, 0.0, 1.0]), ("-y", [0.0, -1.0, 0.0]), ("0,-0.9, -0.4", [0.0, -0.9, -0.4])]
        {
            let read: UpChoice = text.parse().unwrap();
            assert_eq!(read, UpChoice(expected));
            assert_eq!(read.to_string().parse(), Ok(read), "what is written is read again");
        }
        for text in ["", "up", "1,2", "0,0,0", "1,2,nan", "--y"] {
            assert!(text.parse::<UpChoice>().is_err(), "{text:?}");
        }
    }

    #[test]
    fn words_say_what_is_sure_and_what_is_not() {
        let sure = Orientation {
            up: [0.0, 0.0, 1.0],
            centre: [0.0; 3],
            distance: 1.0,
            up_source: UpSource::Upright,
            cameras: 77,
            rolled: 41,
            error_degrees: Some(0.31),
        };
        let said = words(&sure);
        assert!(said.starts_with("up is +z within 0.3°, from 77 cameras, 41 of them"), "{said}");
        let unsure =
            Orientation { up: [0.0, 0.6, 0.8], up_source: UpSource::Mean, cameras: 1, error_degrees: None, ..sure };
        assert!(words(&unsure).contains("(0.000, 0.600, 0.800)") && words(&unsure).contains("--scene-up"));
    }
}
