//! Requests from their query strings. Errors name the invalid parameter.

use crate::http::HttpError;
use axum::{extract::Query, http::Uri};
use core::{fmt::Display, str::FromStr};
use glam::Vec3;
use serde::{Deserialize, de::DeserializeOwned};
use specula_core::{
    camera::Camera,
    lamps::{Lamp, RAYS, check},
};
use specula_scene::{
    Layer, Shading,
    lamps::{SphereChoice, SunChoice, lamps_of},
};

/// Largest edge of a picture, in pixels.
const EDGE_MAX: u32 = 4096;
/// Largest number of pixels of a picture.
pub(crate) const PIXELS_MAX: u32 = 4 << 20;
/// Range of the horizontal field of view, in degrees.
const ANGLES: [f32; 2] = [1.0, 170.0];
/// Largest rotation of a light, in degrees.
const TURN_MAX: f32 = 3600.0;
/// Largest exposure of a light, in stops.
const STOPS_MAX: f32 = 16.0;
/// Cosine of the angle below which the viewing direction counts as parallel to the up vector.
const PARALLEL: f32 = 0.999_999;

/// Default quality of JPEGs.
const JPEG_QUALITY: u8 = 80;

/// Name of the layer of [`Content::Error`].
pub(crate) const ERROR: &str = "error";

/// Deserialises the parameters of a query. Unknown parameters are ignored, so that several types
/// read the same query.
pub(crate) fn query<T: DeserializeOwned>(uri: &Uri) -> Result<T, HttpError> {
    let Query(parameters) = Query::try_from_uri(uri)?;
    Ok(parameters)
}

/// Request of a picture.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FrameRequest {
    pub(crate) viewpoint: Viewpoint,
    /// Width and height in pixels.
    pub(crate) size: [u32; 2],
    pub(crate) content: Content,
    pub(crate) light: LightSetting,
    pub(crate) lamps: LampSetting,
    /// Requested colours; by default those for the light.
    pub(crate) shading: Option<Shading>,
    /// True if the light is the background, instead of a colour.
    pub(crate) has_backdrop: bool,
    /// True if ground catches the scene's shadows.
    pub(crate) has_ground: bool,
}

impl FrameRequest {
    /// Request of a `/frame`.
    pub(crate) fn of_frame(uri: &Uri) -> Result<Self, HttpError> {
        let ViewParameter { view } = query(uri)?;
        let viewpoint = match view {
            Some(index) => Viewpoint::View(index),
            None => Viewpoint::Pose(query(uri)?),
        };
        let PictureParameters { size, layer, shading, backdrop, ground } = query(uri)?;
        let lamps: LampSetting = query(uri)?;
        if !lamps.is_dark() && shading == Some(Shading::View) {
            return Err(HttpError::bad_request("suns and lamps light only physical materials; omit shading=view"));
        }
        Ok(Self {
            viewpoint,
            size: size.0,
            content: layer,
            light: query(uri)?,
            lamps,
            shading,
            has_backdrop: backdrop.is_some(),
            has_ground: ground.is_some(),
        })
    }

    /// Request of a `/point`.
    pub(crate) fn of_point(uri: &Uri) -> Result<Self, HttpError> {
        let PointParameters { at } = query(uri)?;
        Ok(Self { content: Content::Point(at.0), ..Self::of_frame(uri)? })
    }
}

#[derive(Deserialize)]
struct ViewParameter {
    view: Option<usize>,
}

#[derive(Deserialize)]
struct PictureParameters {
    size: Size,
    #[serde(default)]
    layer: Content,
    shading: Option<Shading>,
    backdrop: Option<Backdrop>,
    ground: Option<GroundParameter>,
}

#[derive(Deserialize)]
struct PointParameters {
    at: Position,
}

/// Background other than a colour.
#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Backdrop {
    Env,
}

/// Ground at the height of the scene's lowest point.
#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum GroundParameter {
    On,
}

