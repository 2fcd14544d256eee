//! The cheapest setting for an error: chosen by some tiles of pictures, verified on others.
//!
//! Each knob is turned alone, all others at their most exact; then all at once, each to its cheapest value whose own
//! error is within a bound. The bound begins at the whole error, because errors of different knobs seldom add up, and
//! falls until the setting holds in each tile, of those that it was chosen by and of those that it was not. A tile more
//! of the same scene is then beyond the error by a chance of one in n + 1, for n tiles that it was not chosen by; a whole
//! view, whose error is a mean over many tiles, by less. What is cheap is told by counts of the work, so that the choice
//! is the same on every machine and in every run.

use crate::{
    error::{Errors, Sums},
    reference::{Exact, Reference},
    setting::{KNOBS, Knob, Setting, Tried, is_possible, together},
    subject::Subject,
    trial::{Trial, Work, measured},
};
use specula_core::{camera::Camera, random};
use specula_cpu::CpuError;

/// A bound is this share of the one before.
const TIGHTER: f64 = 0.7;
/// So many bounds are tried.
const BOUNDS: usize = 16;
/// Tiles of the pictures, and pixels along an edge of each.
const TILES: usize = 16;
const TILE: u32 = 96;
/// So many places are drawn for each tile, and the one that is most wrong is taken.
const PLACES: u64 = 8;
/// Seed of the places.
const SEED: u64 = 0;
/// Knobs that do not change what a picture costs here, once its light is filtered, or not its colours.
const LEFT_ALONE: [&str; 4] = ["storage", "prefilter", "light", "channels"];

/// What was chosen, and by what right.
#[derive(Clone, Copy, Debug)]
pub struct Certificate {
    /// The setting.
    pub setting: Setting,
    /// The error that was asked for, of each tile: root of the mean square of sRGB colours in [0, 1].
    pub asked: f64,
    /// On the tiles that it was chosen by.
    pub chosen_by: Errors,
    /// On tiles that it was not chosen by.
    pub verified: Errors,
    /// How many tiles each of the two are.
    pub tiles: [usize; 2],
    /// Work of the tiles that it was verified on, and under the usual setting.
    pub work: [Work; 2],
}

/// Why there is no setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// Even the most exact setting is this far off, on tiles that it was not chosen by.
    TooClose(f64),
    /// The processor could not render.
    Failed,
}

/// Errors of a setting in some views, and the work of its pictures.
pub fn errors_of(
    trial: &mut Trial<'_>,
    subject: &Subject,
    setting: &Setting,
    views: &[(Camera, Exact)],
) -> Result<(Errors, Work), CpuError> {
    let (mut sums, mut work) = (Sums::default(), Work::default());
    for (camera, exact) in views {
        work = work.and(&trial.view(setting, camera)?.work);
        sums.add(&trial.view(&measured(setting), camera)?.image, exact, subject.background);
    }
    Ok((sums.errors(), work))
}

/// Part of a view: what is around a pixel, at the same scale.
pub(crate) fn tile_of(camera: &Camera, [x, y]: [u32; 2], size: [u32; 2]) -> Camera {
    let principal_px = [camera.principal_px[0] - x as f32, camera.principal_px[1] - y as f32];
    Camera { principal_px, width: size[0], height: size[1], ..*camera }
}

/// The view that a tile is of. Where there are fewer views than tiles, neighbours still are of different ones, because
/// every second tile is held out.
fn view(tile: usize, count: usize) -> usize {
    if count < TILES { tile % count } else { tile * count / TILES }
}

/// Views that are no larger than a tile are taken once each, but one alone both to choose by and to verify on.
fn tile_count(views: &[Camera]) -> usize {
    let is_small = |view: &Camera| view.width <= TILE && view.height <= TILE;
    match views.len() {
        0 => 0,
        count if views.iter().all(is_small) => count.clamp(2, TILES),
        _ => TILES,
    }
}

/// Tiles of views that are evenly spread over those of the subject, where the usual setting differs most from the most
/// exact one that the processor has: errors are larger there than in whole pictures.
pub fn tiles(trial: &mut Trial<'_>, subject: &Subject) -> Result<Vec<Camera>, CpuError> {
    (0..tile_count(&subject.cameras))
        .map(|k| tile_that_differs(trial, subject, k as u64, &subject.cameras[view(k, subject.cameras.len())]))
        .collect()
}

