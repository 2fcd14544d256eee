//! Causes of bad reconstructions, each with a remedy.

use crate::{frames::median, look::Look};
use glam::DVec3;
use serde::Serialize;
use specula_io::reconstruction::Reconstruction;

/// Share of pictures with a camera below which that is a finding.
const REGISTERED_MIN: f64 = 0.95;
/// Median angle between the rays of a point in degrees, below which depths are uncertain.
const ANGLE_MIN: f64 = 3.0;
/// Mean reprojection error in pixels.
const ERROR_MAX: f64 = 1.5;
/// Mean number of pictures of a point.
const TRACK_MIN: f64 = 3.0;
/// Median sharpness of blurred pictures; one picture is blurred below this share of the median.
const SHARPNESS_MIN: f32 = 0.28;
const BLURRED: f32 = 0.75;
/// Coverage of a picture up to which it shows a thing that is cut out.
const CUT_OUT: f32 = 0.9;
/// Ratio of brightness between the tenth and the ninetieth hundredth of the pictures.
const EXPOSURE_MAX: f32 = 1.6;
/// Least number of pictures of an object.
const PICTURES_MIN: usize = 30;
/// Largest angle around the object without a camera, in degrees.
const GAP_MAX: f64 = 100.0;
/// Number of points whose rays are measured.
const SAMPLES: usize = 2000;

/// A cause, and what helps.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Short name of the kind.
    pub kind: &'static str,
    /// Cause, in a clause.
    pub cause: String,
    /// Remedy, in a clause.
    pub remedy: &'static str,
}

impl Finding {
    /// Kind of pictures that differ in brightness.
    pub const EXPOSURE: &'static str = "exposure";
}

/// Facts of a data set.
#[derive(Clone, Debug, Default)]
pub struct Evidence<'a> {
    /// Number of pictures of the folder, with a camera or without.
    pub pictures: usize,
    /// Names of those without a camera.
    pub lost: &'a [String],
    /// Cameras and points.
    pub reconstruction: Option<&'a Reconstruction>,
    /// Sharpness and brightness of pictures.
    pub looks: &'a [Look],
    /// Up direction and centre of the scene.
    pub orientation: Option<([f64; 3], [f64; 3])>,
    /// Positions of the cameras, in the coordinates of the orientation.
    pub positions: &'a [[f64; 3]],
}

/// Sentence for a capture without cameras, by the number of pictures with matches to others.
pub(crate) fn of_failure(pictures: usize, connected: u64) -> String {
    match connected as f64 >= 0.5 * pictures as f64 {
        true => format!(
            "no cameras were found, although {connected} of {pictures} pictures match others: the camera only turned on the \
             spot, or hardly moved; walk around the object, a step between two pictures"
        ),
        false => format!(
            "no cameras were found: {connected} of {pictures} pictures match others, so they are blurred, too far apart or \
             without texture; take pictures that overlap by two thirds, and put a patterned cloth or a newspaper under the \
             object"
        ),
    }
}

/// Findings, the most serious first; none for a good data set.
pub fn findings(evidence: &Evidence<'_>) -> Vec<Finding> {
    let mut found = match evidence.reconstruction {
        Some(model) => of_reconstruction(model, evidence.pictures, evidence.lost),
        None => Vec::new(),
    };
    if (1..PICTURES_MIN).contains(&evidence.pictures) {
        found.push(Finding {
            kind: "few",
            cause: format!("there are only {} pictures", evidence.pictures),
            remedy: "take 50 to 150, from all around: with few pictures, views between them stay poor",
        });
    }
    found.extend(of_looks(evidence.looks));
    found.extend(gap(evidence));
    found
}