/// Camera of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Viewpoint {
    /// View of the data set, by its index.
    View(usize),
    /// Free camera.
    Pose(Pose),
}

/// Pose and field of view of a free camera.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "PoseParameters")]
pub(crate) struct Pose {
    pub(crate) eye: Vec3,
    /// Unit viewing direction.
    pub(crate) look: Vec3,
    /// Unit vector towards the upper edge of the picture, not parallel to `look`.
    pub(crate) up: Vec3,
    /// Horizontal field of view, in radians.
    pub(crate) angle: f32,
}

impl Pose {
    /// Pose of a camera.
    pub(crate) fn of(camera: &Camera) -> Self {
        let rows = camera.camera_from_world;
        let angle = 2.0 * (0.5 * camera.width as f32 / camera.focal_px[0]).atan();
        Self { eye: camera.position, look: rows.row(2), up: -rows.row(1), angle }
    }
}

#[derive(Deserialize)]
struct PoseParameters {
    eye: Vector,
    look: Vector,
    up: Vector,
    /// In degrees.
    angle: f32,
}

impl TryFrom<PoseParameters> for Pose {
    type Error = String;

    fn try_from(parameters: PoseParameters) -> Result<Self, String> {
        let PoseParameters { eye: Vector(eye), look: Vector(look), up: Vector(up), angle } = parameters;
        let [least, most] = ANGLES;
        if !(least..=most).contains(&angle) {
            return Err(format!("angle must be from {least} to {most} degrees"));
        }
        match [look, up].map(Vec3::try_normalize) {
            [Some(look), Some(up)] if look.dot(up).abs() < PARALLEL => {
                Ok(Self { eye, look, up, angle: angle.to_radians() })
            }
            [Some(_), Some(_)] => Err("look and up must not be parallel".into()),
            _ => Err("look and up must not be 0,0,0".into()),
        }
    }
}

/// Result of a request.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub(crate) enum Content {
    /// Layer of the scene.
    Layer(Layer),
    /// Difference between the nearest view of the data set and its photograph.
    Error,
    /// Point of the scene at a position in the picture, as fractions of its width and height.
    Point([f32; 2]),
}

impl Default for Content {
    fn default() -> Self {
        Self::Layer(Layer::Rgb)
    }
}

impl TryFrom<String> for Content {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.parse() {
            _ if name == ERROR => Ok(Self::Error),
            Ok(layer) if layer != Layer::All => Ok(Self::Layer(layer)),
            _ => Err(format!("no layer {name:?}; /scene lists all layers")),
        }
    }
}

/// Light of a picture, its rotation and its exposure.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "LightParameters")]
pub(crate) struct LightSetting {
    pub(crate) id: u32,
    /// Rotation about the scene's up direction, in degrees.
    pub(crate) turn: f32,
    /// Exposure: radiance is multiplied by two to this power.
    pub(crate) stops: f32,
}

/// Identifier of no light, called `none`.
pub(crate) const DARKNESS: u32 = u32::MAX;
/// Name of [`DARKNESS`].
pub(crate) const NONE: &str = "none";

/// Identifier of a light, as text.
#[derive(Default, Deserialize)]
#[serde(try_from = "String")]
pub(crate) struct LightId(pub(crate) u32);

impl TryFrom<String> for LightId {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, &'static str> {
        match text.parse() {
            _ if text == NONE => Ok(Self(DARKNESS)),
            Ok(id) => Ok(Self(id)),
            Err(_) => Err("use the number of a light that /scene lists, or none"),
        }
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct LightParameters {
    light: LightId,
    turn: f32,
    stops: f32,
}

impl TryFrom<LightParameters> for LightSetting {
    type Error = String;

