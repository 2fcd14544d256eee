//! What a client asks for, from the words of a query. What cannot be is refused in a sentence.

use crate::typed::numbers;
use core::str::FromStr;
use glam::Vec3;
use specula_scene::Layer;
use std::collections::HashMap;

/// Pixels along an edge of a picture, and in all of it, at most.
const EDGE_MAX: u32 = 4096;
pub(super) const PIXELS_MAX: u32 = 4 << 20;
/// The horizontal field of view in degrees, at least and at most.
const ANGLES: [f32; 2] = [1.0, 170.0];
/// Times two to this power, at most, up or down.
const STOPS_MAX: f32 = 16.0;
/// Cosine of an angle below which a view counts as parallel to what is above.
const PARALLEL: f32 = 0.999_999;

/// A picture that is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ask {
    pub(super) from: From,
    pub(super) size: [u32; 2],
    pub(super) show: Show,
    pub(super) light: LightAsk,
    /// Whether the light is behind the scene, instead of a colour.
    pub(super) has_backdrop: bool,
}

/// From where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum From {
    /// A view that the scene knows, by its number.
    View(usize),
    /// Anywhere.
    Pose(Pose),
}

/// A place to look from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    pub(super) eye: Vec3,
    /// Ahead; of any length but zero.
    pub(super) look: Vec3,
    /// Upwards in the picture; not parallel to the view.
    pub(super) up: Vec3,
    /// Horizontal field of view, in radians.
    pub(super) angle: f32,
}

/// What of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Show {
    /// A layer of the picture.
    Layer(Layer),
    /// How far the nearest view that the scene knows is from its photograph.
    Error,
    /// The place that is seen at a point of the picture, in shares of its width and height.
    Point([f32; 2]),
}

/// The name of [`Show::Error`].
pub(super) const ERROR: &str = "error";

/// Which light, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LightAsk {
    pub(super) id: u32,
    /// Turned about what is above, in degrees.
    pub(super) turn: f32,
    /// Times two to this power.
    pub(super) stops: f32,
}

/// How a picture is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    /// Exactly.
    Png,
    /// In less room, with a quality of 1 to 100.
    Jpeg(u8),
}

/// The words of a query, by name.
#[derive(Debug)]
pub(super) struct Words(pub(super) HashMap<String, String>);

impl Words {
    /// The picture that is asked for.
    pub(super) fn ask(&self) -> Result<Ask, String> {
        let has_backdrop = match self.0.get("backdrop").map(String::as_str) {
            None => false,
            Some("env") => true,
            Some(_) => return Err("backdrop is env, or left out".into()),
        };
        Ok(Ask { from: self.from()?, size: self.size()?, show: self.show()?, light: self.light()?, has_backdrop })
    }

    /// The place that is asked for.
    pub(super) fn point(&self) -> Result<Ask, String> {
        let at = self.numbers::<f32, 2>("at")?;
        if !at.iter().all(|share| (0.0..=1.0).contains(share)) {
            return Err("at is two numbers from 0 to 1".into());
        }
        Ok(Ask { show: Show::Point(at), ..self.ask()? })
    }

    /// How it is packed.
    pub(super) fn packing(&self) -> Result<Packing, String> {
        match self.0.get("format").map(String::as_str) {
            None | Some("png") => Ok(Packing::Png),
            Some("jpeg") => match self.or("quality", 80)? {
                quality @ 1..=100 => Ok(Packing::Jpeg(quality)),
                _ => Err("quality is from 1 to 100".into()),
            },
            Some(_) => Err("format is png or jpeg".into()),
        }
    }

    /// Who asks.
    pub(super) fn client(&self) -> Result<u64, String> {
        self.or("client", 0)
    }

    /// Which light, and how.
    pub(super) fn light(&self) -> Result<LightAsk, String> {
        let ask = LightAsk { id: self.or("light", 0)?, turn: self.or("turn", 0.0)?, stops: self.or("stops", 0.0)? };
        if !ask.turn.is_finite() || ask.turn.abs() > 3600.0 {
            return Err("turn is an angle in degrees, from -3600 to 3600".into());
        }
        if !(ask.stops.abs() <= STOPS_MAX) {
            return Err(format!("stops is from {} to {STOPS_MAX}", -STOPS_MAX));
        }
        Ok(ask)
    }

    fn from(&self) -> Result<From, String> {
        match self.0.get("view") {
            Some(_) => Ok(From::View(self.needed("view")?)),
            None => Ok(From::Pose(self.pose()?)),
        }
    }

    fn pose(&self) -> Result<Pose, String> {
        let pose = Pose {
            eye: self.vector("eye")?,
            look: self.vector("look")?,
            up: self.vector("up")?,
            angle: self.angle()?.to_radians(),
        };
        let [look, up] = [pose.look, pose.up].map(Vec3::try_normalize);
        match (look, up) {
            (Some(look), Some(up)) if look.dot(up).abs() < PARALLEL => Ok(Pose { look, up, ..pose }),
            (Some(_), Some(_)) => Err("look and up are parallel; let them differ".into()),
            _ => Err("look and up have a length; none of them is 0,0,0".into()),
        }
    }

