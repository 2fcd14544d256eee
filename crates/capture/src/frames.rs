//! Selection of frames: the best one of each window, where a window is an equal share of time and
//! of view change, so that fast and slow parts of a path are sampled alike.

use serde::{Deserialize, Serialize};

/// Edges of the grey picture that represents a frame.
pub(crate) const WIDTH: usize = 320;
pub(crate) const HEIGHT: usize = 180;
/// Weights of a frame's score, after the planner of ooosplat.
const SHARPNESS: f32 = 0.42;
const EXPOSURE: f32 = 0.28;
const CHANGE: f32 = 0.20;
const STILLNESS: f32 = 0.10;
/// Mean difference of grey levels below which two frames show the same.
const SAME: f32 = 0.6;
/// Grey levels that count as black and as white.
const CLIPPED: [u8; 2] = [3, 252];

/// Grey picture of a frame.
#[derive(Clone, Debug)]
pub(crate) struct Thumbnail {
    pub(crate) grey: Vec<u8>,
}

/// A frame that may be selected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Candidate {
    /// Number of the frame in the video.
    pub(crate) frame: u64,
    /// Mean square of the Laplacian.
    pub(crate) sharpness: f32,
    /// Mean grey level, 0 to 255.
    pub(crate) brightness: f32,
    /// Share of pixels that are black or white.
    pub(crate) clipped: f32,
    /// Mean difference of grey levels to the candidate before.
    pub(crate) change: f32,
}

impl Candidate {
    /// Measures a frame.
    pub(crate) fn of(frame: u64, thumbnail: &Thumbnail, before: Option<&Thumbnail>) -> Self {
        let grey = &thumbnail.grey;
        let at = |x: usize, y: usize| f32::from(grey[y * WIDTH + x]);
        let mut sum = 0.0;
        for y in 1..HEIGHT - 1 {
            for x in 1..WIDTH - 1 {
                let around = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1);
                sum += (4.0 * at(x, y) - around).powi(2);
            }
        }
        let count = (WIDTH * HEIGHT) as f32;
        let clipped = grey.iter().filter(|level| **level <= CLIPPED[0] || **level >= CLIPPED[1]).count();
        let difference = |before: &Thumbnail| -> f32 {
            grey.iter().zip(&before.grey).map(|(one, other)| f32::from(one.abs_diff(*other))).sum::<f32>() / count
        };
        Self {
            frame,
            sharpness: sum / count,
            brightness: grey.iter().map(|level| f32::from(*level)).sum::<f32>() / count,
            clipped: clipped as f32 / count,
            change: before.map_or(0.0, difference),
        }
    }
}

/// Indices of at most `count` candidates, in ascending order. Frames that show the same as the
/// selected one before are omitted.
pub(crate) fn selected(candidates: &[Candidate], count: usize) -> Vec<usize> {
    let moved: f32 = candidates.iter().map(|candidate| candidate.change).sum();
    let middle = median(candidates.iter().map(|candidate| candidate.brightness));
    let mut windows = vec![Vec::new(); count.max(1)];
    let mut path = 0.0;
    for (index, candidate) in candidates.iter().enumerate() {
        let time = index as f32 / candidates.len() as f32;
        path += candidate.change;
        let place = if moved > 0.0 { 0.5 * time + 0.5 * path / moved } else { time };
        windows[((place * count as f32) as usize).min(count.saturating_sub(1))].push(index);
    }
    let mut chosen: Vec<usize> = Vec::new();
    for window in windows.iter().filter(|window| !window.is_empty()) {
        let most = |of: &dyn Fn(usize) -> f32| window.iter().map(|index| of(*index)).fold(f32::MIN_POSITIVE, f32::max);
        let since = |index: usize| -> f32 {
            let first = chosen.last().map_or(0, |last| last + 1);
            candidates[first..=index].iter().map(|candidate| candidate.change).sum()
        };
        let motion = |index: usize| {
            let after = candidates.get(index + 1).map_or(0.0, |next| next.change);
            candidates[index].change.max(after)
        };
        let [sharpest, farthest, fastest] = [most(&|index| candidates[index].sharpness), most(&since), most(&motion)];
        let score = |index: usize| {
            let candidate = &candidates[index];
            let drift = (candidate.brightness - middle).abs() / 64.0;
            SHARPNESS * candidate.sharpness / sharpest
                + EXPOSURE * (1.0 - candidate.clipped - drift).max(0.0)
                + CHANGE * since(index) / farthest
                + STILLNESS * (1.0 - motion(index) / fastest)
        };
        let best =
            window.iter().copied().max_by(|one, other| score(*one).total_cmp(&score(*other)).then(other.cmp(one)));
        let best = best.expect("the window has candidates");
        if chosen.is_empty() || since(best) >= SAME {
            chosen.push(best);
        }
    }
    chosen
}

/// Median; 0 of nothing.
pub(crate) fn median(numbers: impl Iterator<Item = f32>) -> f32 {
    let mut sorted: Vec<f32> = numbers.collect();
    sorted.sort_by(f32::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(frame: u64, sharpness: f32, change: f32) -> Candidate {
        Candidate { frame, sharpness, brightness: 120.0, clipped: 0.0, change }
    }

    #[test]
    fn the_sharpest_frame_of_each_window_is_selected() {
        let candidates: Vec<_> = (0..40).map(|k| candidate(k, if k % 10 == 7 { 90.0 } else { 30.0 }, 5.0)).collect();
        assert_eq!(selected(&candidates, 4), [7, 17, 27, 37]);
    }

    #[test]
    fn a_fast_part_gets_more_frames_and_a_pause_gets_one() {
        let change = |k: u64| if (20..40).contains(&k) { 20.0 } else { 0.0 };
        let candidates: Vec<_> = (0..60).map(|k| candidate(k, 50.0, change(k))).collect();
        let chosen = selected(&candidates, 12);
        let fast = chosen.iter().filter(|index| (20..40).contains(*index)).count();
        assert!(fast >= 6 && chosen.len() <= fast + 2, "{chosen:?}");
    }

    #[test]
    fn dark_frames_lose_against_those_of_the_usual_brightness() {
        let mut candidates: Vec<_> = (0..10).map(|k| candidate(k, 50.0, 5.0)).collect();
        for dark in [0, 1, 2, 4] {
            candidates[dark].brightness = 20.0;
        }
        assert_eq!(selected(&candidates, 2)[0], 3);
    }

    #[test]
    fn a_frame_is_measured() {
        let flat = Thumbnail { grey: vec![100; WIDTH * HEIGHT] };
        let mut striped = flat.clone();
        striped.grey.iter_mut().step_by(2).for_each(|level| *level = 255);
        let found = Candidate::of(3, &striped, Some(&flat));
        assert!(found.sharpness > 1e4 && (found.change - 77.5).abs() < 0.1, "{found:?}");
        assert!((found.clipped - 0.5).abs() < 1e-6, "{found:?}");
        assert_eq!(Candidate::of(0, &flat, None).sharpness, 0.0);
        assert!(selected(&[], 5).is_empty());
    }
}