    fn try_from(LightParameters { light: LightId(id), turn, stops }: LightParameters) -> Result<Self, String> {
        Self::new(id, turn, stops)
    }
}

impl LightSetting {
    /// Light within its bounds.
    ///
    /// # Errors
    ///
    /// A sentence with the valid range.
    pub(crate) fn new(id: u32, turn: f32, stops: f32) -> Result<Self, String> {
        if !(turn.abs() <= TURN_MAX) {
            return Err(format!("turn must be from -{TURN_MAX} to {TURN_MAX} degrees"));
        }
        if !(stops.abs() <= STOPS_MAX) {
            return Err(format!("stops must be from -{STOPS_MAX} to {STOPS_MAX}"));
        }
        Ok(Self { id, turn, stops })
    }
}

/// Suns and lamps of a picture.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(try_from = "LampParameters")]
pub(crate) struct LampSetting {
    pub(crate) suns: Vec<SunChoice>,
    pub(crate) spheres: Vec<SphereChoice>,
    /// Shadow rays of a pixel to each area lamp.
    pub(crate) rays: usize,
}

impl LampSetting {
    /// Largest number of suns and lamps of a picture.
    pub(crate) const COUNT_MAX: usize = 8;

    /// Suns and lamps within their bounds.
    ///
    /// # Errors
    ///
    /// A sentence with the valid range.
    pub(crate) fn new(suns: Vec<SunChoice>, spheres: Vec<SphereChoice>, rays: usize) -> Result<Self, String> {
        let (count, most) = (suns.len() + spheres.len(), Self::COUNT_MAX);
        if count > most {
            return Err(format!("use at most {most} suns and lamps in total, not {count}"));
        }
        if !(1..=RAYS).contains(&rays) {
            return Err(format!("rays must be from 1 to {RAYS}"));
        }
        let setting = Self { suns, spheres, rays };
        check(&setting.lamps(Vec3::Z, 0.0), rays).map_err(|fault| fault.to_string())?;
        Ok(setting)
    }

    /// Whether there are none.
    pub(crate) const fn is_dark(&self) -> bool {
        self.suns.is_empty() && self.spheres.is_empty()
    }

    /// Lamps in a scene with this up direction; suns are turned about it by an angle in degrees.
    pub(crate) fn lamps(&self, up: Vec3, turn: f32) -> Vec<Lamp> {
        lamps_of(&self.suns, &self.spheres, up, turn)
    }
}

/// Suns and lamps in the notation of `relight`, separated by semicolons.
#[derive(Deserialize)]
#[serde(default)]
struct LampParameters {
    suns: String,
    lamps: String,
    rays: usize,
}

impl Default for LampParameters {
    fn default() -> Self {
        Self { suns: String::new(), lamps: String::new(), rays: RAYS }
    }
}

impl TryFrom<LampParameters> for LampSetting {
    type Error = String;

    fn try_from(LampParameters { suns, lamps, rays }: LampParameters) -> Result<Self, String> {
        Self::new(entries(&suns, "suns")?, entries(&lamps, "lamps")?, rays)
    }
}

/// Parses entries separated by semicolons; empty for an empty text.
pub(crate) fn entries<T: FromStr<Err: Display>>(text: &str, name: &str) -> Result<Vec<T>, String> {
    let entries = text.split(';').filter(|_| !text.is_empty());
    let parse = |entry: &str| entry.parse().map_err(|error| format!("{name}: invalid {entry:?}; {error}"));
    entries.map(parse).collect()
}

/// Encoding of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// Lossless.
    Png,
    /// Lossy, with a quality from 1 to 100.
    Jpeg(u8),
}

impl Encoding {
    /// Requested encoding; PNG by default.
    pub(crate) fn of(uri: &Uri) -> Result<Self, HttpError> {
        let FormatParameter { format } = query(uri)?;
        match format {
            Format::Png => Ok(Self::Png),
            Format::Jpeg => match query(uri)? {
                QualityParameter { quality: quality @ 1..=100 } => Ok(Self::Jpeg(quality)),
                QualityParameter { .. } => Err(HttpError::bad_request("quality must be from 1 to 100")),
            },
        }
    }
}

