//! Light that is known before training.

use core::{fmt, str::FromStr};
use serde::{Serialize, Serializer};
use specula_io::budget::RADIANCE_MAX;
use std::path::PathBuf;

/// Prior knowledge of the light.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum LightReference {
    /// Complete light: a lat-long map in a file.
    Map(PathBuf),
    /// Mean linear radiance only.
    Mean([f32; 3]),
}

impl fmt::Display for LightReference {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Map(path) => path.to_string_lossy().fmt(out),
            Self::Mean([red, green, blue]) if red == green && green == blue => red.fmt(out),
            Self::Mean([red, green, blue]) => write!(out, "{red},{green},{blue}"),
        }
    }
}

impl Serialize for LightReference {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// A file, or a mean radiance: one number or three. For a file whose name is a number, write its
/// folder as well.
impl FromStr for LightReference {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse::<f32>()).collect();
        let mean = match numbers.as_deref() {
            Ok(&[grey]) => [grey; 3],
            Ok(&[red, green, blue]) => [red, green, blue],
            _ => return Ok(Self::Map(text.into())),
        };
        if mean.iter().all(|number| *number > 0.0 && *number <= RADIANCE_MAX) {
            Ok(Self::Mean(mean))
        } else {
            Err(format!("use a mean radiance above zero and at most {RADIANCE_MAX:e}, or a light file"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_is_known_from_a_file_or_by_its_mean() {
        let mean = |numbers| Ok(LightReference::Mean(numbers));
        assert_eq!(LightReference::from_str("0.8"), mean([0.8; 3]));
        assert_eq!(LightReference::from_str("0.8,1, 1.25"), mean([0.8, 1.0, 1.25]));
        for file in ["probe.hdr", "./0.8", "1,2", "1,2,3,4", "a,b,c", ""] {
            assert_eq!(file.parse(), Ok(LightReference::Map(file.into())));
        }
        for text in ["0", "-1", "nan", "inf", "1e30", "1,0,1"] {
            assert!(text.parse::<LightReference>().is_err_and(|words| words.contains("above zero")), "{text}");
        }
        for text in ["0.8", "0.8,1,1.25"] {
            assert_eq!(text.parse::<LightReference>().unwrap().to_string(), text, "as it is stored");
        }
    }
}