/// The tile of a view, of some places, that is most wrong; all of the view, where it is no larger than a tile.
fn tile_that_differs(trial: &mut Trial<'_>, subject: &Subject, number: u64, view: &Camera) -> Result<Camera, CpuError> {
    let size = [view.width.min(TILE), view.height.min(TILE)];
    let room = [view.width - size[0], view.height - size[1]];
    if room == [0; 2] {
        return Ok(*view);
    }
    let mut most = (f32::NEG_INFINITY, *view);
    for place in 0..PLACES {
        let draw = |axis: usize| {
            let share = random::uniform(SEED, number, 2 * place + axis as u64);
            (share * (room[axis] + 1) as f32) as u32
        };
        let tile = tile_of(view, [draw(0), draw(1)], size);
        let usual = trial.view(&Setting::usual(subject), &tile)?.image;
        let exact = trial.view(&Setting::exact(subject), &tile)?.image;
        let pairs = usual.values.iter().zip(&exact.values);
        let difference: f32 = pairs.map(|(own, exact)| (own - exact).powi(2)).filter(|square| square.is_finite()).sum();
        if difference > most.0 {
            most = (difference, tile);
        }
    }
    Ok(most.1)
}

/// The cheapest setting whose error is at most `error` in tiles of the subject's views: the first of every two is what
/// it is chosen by, the second what it is verified on.
pub fn cheapest_within(subject: &Subject, error: f64) -> Result<Certificate, Refusal> {
    let cameras = tiles(&mut Trial::new(subject), subject).map_err(|_| Refusal::Failed)?;
    let subject = &Subject { cameras, ..subject.clone() };
    let views = Reference::new(subject).views(subject, || {});
    let pick = |parity: usize| views.iter().skip(parity).step_by(2).cloned().collect::<Vec<_>>();
    let chosen_by = pick(0);
    let held_out = pick(1);
    let mut search = Search { subject, trial: Trial::new(subject), error, chosen_by, held_out };
    search.run()
}

struct Search<'a> {
    subject: &'a Subject,
    trial: Trial<'a>,
    error: f64,
    chosen_by: Vec<(Camera, Exact)>,
    held_out: Vec<(Camera, Exact)>,
}