#[derive(Deserialize)]
struct FormatParameter {
    #[serde(default)]
    format: Format,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Format {
    #[default]
    Png,
    Jpeg,
}

#[derive(Deserialize)]
#[serde(default)]
struct QualityParameter {
    quality: u8,
}

impl Default for QualityParameter {
    fn default() -> Self {
        Self { quality: JPEG_QUALITY }
    }
}

/// Client that takes turns with others; 0 is anonymous.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(crate) struct ClientParameter {
    pub(crate) client: u64,
}

/// Control of a training.
#[derive(Deserialize)]
pub(crate) struct SteeringParameters {
    #[serde(rename = "do")]
    pub(crate) action: Action,
    /// Steps of [`Action::Step`].
    #[serde(default = "one")]
    pub(crate) steps: u32,
}

fn one() -> u32 {
    1
}

/// Action of a training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Action {
    /// Pauses.
    Pause,
    /// Resumes.
    Go,
    /// Takes some steps and pauses.
    Step,
}

/// Finite vector.
#[derive(Deserialize)]
#[serde(try_from = "String")]
struct Vector(Vec3);

impl TryFrom<String> for Vector {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let vector = Vec3::from(numbers::<f32, 3>(&text)?);
        // The square of its length must also be finite.
        if vector.length_squared().is_finite() { Ok(Self(vector)) } else { Err("use three finite numbers".into()) }
    }
}

/// Width and height of a picture.
#[derive(Deserialize)]
#[serde(try_from = "String")]
struct Size([u32; 2]);

impl TryFrom<String> for Size {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let [width, height] = numbers::<u32, 2>(&text)?;
        let is_valid = |edge: u32| (1..=EDGE_MAX).contains(&edge);
        if is_valid(width) && is_valid(height) && width * height <= PIXELS_MAX {
            Ok(Self([width, height]))
        } else {
            Err(format!("use two numbers from 1 to {EDGE_MAX}, with at most {PIXELS_MAX} pixels"))
        }
    }
}

/// Position in a picture, as fractions of its width and height.
#[derive(Deserialize)]
#[serde(try_from = "String")]
struct Position([f32; 2]);

impl TryFrom<String> for Position {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let position = numbers::<f32, 2>(&text)?;
        if position.iter().all(|fraction| (0.0..=1.0).contains(fraction)) {
            Ok(Self(position))
        } else {
            Err("use two numbers from 0 to 1".into())
        }
    }
}