fn of_reconstruction(model: &Reconstruction, pictures: usize, lost: &[String]) -> Vec<Finding> {
    /// Largest number of names in a sentence.
    const NAMED: usize = 6;
    let mut found = Vec::new();
    let registered = model.pictures.len();
    if (registered as f64) < REGISTERED_MIN * pictures as f64 {
        let mut names = lost[..lost.len().min(NAMED)].join(", ");
        if lost.len() > NAMED {
            names += &format!(" and {} more", lost.len() - NAMED);
        }
        let names = if names.is_empty() { names } else { format!(", not {names}") };
        found.push(Finding {
            kind: "registered",
            cause: format!("{registered} of {pictures} pictures have a camera{names}"),
            remedy: "add pictures between those with a camera and the others, each overlapping the next by two thirds",
        });
    }
    if !model.others.is_empty() && model.others.iter().sum::<usize>() * 10 > registered {
        let others: Vec<String> = model.others.iter().map(usize::to_string).collect();
        found.push(Finding {
            kind: "models",
            cause: format!("the pictures fell into separate parts of {registered}, {}", others.join(", ")),
            remedy: "the largest is used; add pictures that show two parts at once, or capture the places separately",
        });
    }
    if model.tracks.is_empty() {
        return found;
    }
    let count = model.tracks.len() as f64;
    let angle = angle_of(model);
    if angle < ANGLE_MIN {
        found.push(Finding {
            kind: "baseline",
            cause: format!("rays of a point meet at {angle:.1}° in the median: the camera turned, but hardly moved"),
            remedy: "walk around the object instead of turning on the spot",
        });
    }
    let error = model.tracks.iter().map(|track| track.error).sum::<f64>() / count;
    if error > ERROR_MAX {
        found.push(Finding {
            kind: "error",
            cause: format!("points miss their pictures by {error:.2} pixels in the mean"),
            remedy: "lock the zoom and the focus; for wide lenses set --lens OPENCV or OPENCV_FISHEYE",
        });
    }
    let length = model.tracks.iter().map(|track| track.pictures.len()).sum::<usize>() as f64 / count;
    if length < TRACK_MIN {
        found.push(Finding {
            kind: "tracks",
            cause: format!("a point is seen by {length:.1} pictures in the mean"),
            remedy: "take more pictures, closer together",
        });
    }
    found
}

/// Median over points of the largest angle between two of their rays, in degrees.
fn angle_of(model: &Reconstruction) -> f64 {
    let step = model.tracks.len().div_ceil(SAMPLES).max(1);
    let angles = model.tracks.iter().step_by(step).map(|track| {
        let to = |picture: &usize| {
            (DVec3::from(model.pictures[*picture].position) - DVec3::from(track.position)).normalize_or_zero()
        };
        let rays: Vec<DVec3> = track.pictures.iter().map(to).collect();
        let pairs =
            rays.iter().enumerate().flat_map(|(index, one)| rays[index + 1..].iter().map(move |other| one.dot(*other)));
        pairs.fold(1.0, f64::min).clamp(-1.0, 1.0).acos().to_degrees() as f32
    });
    f64::from(median(angles))
}

fn of_looks(looks: &[Look]) -> Vec<Finding> {
    let mut found = Vec::new();
    // The sides of a thing that is cut out differ in detail.
    let whole: Vec<&Look> = looks.iter().filter(|look| look.coverage > CUT_OUT).collect();
    let usual = median(whole.iter().map(|look| look.sharpness));
    let blurred: Vec<&&Look> = whole.iter().filter(|look| look.sharpness < BLURRED * usual).collect();
    if whole.len() >= 3 && usual < SHARPNESS_MIN {
        found.push(Finding {
            kind: "blur",
            cause: "most pictures are blurred".into(),
            remedy: "use more light or a shorter exposure, hold still for each picture, and lock the focus on the object",
        });
    } else if let Some(first) = blurred.first() {
        found.push(Finding {
            kind: "blur",
            cause: format!(
                "{} of {} pictures are less sharp than the others, such as {}",
                blurred.len(),
                whole.len(),
                first.name
            ),
            remedy: "remove them, if others show the same",
        });
    }
    let mut brightness: Vec<f32> = looks.iter().map(|look| look.brightness).collect();
    brightness.sort_by(f32::total_cmp);
    let tenth = |tenth: usize| brightness.get(brightness.len() * tenth / 10).copied().unwrap_or(1.0);
    let [low, high] = [1, 9].map(tenth);
    if looks.len() >= 10 && high > EXPOSURE_MAX * low.max(0.01) {
        found.push(Finding {
            kind: Finding::EXPOSURE,
            cause: format!("pictures differ in brightness by a factor of {:.1}", high / low.max(0.01)),
            remedy: "lock exposure and white balance, or train with --exposure",
        });
    }
    found
}