impl Search<'_> {
    fn run(&mut self) -> Result<Certificate, Refusal> {
        let exact = Setting::exact(self.subject);
        let of_knobs = self.turn_each(&exact)?;
        let mut bound = self.error;
        for _ in 0..BOUNDS {
            let setting = together(&exact, &of_knobs, bound);
            if let Some(certificate) = self.certify(if is_possible(&setting) { &setting } else { &exact })? {
                return Ok(certificate);
            }
            bound *= TIGHTER;
        }
        let (errors, _) = self.measure(&exact, false)?;
        match self.certify(&exact)? {
            Some(certificate) => Ok(certificate),
            None => Err(Refusal::TooClose(errors.worst)),
        }
    }

    fn turn_each(&mut self, exact: &Setting) -> Result<Vec<(Knob, Vec<Tried>)>, Refusal> {
        let mut of_knobs = Vec::new();
        for knob in KNOBS.into_iter().filter(|knob| !LEFT_ALONE.contains(&knob.name)) {
            let mut tried = Vec::new();
            for setting in knob.turned(self.subject, exact) {
                let (errors, work) = self.measure(&setting, true)?;
                let error = if errors.nonfinite == 0 { errors.rms } else { f64::INFINITY };
                tried.push(Tried { setting, error, cost: work.cost() });
            }
            of_knobs.push((knob, tried));
        }
        Ok(of_knobs)
    }

    fn measure(&mut self, setting: &Setting, chosen_by: bool) -> Result<(Errors, Work), Refusal> {
        let views = if chosen_by { &self.chosen_by } else { &self.held_out };
        errors_of(&mut self.trial, self.subject, setting, views).map_err(|_| Refusal::Failed)
    }

    /// A certificate for a setting, if it holds.
    fn certify(&mut self, setting: &Setting) -> Result<Option<Certificate>, Refusal> {
        let (chosen_by, _) = self.measure(setting, true)?;
        if !chosen_by.is_within(self.error) {
            return Ok(None);
        }
        let (verified, work) = self.measure(setting, false)?;
        if !verified.is_within(self.error) {
            return Ok(None);
        }
        let (_, usual) = self.measure(&Setting::usual(self.subject), false)?;
        Ok(Some(Certificate {
            setting: *setting,
            asked: self.error,
            chosen_by,
            verified,
            tiles: [self.chosen_by.len(), self.held_out.len()],
            work: [work, usual],
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use specula_core::{
        prefilter::PrefilterScheme,
        scene::{Layout, RadianceActivation},
        shade::ShadingRules,
    };
    use specula_oracle::scenes::{random_cloud, random_environment};

    /// The seed that has a light, whose weights take a while.
    const LIT: u64 = 1;
    /// Views that a setting is chosen by and verified on.
    const SEEN: u32 = 8;
    /// Width and height of views in pixels: tiles are a part of the large, and all of the small.
    const LARGE: u32 = 128;
    const SMALL: u32 = 48;

    /// A view from a place of a circle.
    fn orbit(place: f32, size: u32) -> Camera {
        let (sin, cos) = (place * core::f32::consts::TAU / SEEN as f32).sin_cos();
        Camera::look_at(Vec3::new(3.6 * sin, 3.6 * cos, 1.5), Vec3::ZERO, Vec3::Z, 0.7, size, size)
    }

    fn subject(seed: u64, size: u32) -> Subject {
        Subject {
            gaussians: random_cloud(200, Layout::shaded(Some(1)), seed),
            light: (seed == LIT).then(|| random_environment(16, RadianceActivation::Identity, seed)),
            shading: ShadingRules::DEFERRED,
            scheme: PrefilterScheme::Exact,
            cameras: (0..SEEN).map(|k| orbit(k as f32, size)).collect(),
            background: [1.0; 3],
        }
    }

    #[test]
    fn a_certificate_holds_on_whole_views_that_it_has_not_seen() {
        for (seed, error) in [(1, 0.03), (2, 0.01), (3, 0.002)] {
            let subject = subject(seed, LARGE);
            let certificate = cheapest_within(&subject, error).expect("it can be met");
            assert!(certificate.chosen_by.is_within(error) && certificate.verified.is_within(error), "{certificate:?}");
            let reference = Reference::new(&subject);
            let views = [0.5, 3.3, 6.7].map(|place| {
                let other = orbit(place, LARGE);
                (other, reference.view(&subject, &other))
            });
            let mut trial = Trial::new(&subject);
            let (errors, _) = errors_of(&mut trial, &subject, &certificate.setting, &views).expect("it renders");
            assert!(errors.is_within(error), "{error} was asked for, and {errors:?} measured");
        }
    }

    #[test]
    fn a_scene_of_nothing_is_exact() {
        let nothing = Subject { gaussians: random_cloud(0, Layout::shaded(Some(1)), 0), ..subject(LIT, SMALL) };
        let certificate = cheapest_within(&nothing, 1e-6).expect("there is nothing to get wrong");
        assert_eq!((certificate.verified.max, certificate.verified.nonfinite), (0.0, 0), "{certificate:?}");
    }

    #[test]
    fn what_is_allowed_more_error_costs_no_more() {
        let subject = subject(4, SMALL);
        let cost = |error: f64| cheapest_within(&subject, error).expect("it can be met").work[0].cost();
        let costs = [0.001, 0.01, 0.1].map(cost);
        assert!(costs[0] >= costs[1] && costs[1] >= costs[2], "{costs:?}");
        assert!(costs[2] < 0.9 * costs[0], "something is saved: {costs:?}");
    }

    #[test]
    fn what_cannot_be_met_is_refused_with_what_can() {
        match cheapest_within(&subject(5, SMALL), 1e-12) {
            Err(Refusal::TooClose(error)) => assert!(error > 1e-12 && error < 1e-2, "{error}"),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn small_views_are_held_out_or_chosen_by_and_never_both() {
        let some = |count: usize| {
            let subject = subject(7, SMALL);
            let subject = Subject { cameras: subject.cameras[..count].to_vec(), ..subject };
            tiles(&mut Trial::new(&subject), &subject).expect("it renders")
        };
        for count in [2, 5, 8] {
            let tiles = some(count);
            let of_chosen: Vec<&Camera> = tiles.iter().step_by(2).collect();
            assert_eq!(tiles.len(), count);
            assert!(tiles.iter().skip(1).step_by(2).all(|held_out| !of_chosen.contains(&held_out)), "{count} views");
        }
        assert_eq!(some(1).len(), 2, "one view is all there is");
    }

    #[test]
    fn a_tile_is_a_part_of_its_view() {
        let subject = subject(6, SMALL);
        let whole = subject.cameras[0];
        let tile = tile_of(&whole, [9, 5], [16, 12]);
        let mut trial = Trial::new(&subject);
        let setting = Setting::usual(&subject);
        let [whole, tile] = [whole, tile].map(|camera| trial.view(&setting, &camera).expect("it renders").image);
        for (x, y) in [(0, 0), (15, 11), (7, 3)] {
            let (own, of_whole) = (tile.rgb(y * 16 + x), whole.rgb((y + 5) * whole.width + x + 9));
            for c in 0..3 {
                assert!((own[c] - of_whole[c]).abs() < 1e-4, "{own:?} and {of_whole:?}");
            }
        }
    }
}