/// Parses `N` numbers separated by commas.
fn numbers<T: FromStr, const N: usize>(text: &str) -> Result<[T; N], String> {
    let numbers: Option<Vec<T>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or_else(|| format!("use {N} numbers separated by commas, not {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "eye=1,2,3&look=0,1,0&up=0,0,1&angle=40&size=640,480";

    fn uri(query: &str) -> Uri {
        format!("/frame?{query}").parse().unwrap()
    }

    fn frame(query: &str) -> Result<FrameRequest, HttpError> {
        FrameRequest::of_frame(&uri(query))
    }

    #[test]
    fn a_complete_query_is_parsed() {
        let request = frame(&format!("{GOOD}&layer=normal&light=2&turn=-30&stops=1.5")).unwrap();
        assert_eq!(request.size, [640, 480]);
        assert_eq!(request.content, Content::Layer(Layer::Normal));
        assert_eq!(request.light, LightSetting { id: 2, turn: -30.0, stops: 1.5 });
        assert!(matches!(request.viewpoint, Viewpoint::Pose(pose) if pose.look == Vec3::Y));
        assert_eq!(frame("view=3&size=1,1").unwrap().viewpoint, Viewpoint::View(3));
    }

    #[test]
    fn suns_and_lamps_are_those_of_relight() {
        assert!(frame(GOOD).unwrap().lamps.is_dark());
        assert!(frame(&format!("{GOOD}&suns=&lamps=")).unwrap().lamps.is_dark(), "an empty list is one");
        let request = frame(&format!("{GOOD}&suns=30,45;-20,10,2,3:ff8800&lamps=1,-2,3,4,0.5&rays=4&turn=60")).unwrap();
        let LampSetting { suns, spheres, rays } = &request.lamps;
        assert_eq!(suns[..], ["30,45", "-20,10,2,3:ff8800"].map(|text| text.parse().unwrap()));
        assert_eq!((&spheres[..], *rays), (&["1,-2,3,4,0.5".parse().unwrap()][..], 4));
        let lamps = request.lamps.lamps(Vec3::Z, request.light.turn);
        assert_eq!(lamps[0], "90,45".parse::<SunChoice>().unwrap().lamp(Vec3::Z, 0.0), "suns turn with the light");
        assert_eq!(lamps[2], spheres[0].lamp(), "and lamps stay");
        let eight = ["0,45"; LampSetting::COUNT_MAX].join(";");
        assert_eq!(frame(&format!("{GOOD}&suns={eight}")).unwrap().lamps.rays, RAYS, "all rays by default");
        assert_eq!(frame(&format!("{GOOD}&light=none")).unwrap().light.id, DARKNESS);
        assert_eq!(frame(&format!("{GOOD}&shading=physical")).unwrap().shading, Some(Shading::Physical));
    }

    #[test]
    fn unused_parameters_are_ignored() {
        assert!(frame("view=3&size=1,1&eye=nowhere").is_ok(), "a view has its own pose");
        assert_eq!(Encoding::of(&uri("format=png&quality=none")).unwrap(), Encoding::Png);
        assert_eq!(Encoding::of(&uri("")).unwrap(), Encoding::Png);
        assert_eq!(Encoding::of(&uri("format=jpeg")).unwrap(), Encoding::Jpeg(JPEG_QUALITY));
    }

    #[test]
    fn errors_name_the_invalid_parameter() {
        let with = |more: &str| format!("{GOOD}&{more}");
        // Repeated parameters are rejected, so these replace the valid ones.
        let replaced = |more: &str| {
            let name = more.split('=').next().unwrap();
            let kept = GOOD.split('&').filter(|pair| pair.split('=').next() != Some(name));
            kept.chain([more]).collect::<Vec<_>>().join("&")
        };
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
            ("ground=2", "ground"),
            ("light=sun", "light"),
            ("shading=matte", "shading"),
            ("suns=30", "suns"),
            ("suns=NaN,40", "suns"),
            ("suns=0,91", "suns"),
            ("suns=0,45,inf", "suns"),
            ("suns=0,45;", "suns"),
            ("suns=0,45,1:red", "suns"),
            ("suns=0,45,2e9", "1000000000"),
            ("lamps=1,2,3", "lamps"),
            ("lamps=1,2,3,-4", "lamps"),
            ("lamps=NaN,2,3,4", "lamps"),
            ("lamps=2e9,0,0,1", "1000000000"),
            ("lamps=1,2,3,4,2e9", "1000000000"),
            ("suns=0,1;0,2;0,3;0,4;0,5&lamps=0,0,0,1;0,0,0,2;0,0,0,3;0,0,0,4", "at most 8"),
            ("rays=0", "rays"),
            ("rays=33", "rays"),
            ("suns=0,45&shading=view", "shading=view"),
        ];
        for (more, word) in cases {
            let message = frame(&replaced(more)).unwrap_err().message;
            assert!(message.contains(word), "{more}: {message}");
        }
        let point = FrameRequest::of_point(&uri(&with("at=0.5,1.5"))).unwrap_err();
        assert!(point.message.contains("at"));
        for (more, word) in [("format=gif", "format"), ("format=jpeg&quality=0", "quality")] {
            let message = Encoding::of(&uri(&with(more))).unwrap_err().message;
            assert!(message.contains(word), "{more}: {message}");
        }
        let missing = frame("size=1,1").unwrap_err().message;
        assert!(missing.contains("missing") && missing.contains("eye"), "{missing}");
        let twice = frame(&with("size=1,1")).unwrap_err().message;
        assert!(twice.contains("duplicate") && twice.contains("size"), "{twice}");
    }
}