/// The largest gap around the object, if the cameras surround more than half of it.
fn gap(evidence: &Evidence<'_>) -> Option<Finding> {
    let (up, centre) = evidence.orientation.map(|(up, centre)| (DVec3::from(up), DVec3::from(centre)))?;
    let (side, front) = up.any_orthonormal_pair();
    let azimuth = |position: &[f64; 3]| {
        let ray = DVec3::from(*position) - centre;
        ray.dot(side).atan2(ray.dot(front)).to_degrees()
    };
    let mut azimuths: Vec<f64> = evidence.positions.iter().map(azimuth).collect();
    azimuths.sort_by(f64::total_cmp);
    let (first, last) = (*azimuths.first()?, *azimuths.last()?);
    let gaps = azimuths.windows(2).map(|pair| pair[1] - pair[0]);
    let widest = gaps.fold(first + 360.0 - last, f64::max);
    (azimuths.len() >= 3 && widest > GAP_MAX).then(|| Finding {
        kind: "coverage",
        cause: format!("{widest:.0}° of the circle around the object were not photographed"),
        remedy: "add pictures from there, or expect nothing behind it: turntables go back and forth in front of it",
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_io::reconstruction::{Registered, Track};

    /// Cameras at these positions, all of which see points around the origin.
    fn model(positions: &[[f64; 3]]) -> Reconstruction {
        let picture =
            |position: &[f64; 3]| Registered { name: "a".into(), position: *position, forward: [0.0, 0.0, 1.0] };
        let track = |k: usize| Track {
            position: [k as f64 * 0.01, 0.0, 0.0],
            error: 0.5,
            pictures: (0..positions.len()).collect(),
        };
        Reconstruction {
            pictures: positions.iter().map(picture).collect(),
            tracks: (0..50).map(track).collect(),
            others: Vec::new(),
        }
    }

    fn circle(count: usize, part: f64) -> Vec<[f64; 3]> {
        let angle = |k: usize| part * core::f64::consts::TAU * k as f64 / count as f64;
        (0..count).map(|k| [4.0 * angle(k).cos(), 4.0 * angle(k).sin(), 1.0]).collect()
    }

    fn kinds(evidence: &Evidence<'_>) -> Vec<&'static str> {
        findings(evidence).iter().map(|finding| finding.kind).collect()
    }

    fn look(sharpness: f32, brightness: f32) -> Look {
        Look { name: "a".into(), sharpness, coverage: 1.0, brightness }
    }

    #[test]
    fn a_good_capture_has_no_finding() {
        let positions = circle(36, 1.0);
        let model = model(&positions);
        let looks = vec![look(0.4, 0.5); 36];
        let orientation = Some(([0.0, 0.0, 1.0], [0.0; 3]));
        let evidence = Evidence {
            pictures: 36,
            reconstruction: Some(&model),
            looks: &looks,
            orientation,
            positions: &positions,
            ..Evidence::default()
        };
        assert_eq!(kinds(&evidence), [""; 0]);
    }

    #[test]
    fn each_fault_has_its_finding() {
        let positions = circle(36, 1.0);
        let good = model(&positions);
        let of = |pictures: usize, model: &Reconstruction| {
            kinds(&Evidence { pictures, reconstruction: Some(model), ..Evidence::default() })
        };
        assert_eq!(of(60, &good), ["registered"]);
        let lost = ["a.jpg", "b.jpg"].map(str::to_owned);
        let few = Evidence { pictures: 60, lost: &lost, reconstruction: Some(&good), ..Evidence::default() };
        assert!(findings(&few)[0].cause.ends_with("36 of 60 pictures have a camera, not a.jpg, b.jpg"));
        assert_eq!(of(36, &Reconstruction { others: vec![15], ..good.clone() }), ["models"]);
        let turned: Vec<_> = positions.iter().map(|[x, y, _]| [4.0 + 0.01 * x, 0.01 * y, 0.0]).collect();
        assert_eq!(of(36, &model(&turned)), ["baseline"]);
        let mut noisy = good.clone();
        noisy.tracks.iter_mut().for_each(|track| (track.error, track.pictures) = (2.5, vec![0, 12]));
        assert_eq!(of(36, &noisy), ["error", "tracks"]);
        let blurred = vec![look(0.26, 0.5); 12];
        assert_eq!(kinds(&Evidence { looks: &blurred, ..Evidence::default() }), ["blur"]);
        let drifting: Vec<_> = (0..12).map(|k| look(0.4, 0.2 + 0.04 * k as f32)).collect();
        assert_eq!(kinds(&Evidence { looks: &drifting, ..Evidence::default() }), [Finding::EXPOSURE]);
        assert_eq!(of(20, &model(&circle(20, 1.0))), ["few"]);
        let half = circle(24, 0.5);
        let orientation = Some(([0.0, 0.0, 1.0], [0.0; 3]));
        assert_eq!(kinds(&Evidence { orientation, positions: &half, ..Evidence::default() }), ["coverage"]);
    }

    #[test]
    fn a_failure_names_its_likely_cause() {
        assert!(of_failure(20, 18).contains("turned"));
        assert!(of_failure(20, 2).contains("texture"));
    }
}
