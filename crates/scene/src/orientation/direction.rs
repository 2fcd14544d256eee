//! Up direction of a scene as text.

use crate::text::{numbers, serialize_as_text};
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

/// Up direction as text: an axis such as `z` or `-y`, or a vector of any length but 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpDirection([f64; 3]);

/// Text that is not an [`UpDirection`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("use x, y, z, -x, -y, -z, or three numbers that are not all 0 such as 0,-0.9,-0.4")]
pub struct InvalidUpDirection;

impl FromStr for UpDirection {
    type Err = InvalidUpDirection;

    fn from_str(text: &str) -> Result<Self, InvalidUpDirection> {
        if let Some((_, axis)) = AXES.iter().find(|(name, _)| *name == text.trim_start_matches('+')) {
            return Ok(Self(*axis));
        }
        match numbers::<f64>(text).as_deref() {
            Some([x, y, z]) if [x, y, z].iter().all(|x| x.is_finite()) && [x, y, z].iter().any(|x| **x != 0.0) => {
                Ok(Self([*x, *y, *z]))
            }
            _ => Err(InvalidUpDirection),
        }
    }
}

impl fmt::Display for UpDirection {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0;
        write!(out, "{x},{y},{z}")
    }
}

serialize_as_text!(UpDirection);

impl From<UpDirection> for [f64; 3] {
    fn from(UpDirection(up): UpDirection) -> Self {
        up
    }
}

/// Sentence on the up direction of a scene: its source and its standard error.
pub fn description(orientation: &Orientation) -> String {
    let Orientation { up, up_source, cameras, rolled, error_degrees, .. } = orientation;
    let up = direction_text(*up);
    let rolled = if *rolled > 0 { format!(", {rolled} of them on their side or upside down") } else { String::new() };
    match (up_source, error_degrees) {
        (UpSource::Hand, _) => format!("up is {up}, as given"),
        (UpSource::File, _) => format!("up is {up}, from its file"),
        (UpSource::Nothing, _) if *cameras == 0 => format!("up is assumed to be {up}: no camera determines it"),
        (UpSource::Mean | UpSource::Nothing, _) | (_, None) => {
            format!("up is assumed to be {up}: {cameras} cameras are too similar to determine it")
        }
        (UpSource::Level, Some(error)) => {
            format!("up is {up} within {}°, or the opposite, from {cameras} cameras{rolled}", shown_error(*error))
        }
        (UpSource::Upright | UpSource::Height, Some(error)) => {
            format!("up is {up} within {}°, from {cameras} cameras{rolled}", shown_error(*error))
        }
    }
}

/// Error with a digit, rounded up to one.
fn shown_error(degrees: f64) -> String {
    format!("{:.1}", degrees.max(0.1))
}

/// Name of an axis; components of another direction.
fn direction_text(direction: [f64; 3]) -> String {
    let axis = AXES.iter().find(|(_, axis)| *axis == direction);
    let sign = |name: &str| if name.starts_with('-') { name.to_owned() } else { format!("+{name}") };
    let numbers = || format!("({})", direction.map(|x| format!("{x:.3}")).join(", "));
    axis.map_or_else(numbers, |(name, _)| sign(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_parsed() {
        for (text, expected) in [("z", [0.0, 0.0, 1.0]), ("-y", [0.0, -1.0, 0.0]), ("0,-0.9, -0.4", [0.0, -0.9, -0.4])]
        {
            let read: UpDirection = text.parse().expect("a direction");
            assert_eq!(read, UpDirection(expected));
            assert_eq!(read.to_string().parse(), Ok(read), "printed directions are parsed back");
        }
        for text in ["", "up", "1,2", "0,0,0", "1,2,nan", "--y"] {
            assert!(text.parse::<UpDirection>().is_err(), "{text:?}");
        }
    }

    #[test]
    fn descriptions_state_the_certainty() {
        let sure = Orientation {
            up: [0.0, 0.0, 1.0],
            centre: [0.0; 3],
            distance: 1.0,
            up_source: UpSource::Upright,
            cameras: 77,
            rolled: 41,
            error_degrees: Some(0.31),
        };
        let said = description(&sure);
        assert!(said.starts_with("up is +z within 0.3°, from 77 cameras, 41 of them"), "{said}");
        let unsure =
            Orientation { up: [0.0, 0.6, 0.8], up_source: UpSource::Mean, cameras: 1, error_degrees: None, ..sure };
        assert!(description(&unsure).contains("(0.000, 0.600, 0.800)") && description(&unsure).contains("too similar"));
    }
}