    fn angle(&self) -> Result<f32, String> {
        let [least, most] = ANGLES;
        let angle: f32 = self.needed("angle")?;
        if (least..=most).contains(&angle) {
            Ok(angle)
        } else {
            Err(format!("angle is from {least} to {most} degrees"))
        }
    }

    fn size(&self) -> Result<[u32; 2], String> {
        let [width, height] = self.numbers::<u32, 2>("size")?;
        let is_fine = |edge: u32| (1..=EDGE_MAX).contains(&edge);
        if is_fine(width) && is_fine(height) && width * height <= PIXELS_MAX {
            Ok([width, height])
        } else {
            Err(format!("size is two numbers from 1 to {EDGE_MAX}, and at most {PIXELS_MAX} pixels in all"))
        }
    }

    fn show(&self) -> Result<Show, String> {
        match self.0.get("layer").map_or("rgb", String::as_str) {
            ERROR => Ok(Show::Error),
            name => match name.parse() {
                Ok(layer) if layer != Layer::All => Ok(Show::Layer(layer)),
                _ => Err(format!("no layer {name:?}; /scene lists those that there are")),
            },
        }
    }

    fn vector(&self, name: &str) -> Result<Vec3, String> {
        let vector = Vec3::from(self.numbers::<f32, 3>(name)?);
        // The square of a length has to be finite as well.
        if vector.length_squared().is_finite() { Ok(vector) } else { Err(format!("{name} is three finite numbers")) }
    }

    fn numbers<T: FromStr, const N: usize>(&self, name: &str) -> Result<[T; N], String> {
        let text = self.word(name)?;
        let numbers = numbers(text).and_then(|numbers| numbers.try_into().ok());
        numbers.ok_or_else(|| format!("{name} is {N} numbers with commas, and {text:?} is not"))
    }

    fn needed<T: FromStr>(&self, name: &str) -> Result<T, String> {
        let text = self.word(name)?;
        text.parse().map_err(|_| format!("{name} is a number, and {text:?} is none"))
    }

    /// A number, or what is usual.
    pub(super) fn or<T: FromStr>(&self, name: &str, usual: T) -> Result<T, String> {
        if self.0.contains_key(name) { self.needed(name) } else { Ok(usual) }
    }

    fn word(&self, name: &str) -> Result<&str, String> {
        self.0.get(name).map(String::as_str).ok_or_else(|| format!("{name} is missing"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "eye=1,2,3&look=0,1,0&up=0,0,1&angle=40&size=640,480";

    fn words(query: &str) -> Words {
        let pairs = query.split('&').filter_map(|pair| pair.split_once('='));
        Words(pairs.map(|(name, word)| (name.to_owned(), word.to_owned())).collect())
    }

    #[test]
    fn a_whole_query_is_understood() {
        let ask = words(&format!("{GOOD}&layer=normal&light=2&turn=-30&stops=1.5")).ask().unwrap();
        assert_eq!(ask.size, [640, 480]);
        assert_eq!(ask.show, Show::Layer(Layer::Normal));
        assert_eq!(ask.light, LightAsk { id: 2, turn: -30.0, stops: 1.5 });
        assert!(matches!(ask.from, From::Pose(pose) if pose.look == Vec3::Y));
        assert_eq!(words("view=3&size=1,1").ask().unwrap().from, From::View(3));
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let with = |more: &str| words(&format!("{GOOD}&{more}"));
        let cases = [
            ("angle=0", "angle"),
            ("angle=NaN", "angle"),
            ("size=0,5", "size"),
            ("size=4096,4096", "size"),
            ("size=70000,70000", "size"),
            ("size=5", "size"),
            ("eye=1,2", "eye"),
            ("eye=1,2,inf", "eye"),
            ("eye=1e38,1e38,1e38", "eye"),
            ("look=0,0,0", "look"),
            ("look=0,0,2", "parallel"),
            ("layer=all", "all"),
            ("layer=colour", "colour"),
            ("turn=inf", "turn"),
            ("stops=99", "stops"),
            ("stops=NaN", "stops"),
            ("light=-1", "light"),
            ("view=x", "view"),
            ("backdrop=red", "backdrop"),
        ];
        for (more, word) in cases {
            let sentence = with(more).ask().unwrap_err();
            assert!(sentence.contains(word), "{more}: {sentence}");
        }
        assert!(with("at=0.5,1.5").point().unwrap_err().contains("at"));
        for (more, word) in [("format=gif", "format"), ("format=jpeg&quality=0", "quality")] {
            assert!(with(more).packing().unwrap_err().contains(word), "{more}");
        }
        assert!(words("size=1,1").ask().unwrap_err().contains("eye is missing"));
    }
}
