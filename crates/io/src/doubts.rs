//! Cameras whose poses are probably wrong.

use crate::{listing::Listing, shot::Shot};
use glam::DVec3;

/// Distance of a camera from the centre of all, relative to the median, above which it is noted.
const FAR: f64 = 10.0;

/// Notes on cameras far from all others, and on cameras that see no point.
pub(crate) fn doubts(listing: &Listing) -> impl Iterator<Item = String> + use<> {
    let points = listing.points.as_ref().map_or(&[][..], |points| &points.positions);
    far_away(listing.shots()).into_iter().chain(all_behind(listing.shots(), points))
}

fn far_away<'a>(shots: impl Iterator<Item = &'a Shot> + Clone) -> Option<String> {
    let positions = || shots.clone().map(|shot| shot.pose.position);
    let middle = [0, 1, 2].map(|axis| median(positions().map(|position| position[axis]).collect()));
    let distance = |shot: &Shot| shot.pose.position.distance(DVec3::from(middle));
    let usual = median(shots.clone().map(distance).collect());
    let farthest = shots.clone().max_by(|one, other| distance(one).total_cmp(&distance(other)))?;
    let ratio = distance(farthest) / usual;
    (usual > 0.0 && ratio > FAR).then(|| {
        format!(
            "the camera of {:?} is {ratio:.0} times as far from the centre of all cameras as most; their extent sets \
             learning rates, so remove it if its pose is wrong",
            farthest.name
        )
    })
}

fn all_behind<'a>(mut shots: impl Iterator<Item = &'a Shot>, points: &[[f64; 3]]) -> Option<String> {
    let is_before = |shot: &Shot, point: &[f64; 3]| {
        (shot.pose.camera_from_world * (DVec3::from(*point) - shot.pose.position)).z > 0.0
    };
    let is_seen = points.is_empty() || shots.any(|shot| points.iter().any(|point| is_before(shot, point)));
    (!is_seen).then(|| {
        "no point is in front of any camera; the axes of transform_matrix are x right, y up and z backwards, those of \
         COLMAP x right, y down and z forwards"
            .to_owned()
    })
}

/// Median of numbers; NaN without any.
fn median(mut numbers: Vec<f64>) -> f64 {
    let middle = numbers.len() / 2;
    if numbers.is_empty() { f64::NAN } else { *numbers.select_nth_unstable_by(middle, f64::total_cmp).1 }
}
